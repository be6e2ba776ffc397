"""Recordings solved frame by frame, smoothed, and over time: errors, accelerations and error bars.

    python benchmarks/sequences.py [--takes 12] [--views 4] [--fps 30] [--conditions heavy]

Motions of the CMU motion capture in a Human3.6M-like room; the detections are simulated, with errors that
last (`skelsplat.synthetic.Memory`), and all methods get the same. `--takes` is a spread sample of 92 takes
(all), `--names` one of them, such as 05_17, and `--frames` the middle part of longer ones. Conditions: good,
occluded 2, occluded 3, heavy. Without `--confidence` the methods get no confidences: simulated ones
know too well what is hidden. Names, conditions and methods may be repeated.

mean, median, p95: distance to the truth, mm, of the joints that at least two views detect; `answered` is the
share of these with a position. acc: mean length of the error's second difference times fps², m/s². 1 σ, 2 σ,
3 σ: share of the errors inside the error bars (Mahalanobis distance); 19.9, 73.9 and 97.1 % are meant. One
core; the time includes the frame-by-frame solution where a method starts from it.
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

# Without those of another library.
USUAL = tuple(name for name in recordings.METHODS if not name.startswith("anipose"))


@dataclass
class Errors:
    """What a method did wrong in all takes of a condition, each (T, N); NaN if not judged or answered."""

    judged: list[NDArray[np.bool_]] = field(default_factory=list)
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

    def row(self) -> dict[str, float | None]:
        """Return the figures of all joints."""
        judged, distance, second = map(np.concatenate, (self.judged, self.distance, self.acceleration))
        inside = np.concatenate(self.inside, axis=1).reshape(3, -1) if self.inside else None
        shares = None if inside is None else 100 * np.nanmean(inside, axis=1)
        return {
            "mean mm": float(np.nanmean(distance)),
            "median": float(np.nanmedian(distance)),
            "p95": float(np.nanpercentile(distance, 95)),
            "acc m/s²": float(np.nanmean(second)),
            **{f"{k + 1} σ %": None if shares is None else float(shares[k]) for k in range(3)},
            "answered %": 100 * float(np.isfinite(distance).sum() / judged.sum()),
            "ms/frame": 1000.0 * self.seconds / len(judged),
        }


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


if __name__ == "__main__":
    lab.main(__doc__, sequences)
