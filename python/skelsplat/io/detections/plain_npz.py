"""Plain npz files: for detections of one's own.

``detections`` in pixels, NaN for missing, with 2 numbers per joint or with confidence as the third.

================  ======================  ===========================================================
detections        (T, M, P, K, 2 or 3)    all cameras in one file; P may be left out: (T, M, K, …)
detections        (T, P, K, 2 or 3)       one file per camera, named like it; P may be left out
confidence        detections' but last    in [0, 1], if it is not in ``detections``; else 1
camera_names      (M,)                    of a file of all cameras; else their order must be stated
frames            (T,)                    ascending; else from 0
joint_names       (K,)                    else the layout that is asked for has to have K joints
================  ======================  ===========================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._arrays import load_npz, npz_keys
from skelsplat.io.detections._format import (
    DetectionFormat,
    Recording,
    View,
    array_view,
    as_numbers,
    frame_numbers,
    joints_of,
)
from skelsplat.io.detections._names import array_names

if TYPE_CHECKING:
    from pathlib import Path

    from skelsplat.io.detections._format import Array

_KEY = "detections"
_KEYS = (_KEY, "confidence", "camera_names", "frames", "joint_names")


def read_recording(path: Path, _: str | None) -> Recording:
    """Return the views of a file of all cameras."""
    arrays = load_npz(path, _KEYS)
    people = _joints(path, arrays, "(T, M, P, K, 2 or 3)", 4)
    people = people if people.ndim == 5 else people[:, :, None]
    count = people.shape[1]
    names = arrays.get("camera_names")
    labels = (
        [str(m) for m in range(count)] if names is None else array_names(path, "camera_names", names, count)
    )
    views = {label: _view(path, people[:, m], arrays) for m, label in enumerate(labels)}
    return Recording(views, named=names is not None)


def read_file(path: Path) -> View:
    """Return the view of the one camera of a file."""
    arrays = load_npz(path, _KEYS)
    people = _joints(path, arrays, "(T, P, K, 2 or 3)", 3)
    return _view(path, people if people.ndim == 4 else people[:, None], arrays)


def _joints(path: Path, arrays: dict[str, Any], shape: str, least: int) -> Array:
    """Return joints (…, 3) from an array of `least` or one more axes."""
    if _KEY not in arrays:
        raise DatasetError(
            path, _KEY, "an array under this key", f"keys {', '.join(npz_keys(path)) or 'none'}"
        )
    array = as_numbers(path, _KEY, arrays[_KEY])
    if array.ndim not in (least, least + 1) or array.shape[-1] not in (2, 3) or 0 in array.shape[1:]:
        raise DatasetError(path, _KEY, f"shape {shape}, P may be left out", array.shape)
    apart = arrays.get("confidence")
    if apart is not None:
        apart = as_numbers(path, "confidence", apart)
        if array.shape[-1] == 3 or apart.shape != array.shape[:-1]:
            expected = f"shape {array.shape[:-1]}, and pixels alone in {_KEY}"
            raise DatasetError(path, "confidence", expected, f"{apart.shape} beside {array.shape}")
    confidence = array[..., 2] if array.shape[-1] == 3 else apart
    return joints_of(path, _KEY, array[..., :2], confidence, clip=False)


def _view(path: Path, people: Array, arrays: dict[str, Any]) -> View:
    frames, names = arrays.get("frames"), arrays.get("joint_names")
    return array_view(
        path,
        _KEY,
        people,
        frames=None if frames is None else frame_numbers(path, "frames", frames, len(people)),
        names=None if names is None else array_names(path, "joint_names", names, people.shape[2]),
    )


FORMAT = DetectionFormat(
    name="npz",
    suffixes=(".npz",),
    matches=lambda path: _KEY in npz_keys(path),
    file=read_file,
    recording=read_recording,
)
