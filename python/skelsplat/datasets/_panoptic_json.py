"""The panoptic-toolbox's JSON: calibration and 3D poses, cm → mm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import FloatArray, load_json, numbers, require, within
from skelsplat.datasets._rig import read_quietly
from skelsplat.exceptions import DatasetError
from skelsplat.io import convert_unit
from skelsplat.layouts import PANOPTIC19

_MM = 10.0
# A joint with less confidence is no measurement; the toolbox writes −1 where there is none at all.
_LEAST_CONFIDENCE = 0.1


def camera_name(number: int) -> str:
    """Return the name of an HD camera: panel 0, node `number`."""
    return f"00_{number:02d}"


def read_cameras(path: Path, chosen: Sequence[int]) -> CameraRig:
    """Return the HD cameras with these numbers, in this order, mm.

    Raises
    ------
    DatasetError
        If a camera is missing or its values make no camera.
    """
    rig = convert_unit(read_quietly(path, "panoptic", camera_type="hd"), "mm")
    names = [camera_name(number) for number in chosen]
    for name in names:
        if name not in rig.names:
            raise DatasetError(path, "cameras", f"HD camera {name}", f"only {', '.join(sorted(rig.names))}")
    return CameraRig([rig[name] for name in names], rig.unit)


def truth_files(folder: Path) -> dict[int, Path]:
    """Return the file of each frame, ascending."""
    files = {}
    for path in sorted(folder.glob("body3DScene_*.json")):
        number = path.stem.removeprefix("body3DScene_")
        if not number.isdigit():
            raise DatasetError(path, "file name", "body3DScene_ and a frame number", path.name)
        files[int(number)] = path
    if not files:
        raise DatasetError(folder, "files", "body3DScene_%08d.json", "none")
    return dict(sorted(files.items()))


def read_bodies(files: Mapping[int, Path], person: int | None) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the frames (T,) with the person in them and the joints (T, 19, 3), mm; NaN where not measured.

    `person` None is the only body that there is.

    Raises
    ------
    DatasetError
        If a file is malformed, or has several bodies and none is chosen.
    """
    bodies = {frame: _bodies(path) for frame, path in files.items()}
    seen = Counter(name for there in bodies.values() for name in there)
    if person is None and len(seen) > 1:
        path = next(
            files[frame] for frame, there in bodies.items() if set(there) != {next(iter(seen))} and there
        )
        raise DatasetError(
            path, "bodies", "one person (choose one by id)", f"ids {', '.join(map(str, seen))}"
        )
    chosen = person if person is not None else next(iter(seen), -1)
    frames = [frame for frame, there in bodies.items() if chosen in there]
    if not frames:
        path = next(iter(files.values()))
        raise DatasetError(
            path.parent, "bodies", f"person {chosen}", f"ids {', '.join(map(str, seen)) or 'none'}"
        )
    return np.array(frames, dtype=np.int64), np.stack([bodies[frame][chosen] for frame in frames])


def _bodies(path: Path) -> dict[int, FloatArray]:
    found = {}
    for k, body in enumerate(require(path, "", load_json(path), "bodies")):
        field = f"bodies[{k}]"
        values = require(path, field, body, "joints19")
        count = len(values) if isinstance(values, list) else 0
        expected = f"4·{PANOPTIC19.n_joints} numbers (x, y, z, c of 19 joints)"
        if count != 4 * PANOPTIC19.n_joints:
            raise DatasetError(path, within(field, "joints19"), expected, f"{count} numbers")
        flat = numbers(path, within(field, "joints19"), values, (count,))
        joints = flat.reshape(-1, 4)
        measured = joints[:, 3:] > _LEAST_CONFIDENCE
        found[int(require(path, field, body, "id"))] = np.where(measured, _MM * joints[:, :3], np.nan)
    return found
