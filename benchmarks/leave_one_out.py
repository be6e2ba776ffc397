"""Each camera of the real recording in the package, predicted from the other three.

    python benchmarks/leave_one_out.py

Poses are computed without the camera and projected into it; the error is the distance to what OpenPose
detected there, px, over the detections that every method predicts. It contains the errors of these detections
and of the calibration, which no method can predict: the differences count, not the level. In the second table
`skelsplat.adjust_cameras` has set cam_03 right. acc: median length of a predicted track's second difference,
px.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import lab
import numpy as np
import recordings
from lab import Table
from recordings import Take
from scenarios import Scene

import skelsplat as sk
from skelsplat.association import choose_person
from skelsplat.io import read_calibration, read_detections, sample

METHODS = ("frames", "butterworth", "sequence")


def recording() -> Scene:
    """Read the balancing person: 100 frames, 25 joints, no truth."""
    with tempfile.TemporaryDirectory() as folder:
        paths = sample.extract(Path(folder))
        rig = read_calibration(paths.calibration, unit=sample.UNIT)
        found = read_detections(paths.detections, rig, layout=sample.LAYOUT)
    detections, _ = choose_person(found.people, rig)
    unknown = np.full((len(detections), detections.shape[2], 3), np.nan)
    return Scene(unknown, detections, rig, sample.LAYOUT, "real detections: OpenPose, Pose2Sim's demo")


def predicted(scene: Scene, what: str) -> Table:
    """Return the table of a row per camera and method."""
    rows = {}
    for view, camera in enumerate(scene.rig):
        others = [i for i in range(len(scene.rig)) if i != view]
        rig = sk.CameraRig([scene.rig[i] for i in others], unit=scene.rig.unit)
        rest = replace(scene, rig=rig, detections=scene.detections[:, others])
        take, own = Take("", rest, sample.FRAME_RATE_HZ), scene.detections[:, view]
        seen = np.where(own[..., 2:] > 0, own[..., :2], np.nan)
        pixels = {name: sk.project(recordings.METHODS[name](take).pose, [camera])[0] for name in METHODS}
        errors = {name: np.linalg.norm(found - seen, axis=-1) for name, found in pixels.items()}
        by_all = np.isfinite(list(errors.values())).all(axis=0)
        for name, found in pixels.items():
            error = errors[name][by_all]
            second = np.linalg.norm(np.diff(found, n=2, axis=0), axis=-1)
            rows[f"{camera.name}, {name}"] = {
                "mean px": float(error.mean()),
                "median": float(np.median(error)),
                "90 %": float(np.percentile(error, 90)),
                "acc": float(np.nanmedian(second)),
                "detections": int(by_all.sum()),
            }
    return Table.of(f"{scene.source}; {what}", "predicted from the others", rows)


def leave_one_out() -> Iterator[Table]:
    """Predict every camera, before and after one is rotated."""
    scene = recording()
    yield predicted(scene, "calibration as it is")
    found = sk.adjust_cameras(scene.detections, scene.rig, free=["cam_03"])
    (camera,) = found.of("adjusted")
    yield predicted(replace(scene, rig=found.cameras), f"cam_03 adjusted, turned by {camera.degrees:.2f}°")


if __name__ == "__main__":
    lab.main(__doc__, leave_one_out)
