"""Arrays of rtmlib, which hands out ``keypoints`` (P, K, 2) and ``scores`` (P, K) per image.

Saved per camera, either as a folder with one file per frame, ``<frame>.npz`` with both arrays or the pair
``<frame>_keypoints.npy`` and ``<frame>_scores.npy``, or as one ``<camera>.npz`` with a leading axis of frames
(T, P, K, 2) and (T, P, K), NaN for nobody, and perhaps ``frames`` (T,). Scores are maxima of SimCC and can
exceed 1; they are clipped to [0, 1], and a joint whose score is not positive is missing.
"""

from __future__ import annotations

from pathlib import Path

from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import Array, Arrays, as_numbers, load_npy, load_npz, npz_keys
from skelsplat.io.detections._format import Person, View, array_view, joints_of
from skelsplat.io.detections._frames import frame_files

_KEYPOINTS, _SCORES = "keypoints", "scores"
_TAIL = f"_{_KEYPOINTS}.npy"


def read_folder(folder: Path) -> View:
    """Return the view of one camera; a frame's file is read when its people are asked for."""
    pattern = f"*{_TAIL}" if any(folder.glob(f"*{_TAIL}")) else "*.npz"
    files = frame_files(folder, pattern, "one npz file, or pair of npy files, per frame")

    def in_frame(number: int) -> list[Person]:
        path = files[number]
        joints = _joints(_pair(path), ("P", "K"))
        return [Person(path, f"{_KEYPOINTS}[{p}]", person) for p, person in enumerate(joints)]

    return View(folder, list(files), in_frame)


def read_file(path: Path) -> View:
    """Return the view of one camera from one npz file."""
    arrays = load_npz(path, (_KEYPOINTS, _SCORES, "frames"))
    people = _joints(arrays, ("T", "P", "K"))
    return array_view(path, _KEYPOINTS, people, frames=arrays.frames(len(people)))


def _pair(path: Path) -> Arrays:
    if path.suffix == ".npz":
        return load_npz(path, (_KEYPOINTS, _SCORES))
    scores = path.with_name(f"{path.name.removesuffix(_TAIL)}_{_SCORES}.npy")
    return Arrays(path, {_KEYPOINTS: load_npy(path), _SCORES: load_npy(scores)})


def _joints(arrays: Arrays, axes: tuple[str, ...]) -> Array:
    """Return joints (…, K, 3); both arrays have to be there and fit."""
    path = arrays.path
    xy, scores = (as_numbers(path, key, arrays.take(key)) for key in (_KEYPOINTS, _SCORES))
    if xy.ndim != len(axes) + 1 or xy.shape[-1] != 2:
        raise DatasetError(path, _KEYPOINTS, f"shape ({', '.join((*axes, '2'))})", xy.shape)
    if scores.shape != xy.shape[:-1]:
        raise DatasetError(path, _SCORES, f"shape {xy.shape[:-1]} like the keypoints", scores.shape)
    return joints_of(path, _KEYPOINTS, xy, scores, clip=True)


def matches(path: Path) -> bool:
    """Whether a file is the keypoints' part of a pair, or holds both arrays."""
    if path.suffix == ".npy":
        return path.name.endswith(_TAIL)
    return {_KEYPOINTS, _SCORES} <= npz_keys(path)
