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

from pathlib import Path

from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import Array, Arrays, as_numbers, load_npz, npz_keys
from skelsplat.io.detections._format import Recording, View, array_view, joints_of

_KEY = "detections"
_KEYS = (_KEY, "confidence", "camera_names", "frames", "joint_names")


def read_recording(path: Path, _: str | None) -> Recording:
    """Return the views of a file of all cameras."""
    arrays = load_npz(path, _KEYS)
    people = _joints(arrays, "(T, M, P, K, 2 or 3)", 4)
    people = people if people.ndim == 5 else people[:, :, None]
    names = arrays.names("camera_names", people.shape[1])
    labels = names or [str(m) for m in range(people.shape[1])]
    views = {label: _view(arrays, people[:, m]) for m, label in enumerate(labels)}
    return Recording(views, named=names is not None)


def read_file(path: Path) -> View:
    """Return the view of the one camera of a file."""
    arrays = load_npz(path, _KEYS)
    people = _joints(arrays, "(T, P, K, 2 or 3)", 3)
    return _view(arrays, people if people.ndim == 4 else people[:, None])


def _joints(arrays: Arrays, shape: str, least: int) -> Array:
    """Return joints (…, 3) from an array of `least` or one more axes."""
    path, array = arrays.path, as_numbers(arrays.path, _KEY, arrays.take(_KEY))
    if array.ndim not in (least, least + 1) or array.shape[-1] not in (2, 3) or 0 in array.shape[1:]:
        raise DatasetError(path, _KEY, f"shape {shape}, P may be left out", array.shape)
    confidence = array[..., 2] if array.shape[-1] == 3 else None
    apart = arrays.found.get("confidence")
    if apart is not None:
        apart = as_numbers(path, "confidence", apart)
        if confidence is not None or apart.shape != array.shape[:-1]:
            expected = f"shape {array.shape[:-1]}, and pixels alone in {_KEY}"
            raise DatasetError(
                path, "confidence", expected, f"{apart.shape} with {_KEY} of shape {array.shape}"
            )
        confidence = apart
    return joints_of(path, _KEY, array[..., :2], confidence, clip=False)


def _view(arrays: Arrays, people: Array) -> View:
    frames, names = arrays.frames(len(people)), arrays.names("joint_names", people.shape[2])
    return array_view(arrays.path, _KEY, people, frames=frames, names=names)


def matches(path: Path) -> bool:
    """Whether a file has an array called ``detections``."""
    return _KEY in npz_keys(path)
