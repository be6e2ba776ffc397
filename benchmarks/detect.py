"""How far the poses of another detector lie from those of OpenPose, on the recording in the package.

Usage, with the recording's videos (Pose2Sim's demo has them; here ``../shared/data/pose2sim_demo/videos``)::

    skelsplat detect ../shared/data/pose2sim_demo/videos -o pose
    python benchmarks/detect.py pose

Both are solved over time. Printed is the distance between both poses of a joint, in mm, median over the
frames. It is a distance between detectors, which place joints differently, and no error.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import lab
import numpy as np
from lab import Table

from skelsplat.io import sample
from skelsplat.run import Job, run

JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "heel")


def solved(calibration: Path, detections: Path, layout: str | None) -> dict[str, np.ndarray]:
    """Return the paths of the joints (T, 3), in mm."""
    found = run(Job(calibration, detections, unit=sample.UNIT, layout=layout, fps=60.0))
    poses = found.poses.in_unit("mm")
    return dict(zip(poses.joint_names, poses.pose.swapaxes(0, 1), strict=True))


def detect(folder: Path) -> Table:
    """Compare the detections in a folder with OpenPose's."""
    with tempfile.TemporaryDirectory() as temporary:
        paths = sample.extract(Path(temporary))
        reference = solved(paths.calibration, paths.detections, sample.LAYOUT)
        other = solved(paths.calibration, folder, None)
    rows = {
        joint: {
            side: float(np.nanmedian(np.linalg.norm(reference[name] - other[name], axis=1)))
            for side in ("left", "right")
            for name in [f"{side}_{joint}"]
        }
        for joint in JOINTS
        if f"left_{joint}" in other  # COCO has no heels
    }
    return Table.of("distance of the joints of two detectors, mm", "joint", rows, digits=0)


if __name__ == "__main__":
    lab.main(__doc__, detect)
