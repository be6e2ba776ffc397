"""VideoPose3D: one npz file for all cameras.

In ``data_2d_h36m_<detector>.npz`` ``positions_2d`` [subject][action] is a list of one (T, K, 2) per camera,
pixels; ``metadata.layout_name`` says what the joints are; the four cameras of Human3.6M are 54138969,
55011271, 58860488 and 60457274. ``data_2d_custom_<name>.npz`` has one video per subject and the action
"custom": there a subject is a camera. There is one person and no confidence: it counts as 1. The file is
pickled and opened by a restricted unpickler.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skelsplat import layouts
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._arrays import as_numbers, load_npz, npz_keys
from skelsplat.io.detections._format import Recording, View, array_view, joints_of

_KEY, _CUSTOM = "positions_2d", "custom"
_CAMERAS = ("54138969", "55011271", "58860488", "60457274")
_NAMED = 8  # sequences in a message
_LAYOUTS = {"h36m": layouts.H36M17, "coco": layouts.COCO17}


def read_recording(path: Path, sequence: str | None) -> Recording:
    """Return the views of one sequence, ``"S9/Directions 1"``; of a custom file those of all videos."""
    arrays = load_npz(path, (_KEY, "metadata"))
    subjects = _table(path, _KEY, _content(arrays.take(_KEY)))
    table = {str(name): _table(path, f"{_KEY}.{name}", actions) for name, actions in subjects.items()}
    layout = _layout(arrays.found.get("metadata"))
    names = None if layout is None else tuple(_LAYOUTS[layout].joints)
    if all(list(actions) == [_CUSTOM] for actions in table.values()):
        views = {}
        for video, actions in table.items():
            part = _videos(path, f"{_KEY}.{video}.custom", actions[_CUSTOM])[0]
            views[video] = _view(path, f"{_KEY}.{video}", part, names)
        return Recording(views, named=True)
    key, value = _choose(path, table, sequence)
    parts = _videos(path, key, value)
    human36m = layout == "h36m" and len(parts) == len(_CAMERAS)
    labels = _CAMERAS if human36m else [str(place) for place in range(len(parts))]
    views = {label: _view(path, f"{key}[{i}]", parts[i], names) for i, label in enumerate(labels)}
    return Recording(views, named=human36m)


def _content(value: Any) -> Any:
    return value.item() if getattr(value, "shape", None) == () else value


def _table(path: Path, field: str, value: Any) -> dict[Any, Any]:
    if not isinstance(value, dict) or not value:
        raise DatasetError(path, field, "a table of sequences", type(value).__name__)
    return value


def _layout(metadata: Any) -> str | None:
    content = _content(metadata)
    name = content.get("layout_name") if isinstance(content, dict) else None
    return name if name in _LAYOUTS else None


def _choose(path: Path, table: dict[str, dict[Any, Any]], sequence: str | None) -> tuple[str, Any]:
    """Return the field and the content of the sequence asked for, or of the only one."""
    found = {f"{who}/{action}": value for who, actions in table.items() for action, value in actions.items()}
    some = ", ".join([*list(found)[:_NAMED], *(["…"] if len(found) > _NAMED else [])])
    if sequence is None and len(found) > 1:
        raise InvalidInputError(f"sequence: expected one of {len(found)} in {path} ({some}), got none")
    name = next(iter(found)) if sequence is None else sequence
    if name not in found:
        raise DatasetError(path, _KEY, f"the sequence {name!r}", some)
    return f"{_KEY}.{name}", found[name]


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


def matches(path: Path) -> bool:
    """Whether a file has VideoPose3D's array."""
    return _KEY in npz_keys(path)
