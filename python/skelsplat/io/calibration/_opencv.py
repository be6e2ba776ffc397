"""Calibrations in OpenCV's ``FileStorage``: EasyMocap (YAML) and OpenPose (XML), read without OpenCV.

Its YAML is not what other parsers read: the header is ``%YAML:1.0`` and matrices carry the tag
``!!opencv-matrix``. Read here: numbers, texts, lists of texts (``- a`` lines or ``[a, b]``) and matrices, at
the top level; of XML the matrices.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import check_document, read_text
from skelsplat.exceptions import DatasetError
from skelsplat.io._fields import Field
from skelsplat.io._files import natural, whole_number
from skelsplat.io.calibration._format import (
    PINHOLE_COUNTS,
    CalibrationFormat,
    Parsed,
    RawCamera,
    Source,
    lens_of,
    rotation_of,
    whole_size,
)

_MATRIX = "!!opencv-matrix"


def _parse_opencv_yaml(path: Path, text: str) -> dict[str, Any]:
    """Return the top-level entries: matrices and lists as nested lists, numbers, texts."""
    entries: dict[str, Any] = {}
    for key, line, value, block in _blocks(path, text):
        if key in entries:
            raise DatasetError(path, f"{key} (line {line})", "a key once", "the same key again")
        if value.startswith(_MATRIX):
            entries[key] = _matrix(path, key, _parts(" ".join(block)), closed=True)
        elif value.startswith("["):
            inside = " ".join([value, *block]).strip("[] ")
            entries[key] = [_scalar(part.strip()) for part in inside.split(",") if part.strip()]
        elif value:
            entries[key] = _scalar(value)
        else:
            entries[key] = [_scalar(item.removeprefix("-").strip()) for item in block]
    return entries


def _parts(text: str) -> dict[str, str]:
    """Return the values of ``name: value`` pairs, of which one is a list in brackets."""
    before, bracket, rest = text.partition("[")
    data, end, after = rest.partition("]")
    words = f"{before} {after}".replace(":", " : ").split()
    triples = zip(words, words[1:], words[2:], strict=False)
    parts = {name: value for name, colon, value in triples if colon == ":"}
    return {**parts, "data": f"[{data}{end}"} if bracket else parts


def _blocks(path: Path, text: str) -> Iterator[tuple[str, int, str, list[str]]]:
    """Yield key, line number, what stands behind the key, and the stripped indented lines below it."""
    current: tuple[str, int, str, list[str]] | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if not stripped or stripped.startswith(("%YAML", "#")) or stripped in ("---", "..."):
            continue
        indented = line[:1].isspace() or stripped.startswith("- ")
        name, colon, value = stripped.partition(":")
        is_key = name[:1] not in "#%-" and bool(colon) and not value[:1].strip()
        if is_key and not indented:
            if current is not None:
                yield current
            current = (name.strip().strip("\"'"), number, value.strip(), [])
        elif indented and current is not None:
            current[3].append(stripped)
        else:
            raise DatasetError(path, f"line {number}", "key: value", repr(stripped[:60]))
    if current is not None:
        yield current


def _matrix(path: Path, key: str, parts: Mapping[str, str], *, closed: bool = False) -> list[list[float]]:
    """Return rows × columns of a matrix, whose data, if `closed`, must end in a bracket."""
    missing = [name for name in ("rows", "cols", "data") if not parts.get(name)]
    if missing:
        raise DatasetError(path, key, "a matrix with rows, cols and data", f"no {', '.join(missing)}")
    data = parts["data"]
    try:
        shape = int(parts["rows"]), int(parts["cols"])
        values = [float(part) for part in data.strip("[]").replace(",", " ").split()]
    except ValueError as error:
        raise DatasetError(path, key, "a matrix of numbers", error) from error
    if (closed and not data.endswith("]")) or min(shape) < 0 or len(values) != shape[0] * shape[1]:
        expected = f"{shape[0]}×{shape[1]} numbers{' in a closed list' if closed else ''}"
        raise DatasetError(path, key, expected, f"{len(values)} numbers")
    return np.reshape(values, shape).tolist()


def _scalar(text: str) -> Any:
    """Return a number or a text; a quoted number stays a text, and so does one with leading zeros."""
    if text[:1] in "\"'":
        return text[1:-1] if text[-1:] == text[:1] and len(text) > 1 else text
    if re.fullmatch(r"[-+]?(0|[1-9]\d*)", text):
        return whole_number(text)
    if re.fullmatch(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", text) and not text.isdigit():
        return float(text)
    return text


_ROOT = "opencv_storage"


def is_openpose(source: Source) -> bool:
    """Whether a folder has XML files, or a file has OpenCV's root."""
    if source.is_folder:
        return any(file.suffix.lower() == ".xml" for file in source.files)
    return source.xml is not None and source.xml.tag == _ROOT


