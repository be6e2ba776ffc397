"""Pairs of OpenCV YAML files, ``intri.yml`` and ``extri.yml``, as EasyMocap writes them.

``names`` lists the cameras. ``intri.yml`` has ``K_NAME`` 3×3, ``dist_NAME``, ``D_NAME`` or both, and often
``H_NAME`` and ``W_NAME``, the image's height and width; ``extri.yml`` has ``R_NAME`` (Rodrigues vector),
``Rot_NAME`` 3×3 or both, and ``T_NAME``, world → camera. Given is the folder or either file; one file that
holds everything will do as well. The length unit is that of the board that was calibrated with.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._fields import Field
from skelsplat.io._files import read_text
from skelsplat.io.calibration._entries import PINHOLE_COUNTS, lens_of, whole_size
from skelsplat.io.calibration._format import Array, Parsed, RawCamera, Source
from skelsplat.io.calibration._opencv import is_opencv_yaml, parse_opencv_yaml
from skelsplat.io.calibration._rotation import matrix_from_vector

_PAIR = ("intri", "extri")
_SUFFIXES = (".yml", ".yaml")
# R_ and Rot_ are written with six decimals, and so may be one of dist_ and D_
_SAME_ROTATION = 1e-4
_SAME_LENS = 1e-6


def matches(source: Source) -> bool:
    """Whether a folder has either file, or a file is OpenCV's YAML."""
    if source.is_folder:
        return any(_in_folder(source, part) is not None for part in _PAIR)
    return is_opencv_yaml(source.text)


def _in_folder(source: Source, part: str) -> Path | None:
    return next((f for f in source.files if f.stem == part and f.suffix.lower() in _SUFFIXES), None)


def parse(source: Source) -> Parsed:
    """Return the cameras that both files have."""
    intri, extri = _files(source)
    listed = intri.value.get("names", [])
    names = [str(name) for name in (listed if isinstance(listed, list) else [listed])]
    names = names or [key.removeprefix("K_") for key in intri.value if key.startswith("K_")]
    if not names:
        raise intri["names"].error("the names of the cameras", "none")
    return Parsed([_camera(intri, extri, name) for name in names])


def _files(source: Source) -> tuple[Field, Field]:
    """Return intrinsics and extrinsics; the same file twice if it holds both."""
    if source.is_folder:
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
    return Field(path, "", parse_opencv_yaml(path, read_text(path)))


def _camera(intri: Field, extri: Field, name: str) -> RawCamera:
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
        is_matrix = len(np.ravel(np.array(vector.value, dtype=object))) == 9
        found.append(vector.numbers((3, 3)) if is_matrix else matrix_from_vector(vector.numbers((3,))))
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
