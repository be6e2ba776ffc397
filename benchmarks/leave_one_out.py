"""Each camera of the real recording in the package, predicted from the other three.

    python benchmarks/leave_one_out.py

`skelsplat.adjust_cameras` has set cam_03 right. Poses are computed without the camera and projected into it;
the error is the distance to what OpenPose detected there, px, over the detections that every method predicts.
It contains the errors of these detections and of the calibration, which no method can predict: the
differences count, not the level.
"""

from __future__ import annotations

import tempfile
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


def leave_one_out() -> Table:
    """Predict every camera."""
    scene = recording()
    found = sk.adjust_cameras(scene.detections, scene.rig, free=["cam_03"])
    scene, rows = replace(scene, rig=found.cameras), {}
    for view, camera in enumerate(scene.rig):
        others = [i for i in range(len(scene.rig)) if i != view]
        rig = sk.CameraRig([scene.rig[i] for i in others], unit=scene.rig.unit)
        rest = replace(scene, rig=rig, detections=scene.detections[:, others])
        take, own = Take("", rest, sample.FRAME_RATE_HZ), scene.detections[:, view]
        seen = np.where(own[..., 2:] > 0, own[..., :2], np.nan)
        pixels = {name: sk.project(recordings.METHODS[name](take).pose, [camera])[0] for name in METHODS}
        errors = {name: np.linalg.norm(found - seen, axis=-1) for name, found in pixels.items()}
        by_all = np.isfinite(list(errors.values())).all(axis=0)
        for name in pixels:
            error = errors[name][by_all]
            rows[f"{camera.name}, {name}"] = {
                "mean px": float(error.mean()),
                "median": float(np.median(error)),
                "90 %": float(np.percentile(error, 90)),
            }
    (turned,) = found.of("adjusted")
    title = f"{scene.source}; cam_03 turned by {turned.degrees:.2f}°"
    return Table.of(title, "predicted from the others", rows)


if __name__ == "__main__":
    lab.main(__doc__, leave_one_out)
