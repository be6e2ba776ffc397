"""Time per pose and accuracy of SkelSplat and other triangulations, on the same simulated detections.

    python benchmarks/compare.py [--poses 300] [--noise good|noisy|occluded2|occluded3] [--takes 4]

Six simulated motions seen by four cameras in a Human3.6M-like room. Everything runs on one core. The
accuracy is over all poses; the time is the best of repeated runs, for slow methods on every k-th pose (the
column "timed on" has their number). Accuracy counts the joints that at least two views see, the same for
every method; "missing" is the share of these without a position. ``paper`` and its closed form start from DLT
weighted by confidence.

The second table compares methods that smooth single frames with solving all frames together, on `--takes`
simulated recordings of ``sequences.py``, the middle `--frames` of each: errors of their detections last, and
there are no confidences. The speed lines of ``speed.py`` follow.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

import lab
import numpy as np
import over_time
import recordings
import sequences
from lab import ONE_THREAD, Table, brief
from peers import opencv_dlt, scipy_cauchy
from scenarios import Scene, simulated
from speed import speed

import skelsplat as sk
from skelsplat.evaluation import baselines

Method = Callable[[slice], np.ndarray]

# Methods on recordings and their names in the table.
_RECORDED = {
    "frames": "SkelSplat, frame by frame",
    "butterworth": "+ Butterworth filter, 6 Hz",
    "kalman": "+ Kalman smoother per joint",
    "anipose": "triangulate_optim, aniposelib",
    "anipose-tuned": "the same, tuned here",
    "sequence": "SkelSplat, solved over time",
}
_NOISES = {"occluded2": "occluded 2", "occluded3": "occluded 3"}
_DEFAULT = "SkelSplat, default"
# Side of the crop in whose pixels Iskakov's threshold is.
_CROP_PX = 384.0
# A run that takes longer is timed on fewer poses.
_LONGEST_RUN_S = 1.0


def methods(scene: Scene) -> dict[str, Method]:
    """Return all methods, poses of some frames by name; the default last."""
    rig, found = scene.rig, scene.detections
    pixels = sk.project(scene.truth, rig).swapaxes(0, 1)
    crop_scale = np.ptp(pixels, axis=2).max(axis=-1) / _CROP_PX

    def from_dlt(frames: slice, **fields: object) -> np.ndarray:
        start = sk.triangulate(found[frames], rig, method="dlt")
        config = sk.RefineConfig.paper(n_threads=1, **fields)
        return sk.refine(start, found[frames], rig, layout="h36m17", config=config).pose

    return {
        "DLT, NumPy": lambda f: baselines.dlt(found[f], rig),
        "DLT with confidence, NumPy": lambda f: baselines.dlt(found[f], rig, confidence=True),
        "DLT of two views, OpenCV": lambda f: opencv_dlt(found[f], rig),
        "RANSAC of AdaFuse": lambda f: baselines.ransac_adafuse(found[f], rig),
        "RANSAC of Iskakov et al.": lambda f: baselines.ransac_iskakov(
            found[f], rig, crop_scale=crop_scale[f]
        ),
        "Cauchy loss, SciPy": lambda f: scipy_cauchy(found[f], rig),
        "Cauchy loss, NumPy, all joints at once": lambda f: baselines.cauchy(found[f], rig),
        **anipose(scene),
        "SkelSplat, paper": from_dlt,
        "SkelSplat, closed form, Adam": lambda f: from_dlt(f, renderer="closed_form"),
        _DEFAULT: lambda f: sk.refine(None, found[f], rig, layout="h36m17", config=ONE_THREAD).pose,
    }


def anipose(scene: Scene) -> dict[str, Method]:
    """Return aniposelib's methods, if it is installed."""
    try:
        group = over_time.anipose_group(scene.rig)
    except ImportError:
        return {}

    def run(call: Callable[..., np.ndarray], frames: slice) -> np.ndarray:
        found = scene.detections[frames, ..., :2]
        points = np.ascontiguousarray(np.moveaxis(found, 1, 0)).reshape(len(scene.rig), -1, 2)
        return np.asarray(call(points)).reshape(len(found), -1, 3)

    return {
        "DLT, aniposelib": lambda f: run(group.triangulate, f),
        "RANSAC, aniposelib": lambda f: run(lambda p: group.triangulate_ransac(p)[0], f),
    }


