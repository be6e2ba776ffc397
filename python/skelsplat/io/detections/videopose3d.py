"""VideoPose3D: one npz file for all cameras.

In ``data_2d_h36m_<detector>.npz`` ``positions_2d`` [subject][action] is a list of one (T, K, 2) per camera,
pixels; ``metadata.layout_name`` says what the joints are; the four cameras of Human3.6M are 54138969,
55011271, 58860488 and 60457274. ``data_2d_custom_<name>.npz`` has one video per subject and the action
"custom": there a subject is a camera. There is one person and no confidence: it counts as 1. The file is
pickled and opened by a restricted unpickler.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skelsplat import layouts
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io.detections._arrays import load_npz, npz_keys
from skelsplat.io.detections._format import (
    DetectionFormat,
    Recording,
    View,
    array_view,
    as_numbers,
    joints_of,
)

if TYPE_CHECKING:
    from pathlib import Path

_KEY, _CUSTOM = "positions_2d", "custom"
_CAMERAS = ("54138969", "55011271", "58860488", "60457274")
_LAYOUTS = {"h36m": layouts.H36M17, "coco": layouts.COCO17}


def read_recording(path: Path, sequence: str | None) -> Recording:
    """Return the views of one sequence, ``"S9/Directions 1"``; of a custom file those of all videos.

    Raises
    ------
    InvalidInputError
        If the file has several sequences and `sequence` names none; the message lists some.
    DatasetError
        If the file is not as VideoPose3D writes it.
    """
    arrays = load_npz(path, (_KEY, "metadata"))
    if _KEY not in arrays:
        raise DatasetError(
            path, _KEY, "an array under this key", f"keys {', '.join(npz_keys(path)) or 'none'}"
        )
    table = {
        str(subject): _mapping(path, f"{_KEY}.{subject}", actions)
        for subject, actions in _mapping(path, _KEY, _content(arrays[_KEY])).items()
    }
    layout = _layout(arrays.get("metadata"))
    names = None if layout is None else tuple(_LAYOUTS[layout].joints)
    if table and all(list(actions) == [_CUSTOM] for actions in table.values()):
        videos = {
            video: _videos(path, f"{_KEY}.{video}.custom", actions[_CUSTOM])
            for video, actions in table.items()
        }
        return Recording(
            {v: _view(path, f"{_KEY}.{v}", parts[0], names) for v, parts in videos.items()}, named=True
        )
    key, value = _choose(path, table, sequence)
    parts = _videos(path, key, value)
    human36m = layout == "h36m" and len(parts) == len(_CAMERAS)
    labels = _CAMERAS if human36m else tuple(str(place) for place in range(len(parts)))
    views = {
        m: _view(path, f"{key}[{i}]", part, names)
        for i, (m, part) in enumerate(zip(labels, parts, strict=True))
    }
    return Recording(views, named=human36m)


def _content(value: Any) -> Any:
    return value.item() if getattr(value, "shape", None) == () else value


def _mapping(path: Path, field: str, value: Any) -> dict[Any, Any]:
    if not isinstance(value, dict) or not value:
        raise DatasetError(path, field, "a table of sequences", type(value).__name__)
    return value


def _layout(metadata: Any) -> str | None:
    content = _content(metadata)
    name = content.get("layout_name") if isinstance(content, dict) else None
    return name if name in _LAYOUTS else None


def _choose(path: Path, table: dict[str, dict[Any, Any]], sequence: str | None) -> tuple[str, Any]:
    """Return the field and the content of the sequence asked for, or of the only one."""
    all_of_them = {
        f"{subject}/{action}": value
        for subject, actions in table.items()
        for action, value in actions.items()
    }
    if sequence is None and len(all_of_them) > 1:
        some = ", ".join(list(all_of_them)[:8])
        raise InvalidInputError(
            f"sequence: expected one of {len(all_of_them)} in {path} ({some}, …), got none"
        )
    name = next(iter(all_of_them)) if sequence is None else sequence
    if name not in all_of_them:
        some = ", ".join(list(all_of_them)[:8])
        raise DatasetError(
            path, _KEY, f"the sequence {name!r}", f"{some}{', …' if len(all_of_them) > 8 else ''}"
        )
    return f"{_KEY}.{name}", all_of_them[name]


def _videos(path: Path, field: str, value: Any) -> list[Any]:
    parts = list(value) if isinstance(value, list | tuple) or getattr(value, "ndim", 0) == 4 else []
    if not parts:
        raise DatasetError(path, field, "a list of one array per camera", type(value).__name__)
    return parts


def _view(path: Path, field: str, value: Any, names: tuple[str, ...] | None) -> View:
    array = as_numbers(path, field, value)
    if array.ndim != 3 or array.shape[2] != 2:
        raise DatasetError(path, field, "pixels of shape (T, K, 2)", array.shape)
    if names is not None and array.shape[1] != len(names):
        raise DatasetError(path, field, f"{len(names)} joints (metadata.layout_name)", f"{array.shape[1]}")
    return array_view(path, field, joints_of(path, field, array, None, clip=False)[:, None], names=names)


FORMAT = DetectionFormat(
    name="videopose3d",
    suffixes=(".npz",),
    matches=lambda path: _KEY in npz_keys(path),
    recording=read_recording,
)
