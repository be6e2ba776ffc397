"""Writing a rig as Anipose TOML."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.io._atomic import atomic_write_text
from skelsplat.io.calibration._rotation import vector_from_matrix

if TYPE_CHECKING:
    import os

    import skelsplat as sk


def write_calibration(path: str | os.PathLike[str], rig: sk.CameraRig) -> None:
    """Write `rig` as Anipose TOML, which Pose2Sim, FreeMoCap and Caliscope also read.

    Numbers are written with all their digits. Reading the file back gives the same rig; only rotations,
    stored as three numbers in this format, may differ in the last digit, and a camera without distortion
    comes back with zeros. The unit is noted under ``metadata``, where readers of this format do not look: it
    must be given again on reading.

    Parameters
    ----------
    path : path
        File to write; replaced whole or, on an error, left as it was.
    rig : CameraRig

    Raises
    ------
    DatasetError
        If the path cannot be written.
    """
    digits = len(str(len(rig) - 1))  # equal lengths, because Anipose sorts tables by name
    tables = [_table(f"cam_{index:0{digits}d}", camera) for index, camera in enumerate(rig)]
    metadata = f'[metadata]\nadjusted = false\nerror = 0.0\nunit = "{rig.unit}"\n'
    atomic_write_text(path, "\n".join([*tables, metadata]))


def _table(key: str, camera: sk.Camera) -> str:
    distortion = [] if camera.distortion is None else np.asarray(camera.distortion).tolist()
    width, height = camera.size
    entries = {
        "name": json.dumps(camera.name or key, ensure_ascii=False),
        "size": f"[{width}, {height}]",
        "matrix": repr(np.asarray(camera.K).tolist()),
        "distortions": repr(distortion or [0.0] * 4),
        "rotation": repr(vector_from_matrix(np.asarray(camera.R)).tolist()),
        "translation": repr(np.asarray(camera.t).tolist()),
        "fisheye": str(bool(camera.fisheye)).lower(),
    }
    return "".join([f"[{key}]\n", *(f"{name} = {value}\n" for name, value in entries.items())])
