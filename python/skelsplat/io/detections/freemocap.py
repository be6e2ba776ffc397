"""FreeMoCap 1.x: one npy file for all cameras, ``mediapipe_2dData_numCams_numFrames_…_pixelXY.npy``.

Shape (M, T, K, 2) in pixels, NaN for missing; a third number per point is MediaPipe's depth and is left out.
There is one person and no confidence: it counts as 1. The file names no cameras, so their order must be
stated; FreeMoCap's is that of the synchronised videos' names. A file whose name begins with ``mediapipe``, or
with as many points as MediaPipe alone has (75, 543 or 553), has MediaPipe's: their first 33, the body, are
matched to joints by name.
"""

from __future__ import annotations

from pathlib import Path

from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import as_numbers, load_npy, npy_shape
from skelsplat.io.detections._format import Recording, array_view, joints_of

_SIDED = "eye_inner eye eye_outer"
_PAIRS = "shoulder elbow wrist pinky index thumb hip knee ankle heel foot_index"
_BODY = (
    "nose",
    *(f"{side}_{part}" for side in ("left", "right") for part in _SIDED.split()),
    *("left_ear", "right_ear", "mouth_left", "mouth_right"),
    *(f"{side}_{part}" for part in _PAIRS.split() for side in ("left", "right")),
)
# body; with two hands of 21; with 468 or 478 points of the face
_COUNTS = (33, 75, 543, 553)


def read_recording(path: Path, _: str | None) -> Recording:
    """Return the views, by their place in the file."""
    array = as_numbers(path, "array", load_npy(path))
    if array.ndim != 4 or array.shape[3] not in (2, 3) or 0 in array.shape:
        raise DatasetError(path, "array", "shape (cameras, frames, points, 2)", array.shape)
    names = _names(path, array.shape[2])
    people = joints_of(path, "array", array[..., :2], None, clip=False)
    views = {
        str(m): array_view(path, f"array[{m}]", people[m][:, None], names=names) for m in range(len(people))
    }
    return Recording(views, named=False)


def _names(path: Path, count: int) -> tuple[str, ...] | None:
    if not path.name.lower().startswith("mediapipe") and count not in _COUNTS[1:]:
        return None
    if count not in _COUNTS:
        counts = ", ".join(str(known) for known in _COUNTS)
        raise DatasetError(path, "array", f"one of {counts} points of MediaPipe", count)
    return (*_BODY, *(f"point_{place}" for place in range(len(_BODY), count)))


def matches(path: Path) -> bool:
    """Whether a file has an array of FreeMoCap's shape."""
    shape = npy_shape(path)
    return len(shape) == 4 and shape[3] in (2, 3)
