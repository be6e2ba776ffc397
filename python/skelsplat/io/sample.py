"""The recordings that ship with the package.

A balancing person, 100 frames at 60 frames per second, 4 calibrated cameras (metres, z up), OpenPose BODY_25B
detections; a bystander stands in the first two views. And the same with a second person, whom Pose2Sim added
by calculation. From Pose2Sim, BSD-3-Clause.
"""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from skelsplat._atomic import opening

LAYOUT = "body25b"
UNIT = "m"
FRAME_RATE_HZ = 60.0


@dataclass(frozen=True)
class SamplePaths:
    """Where the sample was unpacked: the calibration file and the folder of the detections' folders."""

    calibration: Path
    detections: Path


def extract(folder: str | os.PathLike[str], *, people: bool = False) -> SamplePaths:
    """Unpack the sample, or that with two people, into `folder`, made if missing.

    ``Calib.toml``, ``openpose/camNN_json/*.json`` and the licence; files of these names are overwritten.
    """
    target = Path(folder)
    archive = resources.files("skelsplat.data").joinpath(f"pose2sim_{'people' if people else 'demo'}.zip")
    writing = opening(target, "a folder that can be written", "folder")
    with writing, archive.open("rb") as stream, zipfile.ZipFile(stream) as packed:
        packed.extractall(target)
    return SamplePaths(target / "Calib.toml", target / "openpose")
