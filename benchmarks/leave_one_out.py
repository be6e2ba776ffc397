"""Each camera of the real recording in the package, predicted from the other three.

    python benchmarks/leave_one_out.py [--markdown]

Poses are computed without the camera and projected into it; the error is the distance to what OpenPose
detected there, px, over the detections that every method predicts. It contains the errors of these detections
and of the calibration, which no method can predict: the differences count, not the level. The first table has
the calibration as it is; in the second cam_03 is rotated to where the other cameras put its detections, as
`skelsplat check-cameras` recommends. acc: median length of a predicted track's second difference, px.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import _one_core  # noqa: F401  before numpy
import common
import numpy as np
import over_time
from recordings import Take
from scenarios import FloatArray, Scene

import skelsplat as sk
from skelsplat.association import choose_person
from skelsplat.io import read_calibration, read_openpose, sample

METHODS = ("frames", "butterworth", "sequence")
# Residuals above this count less when the camera is rotated, px.
_SOFT_PX = 10.0


def recording() -> Scene:
    """Read the balancing person: 100 frames, 25 joints, no truth."""
    with tempfile.TemporaryDirectory() as folder:
        paths = sample.extract(Path(folder))
        rig = read_calibration(paths.calibration, unit=sample.UNIT)
        found = read_openpose(paths.detections, rig, layout=sample.LAYOUT)
    detections, _ = choose_person(found.people, rig)
    unknown = np.full((len(detections), detections.shape[2], 3), np.nan)
    return Scene(unknown, detections, rig, sample.LAYOUT, "real detections: OpenPose, Pose2Sim's demo")


def without(scene: Scene, view: int) -> Scene:
    """Return the scene of the other cameras."""
    others = [i for i in range(len(scene.rig)) if i != view]
    rig = sk.CameraRig([scene.rig[i] for i in others], unit=scene.rig.unit)
    return replace(scene, rig=rig, detections=scene.detections[:, others])


def seen_by(scene: Scene, view: int) -> FloatArray:
    """Return the pixels (T, N, 2) of a view's detections; NaN where there is none."""
    detections = scene.detections[:, view]
    return np.where(detections[..., 2:] > 0, detections[..., :2], np.nan)


def rotated(scene: Scene, view: int) -> Scene:
    """Rotate a camera about its centre until its detections fit the poses from the other cameras."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    camera, seen = scene.rig[view], seen_by(scene, view)
    pose = over_time.frames(Take("", without(scene, view), sample.FRAME_RATE_HZ)).pose
    known = np.isfinite(seen).all(axis=-1) & np.isfinite(pose).all(axis=-1)

    def turned(vector: FloatArray) -> sk.Camera:
        turn = Rotation.from_rotvec(vector).as_matrix()
        return sk.Camera(
            camera.K,
            turn @ camera.R,
            turn @ camera.t,
            size=camera.size,
            distortion=camera.distortion,
            name=camera.name,
        )

    def residuals(vector: FloatArray) -> FloatArray:
        return (sk.project(pose[known], [turned(vector)])[0] - seen[known]).ravel()

    vector = least_squares(residuals, np.zeros(3), loss="cauchy", f_scale=_SOFT_PX).x
    cameras = [turned(vector) if i == view else other for i, other in enumerate(scene.rig)]
    print(f"{camera.name} rotated by {np.degrees(np.linalg.norm(vector)):.2f}°")
    return replace(scene, rig=sk.CameraRig(cameras, unit=scene.rig.unit))


def rows(scene: Scene) -> list[list[str]]:
    """Return a row per camera and method."""
    out = []
    for view, camera in enumerate(scene.rig):
        take = Take("", without(scene, view), sample.FRAME_RATE_HZ)
        predicted = {name: sk.project(over_time.METHODS[name](take).pose, [camera])[0] for name in METHODS}
        seen = seen_by(scene, view)
        errors = {name: np.linalg.norm(pixels - seen, axis=-1) for name, pixels in predicted.items()}
        by_all = np.isfinite(list(errors.values())).all(axis=0)
        for name, pixels in predicted.items():
            error = errors[name][by_all]
            second = np.linalg.norm(np.diff(pixels, n=2, axis=0), axis=-1)
            figures = (error.mean(), *np.percentile(error, (50, 90)), np.nanmedian(second))
            out.append([f"{camera.name}, {name}", *(f"{x:.1f}" for x in figures), str(by_all.sum())])
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print Markdown tables")
    markdown = parser.parse_args().markdown
    columns = ["predicted from the others", "mean px", "median", "90 %", "acc", "detections"]
    scene = recording()
    common.show(f"{scene.source}; calibration as it is", columns, rows(scene), markdown=markdown)
    scene = rotated(scene, scene.rig.names.index("cam_03"))
    common.show(f"{scene.source}; cam_03 rotated", columns, rows(scene), markdown=markdown)
    print(common.circumstances())


if __name__ == "__main__":
    main()
