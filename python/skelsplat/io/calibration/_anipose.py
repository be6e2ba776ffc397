"""TOML calibrations of the Anipose family: Anipose, Pose2Sim, FreeMoCap and Caliscope's export.

One table per camera with ``matrix`` 3×3, ``rotation`` (Rodrigues, radians) and ``translation``, both
world → camera, ``size`` (width, height), and optionally ``distortions``, ``fisheye``, ``name``. Other tables
(``metadata`` and the like) are passed over. The length unit is not in the file.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._raw import CalibrationFormat, RawCamera
from skelsplat.io.calibration._rotation import matrix_from_vector

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

_REQUIRED = ("matrix", "rotation", "translation")
_NOT_CAMERAS = frozenset({"metadata", "capture_volume", "charuco", "checkerboard"})
_PINHOLE_COUNTS = (4, 5, 8, 12, 14)
_FISHEYE_COUNT = 4


def _matches(text: str) -> bool:
    """Whether the text has a TOML table header or an assignment at the start of a line."""
    return re.search(r"^\s*(\[[^\[\]\n]+\]\s*(#.*)?$|[\w.\"-]+\s*=)", text, re.MULTILINE) is not None


def _parse(path: Path, text: str) -> list[RawCamera]:
    """Return the cameras of the file in its order; at least one, or `DatasetError`."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DatasetError(path, "TOML", "valid TOML", str(error)) from error
    tables = [(key, value) for key, value in document.items() if _is_camera(key, value)]
    if not tables:
        expected = "at least one camera table with matrix, rotation and translation"
        raise DatasetError(path, "cameras", expected, f"tables {', '.join(document) or 'none'}")
    return [_Table(path, key, value).camera() for key, value in tables]


def _is_camera(key: str, value: object) -> bool:
    """Whether a top-level entry is a camera.

    One of the three required keys is enough: a camera that lacks another is an error, not a table to skip.
    """
    return key not in _NOT_CAMERAS and isinstance(value, dict) and any(name in value for name in _REQUIRED)


@dataclass(frozen=True)
class _Table:
    """One camera's table, read key by key."""

    path: Path
    key: str
    values: dict[str, Any]

    def camera(self) -> RawCamera:
        matrix = self._numbers("matrix", (3, 3))
        rotation = self._numbers("rotation", (3,))
        translation = self._numbers("translation", (3,))
        fisheye = self._fisheye()
        return RawCamera(
            table=self.key,
            name=str(self.values.get("name", self.key)),
            K=matrix,
            R=matrix_from_vector(rotation),
            t=translation,
            distortion=self._distortion(fisheye),
            fisheye=fisheye,
            size=self._size(),
        )

    def _error(self, key: str, expected: str, actual: object) -> DatasetError:
        return DatasetError(self.path, f"{self.key}.{key}", expected, actual)

    def _numbers(self, key: str, shape: tuple[int, ...] | None) -> Array:
        """Return the finite numbers under `key`; `shape` None means a list of any length."""
        expected = "a list of numbers" if shape is None else f"{'×'.join(map(str, shape))} numbers"
        if key not in self.values:
            raise self._error(key, expected, "nothing (the key is missing)")
        value = self.values[key]
        if not _is_numeric(value):
            raise self._error(key, expected, repr(value))
        try:
            array = np.asarray(value, dtype=np.float64)
        except ValueError:
            raise self._error(key, expected, "lists of different lengths") from None
        if array.ndim != 1 if shape is None else array.shape != shape:
            raise self._error(key, expected, f"shape {'×'.join(map(str, array.shape)) or 'scalar'}")
        if not np.isfinite(array).all():
            raise self._error(key, "finite numbers", repr(value))
        return array

    def _fisheye(self) -> bool:
        value = self.values.get("fisheye", False)
        if not isinstance(value, bool):
            raise self._error("fisheye", "true or false", repr(value))
        return value

    def _distortion(self, fisheye: bool) -> Array | None:
        key = "distortion" if "distortion" in self.values else "distortions"
        if key not in self.values:
            return None
        values = self._numbers(key, None)
        # FreeMoCap pads the four fisheye coefficients with a zero
        if fisheye and values.size == _FISHEYE_COUNT + 1 and values[-1] == 0.0:
            values = values[:_FISHEYE_COUNT]
        counts = (_FISHEYE_COUNT,) if fisheye else _PINHOLE_COUNTS
        if values.size not in counts:
            kind = "fisheye" if fisheye else "lens"
            raise self._error(
                key, f"{' or '.join(map(str, counts))} {kind} coefficients", f"{values.size} of them"
            )
        return values

    def _size(self) -> tuple[int, int]:
        key = "size" if "size" in self.values or "image_size" not in self.values else "image_size"
        width, height = self._numbers(key, (2,))
        if min(width, height) < 1 or not (width.is_integer() and height.is_integer()):
            raise self._error(key, "a positive whole width and height in pixels", repr(self.values[key]))
        return int(width), int(height)


def _is_numeric(value: object) -> bool:
    """Whether `value` is a list whose leaves are all numbers (true and false are not)."""
    if isinstance(value, list):
        return all(_is_numeric(item) for item in value)
    return isinstance(value, int | float) and not isinstance(value, bool)


ANIPOSE = CalibrationFormat("anipose", _matches, _parse)
