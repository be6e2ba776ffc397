"""Calibrations in plain numbers: COLMAP's text files, and projection matrices 3×4."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from skelsplat._budget import MOST_CAMERAS, read_text
from skelsplat._fields import Field
from skelsplat.cameras import matrix_from_quaternion
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import natural
from skelsplat.io.calibration._entries import SKEW, matrix_of, warn_of_fit, warn_of_no_lens, without_skew
from skelsplat.io.calibration._format import CalibrationFormat, Parsed, RawCamera, Source

_CAMERAS, _IMAGES, _BINARY = "cameras.txt", "images.txt", "cameras.bin"
_TO_TEXT = "text files (colmap model_converter --output_type TXT)"
_UNIT_NORM = 1e-3
# of images.txt: numbers in threes, or nothing; an image between whose numbers and name is that of its camera
_POINTS = re.compile(r"(?:[-+.\deE]+\s+[-+.\deE]+\s+[-+.\deE]+(?:\s+|$))*")
_IMAGE = re.compile(r"\d+(?:\s+\S+){7}\s+\d+\s+\S.*")
# by model: how many of its numbers are focal lengths, how many lens coefficients it has, in which order
# OpenCV has them (None: 0), and whether it is a fisheye's
_MODELS: dict[str, tuple[int, int, tuple[int | None, ...], bool]] = {
    "SIMPLE_PINHOLE": (1, 0, (), False),
    "PINHOLE": (2, 0, (), False),
    "SIMPLE_RADIAL": (1, 1, (0, None, None, None), False),
    "RADIAL": (1, 2, (0, 1, None, None), False),
    "OPENCV": (2, 4, (0, 1, 2, 3), False),
    "FULL_OPENCV": (2, 8, (0, 1, 2, 3, 4, 5, 6, 7), False),
    "OPENCV_FISHEYE": (2, 4, (0, 1, 2, 3), True),
    "SIMPLE_RADIAL_FISHEYE": (1, 1, (0, None, None, None), True),
    "RADIAL_FISHEYE": (1, 2, (0, 1, None, None), True),
}


def _colmap_folder(source: Source) -> Path:
    return source.path if source.is_folder else source.path.parent


def _is_colmap(source: Source) -> bool:
    if not source.is_folder and source.path.name not in (_CAMERAS, _IMAGES, _BINARY):
        return False
    folder = _colmap_folder(source)
    return (folder / _BINARY).is_file() or all((folder / name).is_file() for name in (_CAMERAS, _IMAGES))


def _parse_colmap(source: Source) -> Parsed:
    """Return a camera for each image of COLMAP's model in text; its scale is arbitrary, so the unit is given.

    ``cameras.txt`` has ``CAMERA_ID MODEL WIDTH HEIGHT PARAMS…``; ``images.txt`` has ``IMAGE_ID QW QX QY QZ
    TX TY TZ CAMERA_ID NAME``, world → camera, with or without a line of points below. In COLMAP the first
    pixel's centre is (0.5, 0.5): the principal point is moved by as much. Cameras are called like their
    images, or if these have the same names, like their folders.
    """
    folder = _colmap_folder(source)
    if not (folder / _CAMERAS).is_file():
        raise DatasetError(folder, _CAMERAS, _TO_TEXT, _BINARY)
    lenses = {}
    for number, line in _lines(folder / _CAMERAS):
        if line and not line.startswith("#"):
            words = line.split()
            lenses[words[0]] = Field(folder / _CAMERAS, f"line {number}", words)
    images, points_follow = [], False
    for number, line in _lines(folder / _IMAGES):
        if points_follow and _POINTS.fullmatch(line):  # which may be a blank line
            points_follow = False
        elif line and not line.startswith("#"):
            entry = Field(folder / _IMAGES, f"line {number}", line.split(maxsplit=9))
            if points_follow and not _IMAGE.fullmatch(line):
                raise entry.error("points (X, Y, POINT3D_ID) or the next image", line[:60])
            images.append(entry)
            points_follow = True
    names = _image_names([_words(image, 10)[9] for image in images])
    kept = [(image, name) for image, name in zip(images, names, strict=True) if source.keeps(name)]
    return [_colmap_camera(image, name, lenses) for image, name in kept], None


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    return enumerate(map(str.strip, read_text(path).splitlines()), start=1)


def _words(line: Field, least: int) -> list[str]:
    if len(line.value) < least:
        raise line.error(f"{least} fields or more", f"{len(line.value)} of them")
    return list(line.value)


def _numbers(line: Field, words: list[str]) -> Field:
    """Return words of a line as numbers, to be checked as they are taken."""
    try:
        return Field(line.path, line.place, [float(word) for word in words])
    except ValueError:
        raise line.error("numbers", " ".join(words)[:60]) from None


def _image_names(images: list[str]) -> list[str]:
    files = [PurePosixPath(name) for name in images]
    stems, folders = [file.stem for file in files], [file.parent.name for file in files]
    together = [file.with_suffix("").as_posix() for file in files]
    choices = (stems, folders, together)
    return next((names for names in choices if len(set(names)) == len(names) and all(names)), together)


def _colmap_camera(image: Field, name: str, lenses: dict[str, Field]) -> RawCamera:
    words = _words(image, 10)
    pose = _numbers(image, words[1:8]).numbers((7,))
    if abs(np.linalg.norm(pose[:4]) - 1.0) > _UNIT_NORM:
        raise image.error("a quaternion of norm 1", " ".join(words[1:5]))
    if words[8] not in lenses:
        raise image.error(f"one of the cameras {', '.join(lenses)}", words[8])
    line = lenses[words[8]]
    _, model, width, height, *values = _words(line, 5)
    if model not in _MODELS:
        raise line.error(f"a model among {', '.join(_MODELS)}", model)
    focals, count, order, fisheye = _MODELS[model]
    params = _numbers(line, values).numbers((focals + 2 + count,))
    K = matrix_of(params[0], params[focals - 1], *(params[focals : focals + 2] - 0.5))
    lens = np.array([0.0 if place is None else params[focals + 2 + place] for place in order])
    size = _numbers(line, [width, height]).size()
    R = matrix_from_quaternion(pose[:4])
    return RawCamera(name, K, R, pose[4:], lens if count else None, size, fisheye)


_ENTRIES, _SMALLEST = 12, 1e-12
_SEPARATORS = re.compile(r"[,;\[\]]")
_MOST_TEXT = 2000  # characters of twelve numbers


def _matrix_texts(source: Source) -> list[Path]:
    """Return the text file, or those of a folder."""
    files = source.files if source.is_folder else [source.path]
    return sorted((one for one in files if one.suffix.lower() == ".txt"), key=lambda one: natural(one.stem))


def _matrix_in(path: Path) -> list[float]:
    """Return the numbers of a text; none if it is long or has anything else."""
    if path.stat().st_size <= _MOST_TEXT:
        with suppress(ValueError):
            return [float(word) for word in _SEPARATORS.sub(" ", read_text(path)).split()]
    return []


def _checked_matrix(path: Path) -> list[float]:
    """Return the twelve numbers of a text, or say in which line it has anything else."""
    if len(numbers := _matrix_in(path)) == _ENTRIES:
        return numbers
    rows = [(number, _SEPARATORS.sub(" ", line).split()) for number, line in _lines(path) if line]
    for number, words in rows:
        _numbers(Field(path, f"line {number}", words), words)
    actual = f"{len(rows)} with {sum(len(words) for _, words in rows)} numbers"
    raise DatasetError(path, "content", "three lines of four numbers", actual)


def _is_matrices(source: Source) -> bool:
    table = source.json.value
    if isinstance(table, dict):
        shapes = {np.shape(value) if _is_rows(value) else () for value in table.values()}
        return bool(shapes) and shapes <= {(3, 4), (12,)}
    files = _matrix_texts(source)
    looked_at = files[: MOST_CAMERAS + 1]
    return 2 * sum(len(_matrix_in(path)) == _ENTRIES for path in looked_at) > len(looked_at)


def _is_rows(value: Any) -> bool:
    """Whether a value is a list of numbers, or of such lists of one length."""
    rows = value if isinstance(value, list) else [value]
    lengths = {len(row) if isinstance(row, list) else 0 for row in rows}
    return len(lengths) == 1 and value is not rows[0]


def _parse_matrices(source: Source) -> Parsed:
    """Return cameras from matrices P = K [R | t], 3×4; neither unit nor image size are in the file.

    JSON, ``{"NAME": [[…], […], […]], …}``, or a text file per camera with twelve numbers. P is taken apart
    into positive focal lengths and a rotation; skew is followed as with DANNCE. There is no lens.
    """
    if source.json.value is not None:
        entries = [entry for entry in source.json.members().values() if source.keeps(entry.place)]
    else:
        kept = [path for path in _matrix_texts(source) if source.keeps(path.stem)]
        entries = [Field(path, path.stem, _checked_matrix(path)) for path in kept]
    errors: dict[str, float] = {}
    cameras = [_matrix_camera(entry, errors) for entry in entries]
    warn_of_no_lens(source.path, [camera.name for camera in cameras])
    warn_of_fit(source.path, errors, SKEW)
    return cameras, None


def _matrix_camera(entry: Field, errors: dict[str, float]) -> RawCamera:
    """Return the camera of a matrix; the error of what stands for its skew, px, is added to `errors`."""
    flat = len(entry.value) == _ENTRIES
    P = entry.numbers((_ENTRIES,)).reshape(3, 4) if flat else entry.numbers((3, 4))
    # K R by the QR decomposition of the rows in reverse: of a plane camera its axes last
    q, r = np.linalg.qr(P[::-1, :3].T)
    K, R = r.T[::-1, ::-1], q.T[::-1]
    if not (np.abs(np.diag(K)) > _SMALLEST * np.abs(K).max()).all():
        raise entry.error("a matrix of which the first three columns have rank 3", "others")
    signs = np.sign(np.diag(K))
    K, R = K * signs, signs[:, None] * R
    sign = np.sign(np.linalg.det(R))
    t = np.linalg.solve(K, sign * P[:, 3])
    K, turn, errors[entry.place] = without_skew(K / K[2, 2])
    return RawCamera(entry.place, K, turn @ (sign * R), turn @ t)


FORMATS = (
    CalibrationFormat("colmap", "COLMAP's text files", _is_colmap, _parse_colmap),
    CalibrationFormat("matrices", "projection matrices 3×4", _is_matrices, _parse_matrices, ("size",)),
)
