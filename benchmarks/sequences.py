"""Recordings solved frame by frame, smoothed, and over time: errors, accelerations and error bars.

    python benchmarks/sequences.py [--takes 12] [--views 4] [--fps 30] [--conditions good heavy] [--joints]

Motions of the CMU motion capture in a Human3.6M-like room; the detections are simulated, with errors that
last (`skelsplat.synthetic.Memory`), and all methods get the same. `--takes` is a spread sample of 92 takes
(all), `--names` are these, such as 05_17, and `--frames` the middle part of longer ones. Conditions: good,
occluded 2, occluded 3, heavy, swaps. Without `--confidence` the methods get no confidences: simulated ones
know too well what is hidden.

mean, median, p95: distance to the truth, mm, of the joints that at least two views detect; `answered` is the
share of these with a position. acc: mean length of the error's second difference times fps², m/s². 1 σ, 2 σ,
3 σ: share of the errors inside the error bars (Mahalanobis distance); 19.9, 73.9 and 97.1 % are meant. One
core; the time includes the frame-by-frame solution where a method starts from it. `--joints` adds a table of
the joints that truly move and accelerate the most.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import lab
import numpy as np
import over_time
import recordings
from lab import Table
from numpy.typing import NDArray
from recordings import Take
from scenarios import FloatArray

Masks = list[NDArray[np.bool_]]
# The joints of a take that belong to the extremes: this share of all joints and frames.
EXTREME = 0.01
# Without those of another library.
USUAL = tuple(name for name in over_time.METHODS if not name.startswith("anipose"))


@dataclass
class Errors:
    """What a method did wrong in all takes of a condition, joint by joint."""

    distance: list[FloatArray] = field(default_factory=list)  # (T, N) mm; NaN if not judged or answered
    acceleration: list[FloatArray] = field(default_factory=list)  # (T - 2, N) m/s²
    mahalanobis: list[FloatArray] = field(default_factory=list)  # (T, N), only of methods with error bars
    asked: int = 0  # judged joints
    answered: int = 0  # of these with a position
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

    def row(self, masks: Masks | None = None) -> dict[str, float | None]:
        """Return the figures of the joints under masks (T, N), one per take; without any, of all."""
        of = [np.ones(part.shape, dtype=bool) for part in self.distance] if masks is None else masks
        distance = np.concatenate([part[mask] for part, mask in zip(self.distance, of, strict=True)])
        second = [part[mask[1:-1]] for part, mask in zip(self.acceleration, of, strict=True)]
        row: dict[str, float | None] = {
            "mean mm": float(np.nanmean(distance)),
            "median": float(np.nanmedian(distance)),
            "p95": float(np.nanpercentile(distance, 95)),
            "acc m/s²": float(np.nanmean(np.concatenate(second))),
        }
        bars = [part[mask] for part, mask in zip(self.mahalanobis, of, strict=False)]
        inside = np.concatenate(bars) if bars else np.array([])
        inside = inside[np.isfinite(inside)]
        for sigmas in (1, 2, 3):
            row[f"{sigmas} σ %"] = 100 * float(np.mean(inside <= sigmas)) if len(inside) else None
        if masks is None:
            row["answered %"] = 100 * self.answered / self.asked
            row["ms/frame"] = 1000.0 * self.seconds / sum(len(part) for part in self.distance)
        return row


def measured(takes: list[Take], names: Sequence[str]) -> dict[str, Errors]:
    """Run every method on every take."""
    out = {name: Errors() for name in names}
    for name, errors in out.items():
        over_time.METHODS[name](takes[0])  # imports and compiles what it needs
        for take in takes:
            begun = time.perf_counter()
            solved = over_time.METHODS[name](take)
            errors.add(take, solved, time.perf_counter() - begun)
    return out


def parts(takes: list[Take]) -> dict[str, Masks]:
    """Return the joints of the largest true speeds and accelerations as masks."""
    masks = {}
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
    means = {name: np.array([np.nanmean(part) for part in found.distance]) for name, found in results.items()}
    if "frames" not in means:
        return []
    reference, lines = means.pop("frames"), []
    for name, mean in means.items():
        ratio = mean / reference
        worst = int(ratio.argmax())
        change = f"at worst {100 * (ratio[worst] - 1):+.0f} % ({takes[worst].name})"
        lines.append(f"{name}: worse than frames in {(ratio > 1).sum()} of {len(takes)} takes, {change}")
    return lines


def sequences(
    *,
    takes: int | None = None,
    names: tuple[str, ...] | None = None,
    frames: int | None = None,
    views: int = 4,
    fps: int = 30,
    conditions: tuple[str, ...] = recordings.CONDITIONS[:4],
    methods: tuple[str, ...] = USUAL,
    confidence: bool = False,
    joints: bool = False,
    seed: int = 0,
) -> Iterator[Table]:
    """Compare methods on recordings."""
    for condition in conditions:
        found = recordings.takes(
            condition, count=takes, names=names, n_views=views, fps=fps, seed=seed, most_frames=frames
        )
        given = found if confidence else [recordings.unsure(take) for take in found]
        results = measured(given, methods)
        n_frames = sum(len(take.scene.truth) for take in found)
        title = f"{condition}: {views} views, {fps} Hz, {n_frames} frames, simulated detections"
        rows = {name: errors.row() for name, errors in results.items()}
        yield Table.of(title, "method", rows, setbacks(results, given))
        if joints:
            by_part = {
                f"{name}, {part}": errors.row(masks)
                for part, masks in parts(given).items()
                for name, errors in results.items()
            }
            yield Table.of(f"{condition}, by joints", "method, joints", by_part)


if __name__ == "__main__":
    lab.main(__doc__, sequences)