def measured(method: Method, scene: Scene, repeat: int) -> dict[str, float]:
    """Run one method on every pose for its accuracy, then repeatedly for its time."""
    method(slice(0, 1))  # imports and compiles what it needs
    begun = time.perf_counter()
    points = method(slice(None))
    every = int(np.ceil((time.perf_counter() - begun) / _LONGEST_RUN_S))
    timed = slice(None, None, every)
    timed_on = len(scene.truth[timed])
    best = lab.seconds(lambda: method(timed), repeat)
    judged = (scene.detections[..., 2] > 0).sum(axis=1) >= 2
    errors = sk.metrics.mpjpe(points, scene.truth, reduce="none")[judged]
    missing = np.isnan(errors)
    found = errors[~missing]
    return {
        "ms/pose": 1e3 * best / timed_on,
        "mean mm": float(found.mean()),
        "median": float(np.median(found)),
        "p90": float(np.percentile(found, 90)),
        "missing %": 100 * float(missing.mean()),
        "timed on": timed_on,
    }


def singles(scene: Scene, noise: str, repeat: int) -> Table:
    """Compare methods frame by frame."""
    rows, notes = {}, []
    for name, method in methods(scene).items():
        try:
            rows[name] = measured(method, scene, repeat)
        except ImportError as error:
            notes.append(f"{name}: left out, {error}")
    default_ms = rows[_DEFAULT]["ms/pose"]
    cells = {}
    for name, row in rows.items():
        ms = row.pop("ms/pose")
        cells[name] = {"ms/pose": brief(ms), "× default": brief(ms / default_ms), **row}
        cells[name] |= {key: f"{row[key]:.1f}" for key in ("mean mm", "median", "p90", "missing %")}
    title = f"{len(scene.truth)} poses, 17 joints, simulated detections '{noise}', one core"
    return Table.of(title, "method", cells, notes)


def in_time(condition: str, takes: int, frames: int, seed: int) -> Table:
    """Compare methods on recordings."""
    found = [
        recordings.unsure(take)
        for take in recordings.takes(condition, count=takes, seed=seed, most_frames=frames)
    ]
    absent = {name: reason for name in _RECORDED if (reason := over_time.absent(name))}
    rows = {}
    for name, errors in sequences.measured(found, [name for name in _RECORDED if name not in absent]).items():
        row = errors.row()
        lengths = {key: row[key] for key in ("mean mm", "median", "p95", "acc m/s²")}
        rows[_RECORDED[name]] = {"ms/frame": brief(row["ms/frame"] or 0.0), **lengths}
    n_frames = sum(len(take.scene.truth) for take in found)
    title = (
        f"{len(found)} recordings, {n_frames} frames at 30 Hz, simulated detections '{condition}', one core"
    )
    notes = [f"{_RECORDED[name]}: left out, {reason}" for name, reason in absent.items()]
    return Table.of(title, "method", rows, notes, digits=1)


def compare(
    *,
    poses: int = 300,
    noise: str = "good",
    takes: int = 4,
    frames: int = 100,
    seed: int = 0,
    repeat: int = 5,
    batch: int = 1000,
) -> Iterator[Table]:
    """Compare methods on poses and on recordings, and measure the speed."""
    with contextlib.suppress(ImportError):
        import cv2

        cv2.setNumThreads(1)  # it ignores the variables used by NumPy
    condition = _NOISES.get(noise, noise)
    yield singles(simulated(poses, noise=condition, seed=seed), noise, repeat)
    if takes > 0:
        yield in_time(condition if condition in recordings.CONDITIONS else "good", takes, frames, seed)
    yield speed(batch=batch, repeat=repeat)


if __name__ == "__main__":
    lab.main(__doc__, compare)
