"""Time per pose and accuracy of SkelSplat and other triangulations, on the same simulated detections.

    python benchmarks/compare.py [--poses 300] [--noise good|noisy|occluded2|occluded3] [--takes 4]

Six simulated motions seen by four cameras in a Human3.6M-like room. Everything runs on one core. The
accuracy is over all poses; the time is the best of repeated runs, for slow methods on every k-th pose (the
column "timed on" has their number). Accuracy counts the joints that at least two views see, the same for
every method; "missing" is the share of these without a position. ``paper`` and its closed form start from DLT
weighted by confidence.

The second table compares methods that smooth single frames with solving all frames together, on the simulated
recordings of ``sequences.py``: errors of their detections last, and there are no confidences. The speed lines
of ``speed.py`` follow.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import _one_core  # noqa: F401  before numpy
import common
import numpy as np
import over_time
import recordings
import sequences
import speed
from opencv_dlt import opencv_dlt
from scipy_cauchy import scipy_cauchy

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
_CONDITIONS = {"occluded2": "occluded 2", "occluded3": "occluded 3"}  # of recordings, by --noise; else good

# A run that takes longer is timed on fewer poses.
_LONGEST_RUN_S = 1.0


def brief(number: float) -> str:
    """Write a positive number with at least two significant digits and no exponent above 1e-4."""
    return f"{number:.0f}" if number >= 100 else f"{number:.2g}"


@dataclass(frozen=True)
class Row:
    """The results of one method: lengths in mm, share from 0 to 1."""

    name: str
    ms_per_pose: float
    mean: float
    median: float
    p90: float
    missing: float
    timed_on: int

    def cells(self, default_ms: float) -> list[str]:
        """Return the row as text, its time also as a multiple of the default's."""
        return [
            self.name,
            brief(self.ms_per_pose),
            brief(self.ms_per_pose / default_ms),
            *(f"{value:.1f}" for value in (self.mean, self.median, self.p90)),
            f"{100 * self.missing:.1f}",
            str(self.timed_on),
        ]


def others(scene: common.Scene, crop_scale: np.ndarray) -> dict[str, Method]:
    """Return the other methods: name → poses of some frames."""
    rig, found = scene.rig, scene.detections
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
    }


def ours(scene: common.Scene) -> dict[str, Method]:
    """Return the SkelSplat methods: ``paper`` and its closed form from weighted DLT, then the default."""

    def from_dlt(frames: slice, **fields: object) -> np.ndarray:
        found = scene.detections[frames]
        start = sk.triangulate(found, scene.rig, method="dlt")
        config = sk.RefineConfig.paper(n_threads=1, **fields)
        return sk.refine(start, found, scene.rig, layout="h36m17", config=config).pose

    default = sk.RefineConfig(n_threads=1)
    return {
        "SkelSplat, paper": from_dlt,
        "SkelSplat, closed form, Adam": lambda f: from_dlt(f, renderer="closed_form"),
        "SkelSplat, default": lambda f: (
            sk.refine(None, scene.detections[f], scene.rig, layout="h36m17", config=default).pose
        ),
    }


def anipose(scene: common.Scene) -> dict[str, Method]:
    """Return aniposelib's methods, if it is installed."""
    try:
        import cv2
        from aniposelib.cameras import Camera, CameraGroup
    except ImportError:
        return {}
    group = CameraGroup(
        [Camera(matrix=c.K, rvec=cv2.Rodrigues(c.R)[0].ravel(), tvec=c.t, size=c.size) for c in scene.rig]
    )

    def run(call: Callable[..., np.ndarray], frames: slice) -> np.ndarray:
        found = scene.detections[frames, ..., :2]
        points = np.ascontiguousarray(np.moveaxis(found, 1, 0)).reshape(len(scene.rig), -1, 2)
        return np.asarray(call(points)).reshape(len(found), -1, 3)

    return {
        "DLT, aniposelib": lambda f: run(group.triangulate, f),
        "RANSAC, aniposelib": lambda f: run(lambda p: group.triangulate_ransac(p)[0], f),
    }


def crop_scales(scene: common.Scene) -> np.ndarray:
    """Return pixels of the image per pixel of a 384 px crop around the true person, (T, M)."""
    pixels = sk.project(scene.truth, scene.rig).swapaxes(0, 1)
    return np.ptp(pixels, axis=2).max(axis=-1) / 384.0


