"""OpenPose folders: one folder per camera, one JSON file per frame.

``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}``, pixels of the original image; x = y = c = 0 marks a
joint that was not detected. The frame number is the last integer in the file's name.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import skelsplat as sk
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import read_text
from skelsplat.io.detections._detection_set import DetectionSet
from skelsplat.io.detections._match import common_frames, match_folders

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence
    from typing import TypeAlias

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]
    View: TypeAlias = dict[int, list[Array]]

FrameMode = Literal["strict", "intersection", "union"]
_FRAME_MODES = ("strict", "intersection", "union")
_FIELD = "pose_keypoints_2d"


def read_openpose(
    folder: str | os.PathLike[str],
    cameras: sk.CameraRig | Sequence[sk.Camera] | Sequence[str],
    *,
    layout: str | sk.Layout | None = None,
    frames: FrameMode = "strict",
    allow_missing: bool = False,
) -> DetectionSet:
    """Read the detections of all cameras from the folders beneath `folder`.

    Parameters
    ----------
    folder : path
        Holds one folder per camera, named like it (``cam01_json`` goes with ``cam_01``).
    cameras : CameraRig, sequence of Camera or of names
        Gives the views and their order. Cameras must have names.
    layout : str or Layout
        What the K joints are. It must be given: a count of joints does not say which they are.
    frames : {"strict", "intersection", "union"}
        ``strict`` asks for the same frame numbers in all folders, ``intersection`` reads those that all have,
        ``union`` reads every frame and leaves gaps as missing detections.
    allow_missing : bool
        Accept cameras without a folder; their detections are missing.

    Returns
    -------
    DetectionSet
        ``people`` (T, M, P, K, 3), P the largest number of people in any image (at least 1).

    Raises
    ------
    InvalidInputError
        If `layout` is missing (the message names those that fit), `frames` is unknown or a camera has no
        name.
    DatasetError
        If a folder or file is missing or malformed; names the file and the field.
    """
    if frames not in _FRAME_MODES:
        raise InvalidInputError(f"frames: expected one of {', '.join(_FRAME_MODES)}, got {frames!r}")
    root = Path(folder)
    sources = match_folders(root, _camera_names(cameras), allow_missing=allow_missing)
    files = {name: _frame_files(source) for name, source in sources.items() if source is not None}
    counts = {str(source.name): list(files[name]) for name, source in sources.items() if source is not None}
    numbers = common_frames(root, counts, frames)
    chosen = _check_layout(layout, files)
    views = [_read_view(files.get(name, {}), numbers.tolist(), chosen) for name in sources]
    return DetectionSet(
        people=_stack(views, numbers.tolist(), chosen.n_joints),
        frames=numbers,
        camera_names=tuple(sources),
        sources=tuple(sources.values()),
        layout=chosen.name,
    )


def _camera_names(cameras: Sequence[sk.Camera] | Sequence[str]) -> list[str]:
    names = [camera if isinstance(camera, str) else camera.name for camera in cameras]
    named = [name for name in names if name]
    if isinstance(cameras, str) or not named or len(set(named)) < len(names):
        raise InvalidInputError(f"cameras: expected cameras with different names, got {names}")
    return named


def _frame_files(folder: Path) -> dict[int, Path]:
    """JSON files of a folder by frame number, ascending."""
    files: dict[int, Path] = {}
    for path in sorted(folder.glob("*.json")):
        digits = re.findall(r"\d+", path.stem)
        if not digits:
            raise DatasetError(path, "file name", "a frame number in it", f"{path.name!r}")
        number = int(digits[-1])
        if number in files:
            expected = f"one file for frame {number} (the last integer in the name)"
            raise DatasetError(path, "file name", expected, f"also {files[number].name}")
        files[number] = path
    if not files:
        raise DatasetError(folder, "files", "one JSON file per frame", "no .json files")
    return dict(sorted(files.items()))


def _check_layout(layout: str | sk.Layout | None, files: Mapping[str, Mapping[int, Path]]) -> sk.Layout:
    if layout is None:
        raise InvalidInputError(
            f"layout: expected the name of a joint layout, got none; {_layout_hint(files)}"
        )
    return sk.layouts.get(layout) if isinstance(layout, str) else layout


def _layout_hint(files: Mapping[str, Mapping[int, Path]]) -> str:
    """Say which layouts fit the first person in the files."""
    for path in (path for view in files.values() for path in view.values()):
        for index, person in enumerate(_people(path)):
            joints = _values(path, index, person).size // 3
            return f"{path} has {joints} joints per person: {_layouts_of(joints)}"
    return "the files hold no person to count joints of"


def _layouts_of(joints: int) -> str:
    """Names of the known layouts with that many joints, as a phrase."""
    fitting = [name for name in sk.layouts.names if sk.layouts.get(name).n_joints == joints]
    return " or ".join(fitting) if fitting else "no known layout, so pass a Layout of your own"


def _read_view(files: Mapping[int, Path], numbers: Sequence[int], layout: sk.Layout) -> View:
    """People of each frame in `numbers` that the camera has a file for, each (K, 3)."""
    return {number: _read_frame(files[number], layout) for number in numbers if number in files}


def _read_frame(path: Path, layout: sk.Layout) -> list[Array]:
    return [_read_person(path, index, person, layout) for index, person in enumerate(_people(path))]


def _people(path: Path) -> list[Any]:
    text = read_text(path)
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        at = f"{error.msg.lower()} at character {error.pos} of {len(text)}"
        raise DatasetError(path, "JSON", "a complete JSON document", at) from error
    except RecursionError:
        raise DatasetError(path, "JSON", "an OpenPose document", "lists nested too deeply") from None
    if not isinstance(document, dict) or "people" not in document:
        raise DatasetError(path, "people", "an object with a list under this key", type(document).__name__)
    people = document["people"]
    if not isinstance(people, list):
        raise DatasetError(path, "people", "a list", type(people).__name__)
    return people


def _read_person(path: Path, index: int, person: object, layout: sk.Layout) -> Array:
    """Return one person (K, 3); joints that were not detected are NaN."""
    flat = _values(path, index, person)
    if flat.size != 3 * layout.n_joints:
        expected = f"3·{layout.n_joints} = {3 * layout.n_joints} numbers (layout {layout.name})"
        actual = f"{flat.size} (3·{flat.size // 3}: {_layouts_of(flat.size // 3)})"
        raise DatasetError(path, f"people[{index}].{_FIELD}", expected, actual)
    joints = flat.reshape(-1, 3)
    joints[~np.isfinite(joints).all(axis=1) | (joints[:, 2] == 0.0)] = np.nan
    wrong = (joints[:, 2] < 0.0) | (joints[:, 2] > 1.0)
    if wrong.any():
        joint = int(np.argmax(wrong))
        field = f"people[{index}].{_FIELD}[{3 * joint + 2}]"
        raise DatasetError(path, field, "a confidence in [0, 1]", f"{joints[joint, 2]:g}")
    return joints


def _values(path: Path, index: int, person: object) -> Array:
    """Return the flat list of numbers of a person; its length is a multiple of three."""
    field = f"people[{index}].{_FIELD}"
    if not isinstance(person, dict) or _FIELD not in person:
        raise DatasetError(path, field, "a list of numbers x, y, confidence", "nothing (the key is missing)")
    values = person[_FIELD]
    if not isinstance(values, list):
        raise DatasetError(path, field, "a list of numbers", type(values).__name__)
    for place, value in enumerate(values):
        if isinstance(value, bool) or not isinstance(value, int | float) or math.isinf(value):
            raise DatasetError(path, f"{field}[{place}]", "a number", repr(value)[:40])
    if len(values) % 3 or not values:
        raise DatasetError(path, field, "three numbers per joint", f"{len(values)} numbers")
    return np.array(values, dtype=np.float64)


def _stack(views: Sequence[View], numbers: Sequence[int], n_joints: int) -> Array:
    """Join the views to (T, M, P, K, 3), padded with NaN."""
    places = max([1, *(len(people) for view in views for people in view.values())])
    stacked = np.full((len(numbers), len(views), places, n_joints, 3), np.nan)
    for m, view in enumerate(views):
        for t, number in enumerate(numbers):
            for p, person in enumerate(view.get(number, [])):
                stacked[t, m, p] = person
    return stacked
