"""What all readers share: the files they look for, the values in these, and cameras made of them.

Every error names the file and the field.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import FARTHEST, Array, Index
from skelsplat._fields import Field
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io import _arrays, read_calibration


@dataclass
class Survey:
    """The files that a reader looks for."""

    there: list[Path] = field(default_factory=list)
    missing: list[tuple[Path, str]] = field(default_factory=list)  #: Where, and what it would hold.
    format: str = ""  #: The layout on disk; "" if the data set has only one.
    notes: list[str] = field(default_factory=list)  #: What was left out or assumed.

    def find(self, candidates: Sequence[Path], what: str) -> Path:
        """Return the first of `candidates` that exists."""
        path = next((path for path in candidates if path.exists()), None)
        if path is None:
            raise self.lacks(candidates, what)
        return self.found(path)

    def found(self, path: Path) -> Path:
        """Note that a file is there."""
        if path not in self.there:
            self.there.append(path)
        return path

    def lacks(self, candidates: Sequence[Path], what: str) -> DatasetError:
        """Note that a file is missing; return the error."""
        self.missing.append((candidates[0], what))
        others = "".join(f", nor at {path}" for path in candidates[1:])
        return DatasetError(candidates[0], "file", what, f"nothing there{others}")

    def find_all(self, files: Iterable[tuple[Path, str]]) -> list[Path]:
        """Return files that must all be there, given with what they hold; note all that are missing."""
        expected = list(files)
        errors = [self.lacks([path], what) for path, what in expected if not path.exists()]
        if errors:
            raise errors[0]
        return [self.found(path) for path, _ in expected]


def frames_in(content: Field) -> Index:
    """Return the ascending ``frames`` (T,) of a file."""
    return _arrays.frame_numbers(content.path, content.member("frames", "frame numbers").value)


@contextmanager
def making(path: Path, field: str, what: str) -> Iterator[None]:
    """Raise `DatasetError` for what is refused when values of a file become a camera, say."""
    try:
        yield
    except InvalidInputError as error:
        raise DatasetError(path, field, what, error) from error


def camera_at_centre(entry: Field, *, size: Sequence[int], name: str) -> Camera:
    """Return the camera of a table R, T, fx, fy, cx, cy[, k, p] where x_cam = R (X − T): T is the centre.

    Numbers may be wrapped in arrays of any shape with as many values; ``k`` are three and ``p`` two. A
    distortion that is all zeros is none.
    """

    def values(key: str, count: int) -> Array:
        given = entry[key].array().ravel()
        if given.shape != (count,) or not (np.abs(given) <= FARTHEST).all():
            raise entry[key].error(f"{count} numbers within ±{FARTHEST:g}", given.tolist())
        return given

    fx, fy, cx, cy = (values(key, 1)[0] for key in ("fx", "fy", "cx", "cy"))
    R, lens = values("R", 9).reshape(3, 3), np.zeros(5)
    if "k" in entry or "p" in entry:
        k, p = values("k", 3), values("p", 2)
        lens = np.array([k[0], k[1], p[0], p[1], k[2]])
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    with making(entry.path, entry.place, "a camera"):
        distortion = lens if np.any(lens) else None
        return Camera(K, R, -R @ values("T", 3), distortion=distortion, size=size, name=name)


def build_rig(path: Path, cameras: Sequence[Camera]) -> CameraRig:
    """Return cameras in mm as a rig."""
    with making(path, "cameras", "a rig"):
        return CameraRig(cameras, "mm")


def read_cameras(path: Path, format: str, names: Sequence[str] | None = None, **options: Any) -> CameraRig:
    """Read the cameras of these names, in this order; None is all.

    Doubts about the unit are not reported here: verification by reprojection has the numbers.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        rig = read_calibration(path, format=format, **options)
    for name in names or ():
        if name not in rig.names:
            raise DatasetError(path, "cameras", f"camera {name}", f"only {', '.join(sorted(rig.names))}")
    return rig if names is None else CameraRig([rig[name] for name in names], rig.unit)
