"""Recordings solved frame by frame, smoothed, and over time: errors, accelerations and error bars.

    python benchmarks/sequences.py [--takes 12] [--views 4] [--fps 30] [--conditions heavy] [--joints]

Motions of the CMU motion capture in a Human3.6M-like room; the detections are simulated, with errors that
last (`skelsplat.synthetic.Memory`), and all methods get the same. `--takes` is a spread sample of 92 takes
(all), `--names` one of them, such as 05_17, and `--frames` the middle part of longer ones. Conditions: good,
occluded 2, occluded 3, heavy. Without `--confidence` the methods get no confidences: simulated ones
know too well what is hidden. Names, conditions and methods may be repeated.

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
import recordings
from lab import Table
from numpy.typing import NDArray
from recordings import Take
from scenarios import FloatArray

import skelsplat as sk

Masks = list[NDArray[np.bool_]]
# The joints of a take that belong to the extremes: this share of all joints and frames.
EXTREME = 0.01
# Without those of another library.
USUAL = tuple(name for name in recordings.METHODS if not name.startswith("anipose"))


@dataclass
class Errors:
    """What a method did wrong in all takes of a condition, each (T, N); NaN if not judged or answered."""

    judged: Masks = field(default_factory=list)
    distance: list[FloatArray] = field(default_factory=list)  # mm
    acceleration: list[FloatArray] = field(default_factory=list)  # m/s²
    inside: list[FloatArray] = field(default_factory=list)  # (3, T, N) within 1, 2, 3 σ
    seconds: float = 0.0

    def add(self, take: Take, solved: recordings.Solved, seconds: float) -> None:
        """Judge one take."""
        truth = take.scene.judged
        error = solved.pose - truth
        second = np.full(error.shape[:2], np.nan)
        second[1:-1] = np.linalg.norm(np.diff(error, n=2, axis=0), axis=-1) * take.fps**2 / 1000.0
        self.judged.append(np.isfinite(truth[..., 0]))
        self.distance.append(np.linalg.norm(error, axis=-1))
        self.acceleration.append(second)
        if solved.covariance is not None:
            inside = sk.metrics.sigma_coverage(solved.pose, solved.covariance, truth, reduce="none")
            self.inside.append(np.asarray(inside))
        self.seconds += seconds

    def row(self, masks: Masks | None = None) -> dict[str, float | None]:
        """Return the figures of the joints under masks (T, N), one per take; without any, of all."""
        judged = np.concatenate(self.judged)
        of = np.ones_like(judged) if masks is None else np.concatenate(masks)
        distance, second = (np.concatenate(parts)[of] for parts in (self.distance, self.acceleration))
        shares = np.nanmean(np.concatenate(self.inside, axis=1)[:, of], axis=1) if self.inside else None
        row: dict[str, float | None] = {
            "mean mm": float(np.nanmean(distance)),
            "median": float(np.nanmedian(distance)),
            "p95": float(np.nanpercentile(distance, 95)),
            "acc m/s²": float(np.nanmean(second)),
            **{f"{k + 1} σ %": None if shares is None else float(100 * shares[k]) for k in range(3)},
        }
        if masks is None:
            row["answered %"] = 100 * float(np.isfinite(distance).sum() / judged.sum())
            row["ms/frame"] = 1000.0 * self.seconds / len(judged)
        return row


def measured(takes: list[Take], names: Sequence[str]) -> dict[str, Errors]:
    """Run every method on every take."""
    out = {name: Errors() for name in names}
    for name, errors in out.items():
        recordings.METHODS[name](takes[0])  # imports and compiles what it needs
        for take in takes:
            begun = time.perf_counter()
            solved = recordings.METHODS[name](take)
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


def sequences(
    *,
    takes: int | None = None,
    names: tuple[str, ...] = (),
    frames: int | None = None,
    views: int = 4,
    fps: int = 30,
    conditions: tuple[str, ...] = recordings.CONDITIONS,
    methods: tuple[str, ...] = USUAL,
    confidence: bool = False,
    joints: bool = False,
    seed: int = 0,
) -> Iterator[Table]:
    """Compare methods on recordings."""
    for condition in conditions:
        cut = {"count": takes, "names": names or None, "most_frames": frames}
        found = recordings.takes(condition, n_views=views, fps=fps, seed=seed, confidence=confidence, **cut)
        results = measured(found, methods)
        n_frames = sum(len(take.scene.truth) for take in found)
        title = f"{condition}: {views} views, {fps} Hz, {n_frames} frames, simulated detections"
        rows = {name: errors.row() for name, errors in results.items()}
        yield Table.of(title, "method", rows)
        if joints:
            by_part = {
                f"{name}, {part}": errors.row(masks)
                for part, masks in parts(found).items()
                for name, errors in results.items()
            }
            yield Table.of(f"{condition}, by joints", "method, joints", by_part)


if __name__ == "__main__":
    lab.main(__doc__, sequences)
