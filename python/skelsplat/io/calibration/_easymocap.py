"""Pairs of OpenCV YAML files, ``intri.yml`` and ``extri.yml``, as EasyMocap writes them.

``names`` lists the cameras. ``intri.yml`` has ``K_NAME`` 3×3, ``dist_NAME``, ``D_NAME`` or both, and often
``H_NAME`` and ``W_NAME``, the image's height and width; ``extri.yml`` has ``R_NAME`` (Rodrigues vector),
``Rot_NAME`` 3×3 or both, and ``T_NAME``, world → camera. Given is the folder or either file; one file that
holds everything will do as well. The length unit is that of the board that was calibrated with.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import read_text
from skelsplat.io.calibration._fields import PINHOLE_COUNTS, Entry
from skelsplat.io.calibration._opencv_yaml import is_opencv_yaml, parse_opencv_yaml
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera
from skelsplat.io.calibration._rotation import matrix_from_vector

if TYPE_CHECKING:
    from skelsplat.io.calibration._raw import Array, Options
    from skelsplat.io.calibration._source import Source

_PAIR = ("intri", "extri")
_SUFFIXES = (".yml", ".yaml")
# R_ and Rot_ are written with six decimals, and so may be one of dist_ and D_
_SAME_ROTATION = 1e-4
_SAME_LENS = 1e-6


def _matches(source: Source) -> bool:
    if source.is_folder:
        return _in_folder(source, "intri") is not None or _in_folder(source, "extri") is not None
    return is_opencv_yaml(source.text)


def _in_folder(source: Source, part: str) -> Path | None:
    return next((f for f in source.files if f.stem == part and f.suffix.lower() in _SUFFIXES), None)


def _parse(source: Source, options: Options) -> Parsed:  # noqa: ARG001
    intri, extri = _files(source)
    names = [_text(name) for name in intri.values.get("names", [])]
    names = names or [key.removeprefix("K_") for key in intri.values if key.startswith("K_")]
    if not names:
        raise intri.error("names", "the names of the cameras", "none")
    return Parsed([_camera(intri, extri, name) for name in names])


def _files(source: Source) -> tuple[Entry, Entry]:
    """Intrinsics and extrinsics; the same file twice if it holds both."""
    if source.is_folder:
        paths = [_in_folder(source, part) for part in _PAIR]
        for part, path in zip(_PAIR, paths, strict=True):
            if path is None:
                raise DatasetError(source.path / f"{part}.yml", "file", "a readable file", "no such file")
        found = [_entry(path) for path in paths if path is not None]
        return found[0], found[1]
    given = _entry(source.path)
    has = [any(key.startswith(prefix) for key in given.values) for prefix in ("K_", "T_")]
    if all(has):
        return given, given
    here, there = _PAIR if has[0] else _PAIR[::-1]
    if not any(has) or here not in source.path.name:
        expected = "K_NAME (intri.yml) or R_NAME and T_NAME (extri.yml) for each camera"
        raise given.error("keys", expected, ", ".join(given.values) or "none")
    other = _entry(source.path.with_name(source.path.name.replace(here, there)))
    return (given, other) if has[0] else (other, given)


def _entry(path: Path) -> Entry:
    return Entry(path, "", parse_opencv_yaml(path, read_text(path)))


def _text(value: object) -> str:
    return str(value)


def _camera(intri: Entry, extri: Entry, name: str) -> RawCamera:
    return RawCamera(
        table=name,
        name=name,
        K=intri.numbers(f"K_{name}", (3, 3)),
        R=_rotation(extri, name),
        t=extri.numbers(f"T_{name}", (3,)),
        distortion=_lens(intri, name),
        fisheye=False,
        size=_size(intri, name),
    )


def _lens(intri: Entry, name: str) -> Array | None:
    """Lens coefficients from ``dist_``, else ``D_``; both must say the same."""
    keys = [f"dist_{name}", f"D_{name}"]
    there = [key for key in keys if key in intri.values] or keys[:1]
    found = [intri.distortion(key) for key in there]
    if len(found) == 2 and not _same_lens(*found):
        raise intri.error(there[1], f"the coefficients of {there[0]}", "others")
    return found[0]


def _same_lens(one: Array | None, other: Array | None) -> bool:
    """Compare coefficients; those that are left out are 0."""
    longest = max(PINHOLE_COUNTS)
    padded = [np.zeros(longest) if k is None else np.pad(k, (0, longest - k.size)) for k in (one, other)]
    return bool(np.abs(padded[0] - padded[1]).max() <= _SAME_LENS)


def _rotation(extri: Entry, name: str) -> Array:
    """Rotation from ``Rot_``, else ``R_`` (vector or matrix); both must say the same."""
    key = f"R_{name}"
    found = [extri.numbers(f"Rot_{name}", (3, 3))] if f"Rot_{name}" in extri.values else []
    if key in extri.values or not found:
        is_matrix = len(np.ravel(np.array(extri.values.get(key, 0), dtype=object))) == 9
        found.append(
            extri.numbers(key, (3, 3)) if is_matrix else matrix_from_vector(extri.numbers(key, (3,)))
        )
    if len(found) == 2 and np.abs(found[0] - found[1]).max() > _SAME_ROTATION:
        raise extri.error(f"Rot_{name}", f"the rotation of {key}", "another rotation")
    return found[0]


def _size(intri: Entry, name: str) -> tuple[int, int] | None:
    keys = [f"W_{name}", f"H_{name}"]
    if not any(key in intri.values for key in keys):
        return None
    width, height = (intri.number(key) for key in keys)
    if min(width, height) < 1 or not (width.is_integer() and height.is_integer()):
        raise intri.error(keys[0], "a positive whole width and height", f"{width:g} and {height:g}")
    return int(width), int(height)


EASYMOCAP = CalibrationFormat(
    "easymocap",
    "OpenCV YAML pair intri.yml and extri.yml (EasyMocap)",
    _matches,
    _parse,
    frozenset({"size"}),
)
