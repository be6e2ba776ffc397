"""Writing a rig: Anipose TOML for other programs, JSON and npz without loss."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import InvalidInputError
from skelsplat.io._atomic import atomic_write, atomic_write_text
from skelsplat.io.calibration._own import to_arrays, to_json
from skelsplat.io.calibration._rotation import vector_from_matrix

if TYPE_CHECKING:
    import os

    import skelsplat as sk

WRITTEN = {".toml": "anipose", ".json": "json", ".npz": "npz"}


def write_calibration(path: str | os.PathLike[str], rig: sk.CameraRig, *, format: str | None = None) -> None:
    """Write `rig` as Anipose TOML, which Pose2Sim, FreeMoCap and Caliscope also read, or as JSON or npz.

    Numbers are written with all their digits. JSON and npz give the same rig back. So does TOML but for two
    things: rotations, stored as three numbers in this format, may differ in the last digit, and a camera
    without distortion comes back with zeros. TOML has no place for the unit: it is noted under ``metadata``,
    where this package looks and other programs do not. Pose2Sim takes metres, FreeMoCap millimetres
    (`convert_unit`).

    Parameters
    ----------
    path : path
        File to write; replaced whole or, on an error, left as it was.
    rig : CameraRig
    format : {"anipose", "json", "npz"}, optional
        Found from the suffix (``.toml``, ``.json``, ``.npz``) when left out.

    Raises
    ------
    InvalidInputError
        If the format is unknown, or left out with another suffix.
    DatasetError
        If the path cannot be written.
    """
    suffix = Path(path).suffix.lower()
    chosen = WRITTEN.get(suffix) if format is None else format
    if chosen not in WRITTEN.values():
        expected = f"one of {', '.join(WRITTEN.values())}, or a path in {', '.join(WRITTEN)}"
        raise InvalidInputError(f"format: expected {expected}, got {format or suffix or 'no suffix'!r}")
    if chosen == "npz":
        with atomic_write(path) as stream:
            np.savez(stream, **to_arrays(rig))
    else:
        atomic_write_text(path, to_json(rig) if chosen == "json" else _toml(rig))


def convert_unit(rig: sk.CameraRig, unit: str) -> sk.CameraRig:
    """Return the same cameras with lengths in another unit.

    Raises
    ------
    InvalidInputError
        If the unit is not mm, cm or m.
    """
    import skelsplat as sk
    from skelsplat.cameras import MM_PER_UNIT

    if unit not in MM_PER_UNIT:
        raise InvalidInputError(f'unit: expected "mm", "cm" or "m", got {unit!r}')
    factor = rig.mm_per_unit / MM_PER_UNIT[unit]
    cameras = [
        sk.Camera(
            c.K,
            c.R,
            np.asarray(c.t) * factor,
            distortion=c.distortion,
            fisheye=c.fisheye,
            size=c.size,
            name=c.name,
        )
        for c in rig
    ]
    return sk.CameraRig(cameras, unit=unit)


def _toml(rig: sk.CameraRig) -> str:
    digits = len(str(len(rig) - 1))  # equal lengths, because Anipose sorts tables by name
    tables = [_table(f"cam_{index:0{digits}d}", camera) for index, camera in enumerate(rig)]
    metadata = f'[metadata]\nadjusted = false\nerror = 0.0\nunit = "{rig.unit}"\n'
    return "\n".join([*tables, metadata])


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
