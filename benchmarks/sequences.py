"""Recordings solved frame by frame, smoothed, and over time: errors, accelerations and error bars.

    python benchmarks/sequences.py [--takes 12] [--views 4] [--fps 30] [--conditions good heavy] [--joints]

Motions of the CMU motion capture in a Human3.6M-like room; the detections are simulated, with errors that
last (`skelsplat.synthetic.memory`), and all methods get the same. Without `--confidence` the methods get no
confidences: simulated ones know too well what is hidden.

mean, median, p95: distance to the truth, mm, of the joints that at least two views detect; `answered` is the
share of these with a position. acc: mean length of the error's second difference times fps², m/s². 1 σ, 2 σ,
3 σ: share of the errors inside the error bars (Mahalanobis distance); 19.9, 73.9 and 97.1 % are meant. One
core; the time includes the frame-by-frame solution where a method starts from it. `--joints` adds a table of
the ends and middles of the limbs and the trunk, and of the joints that truly move and accelerate the most.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, field, replace

import _one_core  # noqa: F401  before numpy
import common
import numpy as np
import over_time
import recordings
from numpy.typing import NDArray
from recordings import Take
from scenarios import FloatArray

from skelsplat.evaluation.over_time import CUTOFF_HZ, cutoff

Masks = list[NDArray[np.bool_]]
# The joints of a take that belong to the extremes: this share of all joints and frames.
EXTREME = 0.01


@dataclass
class Errors:
    """What a method did wrong in all takes of a condition, joint by joint.

    Attributes
    ----------
    distance : list of (T, N) mm
        NaN where the joint is not judged or not answered.
    acceleration : list of (T - 2, N) m/s²
    mahalanobis : list of (T, N)
        Only of methods with error bars.
    asked, answered : int
        Numbers of judged joints, and of these with a position.
    seconds : float
    """

    distance: list[FloatArray] = field(default_factory=list)
    acceleration: list[FloatArray] = field(default_factory=list)
    mahalanobis: list[FloatArray] = field(default_factory=list)
    asked: int = 0
    answered: int = 0
    seconds: float = 0.0

    def add(self, take: Take, solved: over_time.Solved, seconds: float) -> None:
        """Judge one take."""
        truth = take.scene.judged
        error = solved.pose - truth
        self.distance.append(np.linalg.norm(error, axis=-1))
        second = np.diff(error, n=2, axis=0) * take.fps**2 / 1000.0
        self.acceleration.append(np.linalg.norm(second, axis=-1))
        if solved.covariance is not None:
            known = np.isfinite(error).all(axis=-1) & np.isfinite(solved.covariance).all(axis=(-2, -1))
            scaled = np.linalg.solve(solved.covariance[known], error[known][..., None])[..., 0]
            square = np.full(known.shape, np.nan)
            square[known] = np.einsum("ki,ki->k", error[known], scaled)
            self.mahalanobis.append(np.sqrt(square))
        self.asked += int(np.isfinite(truth[..., 0]).sum())
        self.answered += int(np.isfinite(error[..., 0]).sum())
        self.seconds += seconds

    def summary(self, masks: Masks | None = None) -> dict[str, float | None]:
        """Return the figures of the joints under masks (T, N), one per take; None where there are none."""
        if masks is None:
            masks = [np.ones(part.shape, dtype=bool) for part in self.distance]
        distance = np.concatenate([part[mask] for part, mask in zip(self.distance, masks, strict=True)])
        acceleration = np.concatenate(
            [part[mask[1:-1]] for part, mask in zip(self.acceleration, masks, strict=True)]
        )
        figures: dict[str, float | None] = {
            "mean_mm": float(np.nanmean(distance)),
            "median_mm": float(np.nanmedian(distance)),
            "p95_mm": float(np.nanpercentile(distance, 95)),
            "acceleration_m_s2": float(np.nanmean(acceleration)),
        }
        bars = [part[mask] for part, mask in zip(self.mahalanobis, masks, strict=False)]
        inside = np.concatenate(bars) if bars else np.array([])
        inside = inside[np.isfinite(inside)]
        for sigmas in (1, 2, 3):
            figures[f"within_{sigmas}_sigma"] = float(np.mean(inside <= sigmas)) if len(inside) else None
        return figures

    def whole(self) -> dict[str, float | None]:
        """Return the figures of all joints, the share answered and the time."""
        n_frames = sum(len(part) for part in self.distance)
        return {
            **self.summary(),
            "answered": self.answered / self.asked,
            "ms_per_frame": 1000.0 * self.seconds / n_frames,
        }


def measured(takes: list[Take], names: list[str]) -> dict[str, Errors]:
    """Run every method on every take; a first run of a few frames compiles and imports what it needs."""
    out = {}
    for name in names:
        method, errors = over_time.METHODS[name], Errors()
        method(shortened(takes[0], 20))
        for take in takes:
            begun = time.perf_counter()
            solved = method(take)
            errors.add(take, solved, time.perf_counter() - begun)
        out[name] = errors
    return out


def shortened(take: Take, n_frames: int) -> Take:
    """Return the first frames of a take."""
    scene = take.scene
    return replace(
        take, scene=replace(scene, truth=scene.truth[:n_frames], detections=scene.detections[:n_frames])
    )


def without_confidence(take: Take) -> Take:
    """Return the take with confidence 1 for everything that is detected."""
    detections = take.scene.detections.copy()
    detections[..., 2] = np.where(take.scene.detected, 1.0, 0.0)
    return replace(take, scene=replace(take.scene, detections=detections))


def parts(takes: list[Take]) -> dict[str, Masks]:
    """Return the joints of each class, and those of the largest true speeds and accelerations, as masks."""
    shapes = [take.scene.truth.shape[:2] for take in takes]
    masks = {}
    for name, joints in over_time.joint_classes("h36m17").items():
        masks[name] = [np.zeros(shape, dtype=bool) for shape in shapes]
        for mask in masks[name]:
            mask[:, joints] = True
    for order, name in ((1, "fastest"), (2, "hardest")):
        motion = [
            np.pad(np.linalg.norm(np.diff(t.scene.truth, n=order, axis=0), axis=-1), ((1, order - 1), (0, 0)))
            for t in takes
        ]
        least = np.quantile(np.concatenate(motion), 1.0 - EXTREME)
        masks[f"{name} {100 * EXTREME:.0f} %"] = [part >= least for part in motion]
    return masks


def setbacks(results: dict[str, Errors], takes: list[Take]) -> list[str]:
    """Return a line per method on the takes in which it is worse than frame by frame, by its mean error."""
    if "frames" not in results:
        return []
    means = {
        name: np.array([np.nanmean(part) for part in errors.distance]) for name, errors in results.items()
    }
    lines = []
    for name in results:
        if name == "frames":
            continue
        ratio = means[name] / means["frames"]
        worst = int(ratio.argmax())
        change = f"at worst {100 * (ratio[worst] - 1):+.0f} % ({takes[worst].name})"
        lines.append(f"{name}: worse than frames in {(ratio > 1).sum()} of {len(takes)} takes, {change}")
    return lines


def cells(figures: dict[str, float | None]) -> list[str]:
    """Return a row of the table: lengths and accelerations, coverages in per cent, share answered, time."""
    row = [f"{figures[key]:.1f}" for key in ("mean_mm", "median_mm", "p95_mm", "acceleration_m_s2")]
    shares = [figures[f"within_{sigmas}_sigma"] for sigmas in (1, 2, 3)]
    row += ["–" if share is None else f"{100 * share:.1f}" for share in shares]
    if "answered" in figures:
        answered = figures["answered"]
        assert answered is not None
        row += [f"{100 * answered:.1f}", f"{figures['ms_per_frame']:.2g}"]
    return row


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    known = recordings.CONDITIONS
    parser.add_argument("--takes", type=int, metavar="K", help="a spread sample of the 92 takes (all)")
    parser.add_argument("--names", nargs="+", metavar="TAKE", help="these takes, such as 05_17, instead")
    parser.add_argument("--frames", type=int, metavar="F", help="the middle F frames of longer takes (all)")
    parser.add_argument("--views", type=int, default=4, choices=(2, 3, 4, 8), help="cameras (4)")
    parser.add_argument("--fps", type=int, default=30, choices=(10, 15, 30), help="frames per second (30)")
    parser.add_argument("--conditions", nargs="+", choices=known, default=known[:4], help=f"{known[:4]}")
    methods = list(over_time.METHODS)
    usual = [name for name in methods if not name.startswith(("anipose-", "oracle"))]  # slow, and no method
    parser.add_argument("--methods", nargs="+", choices=methods, default=usual, help=f"{methods}")
    parser.add_argument("--confidence", action="store_true", help="let the methods use the confidences")
    parser.add_argument("--joints", action="store_true", help="also a table per class of joints")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def show(condition: str, results: dict[str, Errors], takes: list[Take], chosen: argparse.Namespace) -> None:
    """Print the tables of one condition."""
    n_frames = sum(len(take.scene.truth) for take in takes)
    columns = ["mean mm", "median", "p95", "acc m/s²", "1 σ %", "2 σ %", "3 σ %"]
    title = f"{condition}: {chosen.views} views, {chosen.fps} Hz, {n_frames} frames, simulated detections"
    rows = [[name, *cells(errors.whole())] for name, errors in results.items()]
    common.show(title, ["", *columns, "answered %", "ms/frame"], rows, markdown=chosen.markdown)
    print("\n".join([*setbacks(results, takes), ""]))
    if chosen.joints:
        rows = [
            [f"{name}, {part}", *cells(errors.summary(masks))]
            for part, masks in parts(takes).items()
            for name, errors in results.items()
        ]
        common.show(f"{condition}, by joints", ["", *columns], rows, markdown=chosen.markdown)


def main() -> None:
    chosen = options()
    notes = {name: over_time.absent(name) for name in chosen.methods}
    names = [name for name, reason in notes.items() if reason is None]
    report, worse = {}, {}
    for condition in chosen.conditions:
        takes = recordings.takes(
            condition,
            count=chosen.takes,
            names=chosen.names,
            n_views=chosen.views,
            fps=chosen.fps,
            seed=chosen.seed,
            most_frames=chosen.frames,
        )
        results = measured(takes if chosen.confidence else [without_confidence(t) for t in takes], names)
        report[condition] = {
            name: {
                **errors.whole(),
                "joints": {part: errors.summary(masks) for part, masks in parts(takes).items()},
            }
            for name, errors in results.items()
        }
        worse[condition] = setbacks(results, takes)
        if not chosen.json:
            show(condition, results, takes, chosen)
    absent = [f"without {name}: {reason}" for name, reason in notes.items() if reason is not None]
    if cutoff(chosen.fps) < CUTOFF_HZ:
        absent.append(f"Butterworth filter at {cutoff(chosen.fps):g} Hz: 6 Hz needs more frames")
    if chosen.json:
        machine = common.circumstances()
        print(
            json.dumps(
                {"circumstances": machine, "notes": absent, "conditions": report, "setbacks": worse}, indent=2
            )
        )
        return
    print("\n".join([*absent, common.circumstances()]))


if __name__ == "__main__":
    main()