def measure(name: str, method: Method, scene: common.Scene, repeat: int) -> Row:
    """Run one method on every pose for its accuracy, then repeatedly for its time."""
    method(slice(0, 1))  # imports and compiles what it needs
    begun = time.perf_counter()
    points = method(slice(None))
    every = int(np.ceil((time.perf_counter() - begun) / _LONGEST_RUN_S))
    timed = slice(None, None, every)
    timed_on = len(scene.truth[timed])
    best = common.seconds(lambda: method(timed), repeat)
    judged = (scene.detections[..., 2] > 0).sum(axis=1) >= 2
    errors = sk.metrics.mpjpe(points, scene.truth, reduce="none")[judged]
    missing = np.isnan(errors)
    found = errors[~missing]
    return Row(
        name,
        1e3 * best / timed_on,
        float(found.mean()),
        float(np.median(found)),
        float(np.percentile(found, 90)),
        float(missing.mean()),
        timed_on,
    )


def compared(scene: common.Scene, repeat: int) -> tuple[list[Row], list[str]]:
    """Measure every method; return the rows, SkelSplat's default last, and notes on unavailable methods."""
    rows, notes = [], []
    for name, method in {**others(scene, crop_scales(scene)), **ours(scene)}.items():
        try:
            rows.append(measure(name, method, scene, repeat))
        except ImportError as error:
            notes.append(f"{name}: left out, {error}")
    return rows, notes


def show_recordings(options: argparse.Namespace) -> list[str]:
    """Print the table of recordings; return notes on unavailable methods."""
    condition = _CONDITIONS.get(options.noise, "good")
    takes = [
        sequences.without_confidence(take)
        for take in recordings.takes(
            condition, count=options.takes, seed=options.seed, most_frames=options.frames
        )
    ]
    absent = {name: over_time.absent(name) for name in _RECORDED}
    results = sequences.measured(takes, [name for name, reason in absent.items() if reason is None])
    rows = []
    for name, errors in results.items():
        found = errors.whole()
        lengths = [f"{found[key]:.1f}" for key in ("mean_mm", "median_mm", "p95_mm", "acceleration_m_s2")]
        rows.append([_RECORDED[name], brief(found["ms_per_frame"]), *lengths])
    n_frames = sum(len(take.scene.truth) for take in takes)
    common.show(
        f"{len(takes)} recordings, {n_frames} frames at 30 Hz, simulated detections '{condition}', one core",
        ["method", "ms/frame", "mean mm", "median", "p95", "acc m/s²"],
        rows,
        markdown=options.markdown,
    )
    return [f"{_RECORDED[name]}: left out, {reason}" for name, reason in absent.items() if reason is not None]


def only_one_core() -> None:
    """Restrict OpenCV to one core too: it ignores the variables used by NumPy."""
    try:
        import cv2
    except ImportError:
        return
    cv2.setNumThreads(1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--poses", type=int, default=300, help="poses compared (300)")
    parser.add_argument("--noise", choices=common.NOISE, default="good", help="simulated detections (good)")
    parser.add_argument("--takes", type=int, default=4, help="recordings compared, 0: none (4)")
    parser.add_argument("--frames", type=int, default=100, help="the middle F frames of longer takes (100)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--repeat", type=int, default=5, help="runs of which the best time counts (5)")
    parser.add_argument("--batch", type=int, default=1000, help="poses of the speed lines (1000)")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    options = parser.parse_args()
    only_one_core()
    scene = common.simulated(options.poses, noise=common.NOISE[options.noise], seed=options.seed)
    rows, notes = compared(scene, options.repeat)
    common.show(
        f"{len(scene.truth)} poses, 17 joints, simulated detections '{options.noise}', one core",
        ["method", "ms/pose", "× default", "mean mm", "median", "p90", "missing %", "timed on"],
        [row.cells(rows[-1].ms_per_pose) for row in rows],
        markdown=options.markdown,
    )
    if options.takes > 0:
        notes += show_recordings(options)
    for note in notes:
        print(note)
    speed.show(options.batch, options.repeat, markdown=options.markdown)
    print(common.circumstances())


if __name__ == "__main__":
    main()