def parse_openpose(source: Source) -> Parsed:
    """Return the camera of every file of OpenPose's, 2.xml before 10.xml: one OpenCV XML each, metres.

    ``CameraMatrix`` 3×4 is world → camera [R | t], ``Intrinsics`` 3×3, ``Distortion`` n×1 in OpenCV's order.
    The camera's name is that of its file. The image size is not in the files.
    """
    files = [f for f in source.files if f.suffix.lower() == ".xml"] if source.is_folder else [source.path]
    if not files:
        raise DatasetError(source.path, "files", "one XML file per camera", "none")
    files = sorted(files, key=lambda file: natural(file.stem))
    return Parsed([_openpose_camera(Source(file)) for file in files], "m")


def _openpose_camera(source: Source) -> RawCamera:
    root = source.xml
    if root is None or root.tag != _ROOT:
        actual = "no XML" if root is None else f"<{root.tag}>"
        raise DatasetError(source.path, "root", f"<{_ROOT}>, as OpenCV writes it", actual)
    parts = {node.tag: {child.tag: child.text or "" for child in node} for node in root if len(node)}
    matrices = {key: _matrix(source.path, key, part) for key, part in parts.items()}
    entry = Field(source.path, "", matrices)
    pose = entry["CameraMatrix"].numbers((3, 4))
    return RawCamera(
        name=source.path.stem,
        K=entry["Intrinsics"].numbers((3, 3)),
        R=pose[:, :3],
        t=pose[:, 3],
        distortion=lens_of(entry["Distortion"]),
        size=None,
    )


_PAIR = ("intri", "extri")
_SUFFIXES = (".yml", ".yaml")
# R_ and Rot_ are written with six decimals, and so may be one of dist_ and D_
_SAME_ROTATION = 1e-4
_SAME_LENS = 1e-6


def is_easymocap(source: Source) -> bool:
    """Whether a folder has either file, or a file has the header or a matrix of OpenCV's YAML."""
    if source.is_folder:
        return any(_in_folder(source, part) is not None for part in _PAIR)
    return source.start.startswith("%YAML") or _MATRIX in source.text


def _in_folder(source: Source, part: str) -> Path | None:
    return next((f for f in source.files if f.stem == part and f.suffix.lower() in _SUFFIXES), None)


def parse_easymocap(source: Source) -> Parsed:
    """Return the cameras that EasyMocap's pair of files has, ``intri.yml`` and ``extri.yml``.

    ``names`` lists the cameras. ``intri.yml`` has ``K_NAME`` 3×3, ``dist_NAME``, ``D_NAME`` or both, and
    often ``H_NAME`` and ``W_NAME``, the image's height and width; ``extri.yml`` has ``R_NAME`` (Rodrigues
    vector), ``Rot_NAME`` 3×3 or both, and ``T_NAME``, world → camera. Given is the folder or either file; one
    file that holds everything will do as well. The length unit is that of the board that was calibrated with.
    """
    intri, extri = _files(source)
    listed = intri.value.get("names", [])
    names = [str(name) for name in (listed if isinstance(listed, list) else [listed])]
    names = names or [key.removeprefix("K_") for key in intri.value if key.startswith("K_")]
    if not names:
        raise intri["names"].error("the names of the cameras", "none")
    return Parsed([_easymocap_camera(intri, extri, name) for name in names])


