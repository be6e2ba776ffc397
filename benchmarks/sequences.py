"""Recordings solved frame by frame, smoothed, and over time: errors, accelerations and error bars.

    python benchmarks/sequences.py [--takes 12] [--views 4] [--fps 30] [--conditions heavy]

Motions of the CMU motion capture in a Human3.6M-like room; the detections are simulated, with errors that
last (`skelsplat.synthetic.Memory`), and all methods get the same. `--takes` is a spread sample of 92 takes
(all), `--names` one of them, such as 05_17, and `--frames` the middle part of longer ones. Conditions: good,
occluded 2, occluded 3, heavy. The methods get no confidences: simulated ones know too well what is hidden.
Names, conditions and methods may be repeated.

mean, median, p95: distance to the truth, mm, of the joints that at least two views detect; `answered` is the
share of these with a position. acc: mean length of the error's second difference times fps², m/s². 1 σ, 2 σ,
3 σ: share of the errors inside the error bars (Mahalanobis distance); 19.9, 73.9 and 97.1 % are meant.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import lab
import numpy as np
import recordings
from lab import Table
from recordings import Take

import skelsplat as sk

# Without those of another library.
USUAL = tuple(name for name in recordings.METHODS if not name.startswith("anipose"))


def measured(takes: Sequence[Take], name: str) -> dict[str, float | None]:
    """Return what a method does wrong in all takes of a condition, over the joints that are judged."""
    errors, second, inside, judged = [], [], [], 0
    for take in takes:
        truth, solved = take.scene.judged, recordings.METHODS[name](take)
        error = solved.pose - truth
        judged += int(np.isfinite(truth[..., 0]).sum())
        errors.append(np.linalg.norm(error, axis=-1).ravel())
        second.append(np.linalg.norm(np.diff(error, n=2, axis=0), axis=-1).ravel() * take.fps**2 / 1000.0)
        if solved.covariance is not None:
            three = sk.metrics.sigma_coverage(solved.pose, solved.covariance, truth, reduce="none")
            inside.append(np.reshape(three, (3, -1)))
    distance = np.concatenate(errors)
    shares = 100 * np.nanmean(np.concatenate(inside, axis=1), axis=1) if inside else (None,) * 3
    return {
        "mean mm": float(np.nanmean(distance)),
        "median": float(np.nanmedian(distance)),
        "p95": float(np.nanpercentile(distance, 95)),
        "acc m/s²": float(np.nanmean(np.concatenate(second))),
        **{f"{k} σ %": share for k, share in enumerate(shares, 1)},
        "answered %": 100 * float(np.isfinite(distance).sum() / judged),
    }


def sequences(
    *,
    takes: int | None = None,
    names: tuple[str, ...] = (),
    frames: int | None = None,
    views: int = 4,
    fps: int = 30,
    conditions: tuple[str, ...] = recordings.CONDITIONS,
    methods: tuple[str, ...] = USUAL,
    seed: int = 0,
) -> Iterator[Table]:
    """Compare methods on recordings."""
    for condition in conditions:
        given = {"count": takes, "names": names or None, "most_frames": frames, "confidence": False}
        found = recordings.takes(condition, n_views=views, fps=fps, seed=seed, **given)
        n_frames = sum(len(take.scene.truth) for take in found)
        title = f"{condition}: {views} views, {fps} Hz, {n_frames} frames, simulated detections"
        yield Table.of(title, "method", {name: measured(found, name) for name in methods})


if __name__ == "__main__":
    lab.main(__doc__, sequences)