def _files(source: Source) -> tuple[Field, Field]:
    """Return intrinsics and extrinsics; the same file twice if it holds both."""
    if source.is_folder:
        for part in _PAIR:
            twins = [f.name for f in source.files if f.stem == part and f.suffix.lower() in _SUFFIXES]
            if len(twins) > 1:
                raise DatasetError(source.path, "files", f"one {part}.yml", ", ".join(twins))
        intri, extri = (_in_folder(source, part) or source.path / f"{part}.yml" for part in _PAIR)
        return _entries(intri), _entries(extri)
    given = _entries(source.path)
    has = [any(key.startswith(prefix) for key in given.value) for prefix in ("K_", "T_")]
    if all(has):
        return given, given
    here, there = _PAIR if has[0] else _PAIR[::-1]
    if not any(has) or here not in source.path.name:
        expected = "K_NAME (intri.yml) or R_NAME and T_NAME (extri.yml) for each camera"
        raise DatasetError(source.path, "keys", expected, ", ".join(given.value) or "none")
    other = _entries(source.path.with_name(source.path.name.replace(here, there)))
    return (given, other) if has[0] else (other, given)


def _entries(path: Path) -> Field:
    text = read_text(path)
    check_document(path, text)
    return Field(path, "", _parse_opencv_yaml(path, text))


def _easymocap_camera(intri: Field, extri: Field, name: str) -> RawCamera:
    return RawCamera(
        name=name,
        K=intri[f"K_{name}"].numbers((3, 3)),
        R=_rotation(extri, name),
        t=extri[f"T_{name}"].numbers((3,)),
        distortion=_lens(intri, name),
        size=_size(intri, name),
    )


def _lens(intri: Field, name: str) -> Array | None:
    """Return lens coefficients from ``dist_``, else ``D_``; both must say the same."""
    fields = [intri[f"dist_{name}"], intri[f"D_{name}"]]
    there = [field for field in fields if not field.is_missing] or fields[:1]
    found = [lens_of(field) for field in there]
    longest = max(PINHOLE_COUNTS)  # coefficients that are left out are 0
    padded = [np.zeros(longest) if k is None else np.pad(k, (0, longest - k.size)) for k in found]
    if np.abs(padded[-1] - padded[0]).max() > _SAME_LENS:
        raise there[1].error(f"the coefficients of {there[0].place}", "others")
    return found[0]


def _rotation(extri: Field, name: str) -> Array:
    """Return the rotation from ``Rot_``, else ``R_`` (vector or matrix); both must say the same."""
    vector, matrix = extri[f"R_{name}"], extri[f"Rot_{name}"]
    found = [] if matrix.is_missing else [matrix.numbers((3, 3))]
    if not vector.is_missing or not found:
        found.append(rotation_of(vector))
    if np.abs(found[-1] - found[0]).max() > _SAME_ROTATION:
        raise matrix.error(f"the rotation of {vector.place}", "another rotation")
    return found[0]


def _size(intri: Field, name: str) -> tuple[int, int] | None:
    fields = intri[f"W_{name}"], intri[f"H_{name}"]
    if all(field.is_missing for field in fields):
        return None
    width, height = (field.number() for field in fields)
    size = whole_size(width, height)
    if size is None:
        raise fields[0].error("a positive whole width and height", f"{width:g} and {height:g}")
    return size


_PAIR_OF_FILES = "OpenCV's YAML pair intri.yml and extri.yml of EasyMocap"
FORMATS = (
    CalibrationFormat("openpose", "OpenPose's folder of XML", "m", is_openpose, parse_openpose, ("size",)),
    CalibrationFormat("easymocap", _PAIR_OF_FILES, "", is_easymocap, parse_easymocap, ("size",)),
)
