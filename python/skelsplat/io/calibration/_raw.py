"""What every calibration format is parsed into, and what a format is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from skelsplat.io.calibration._source import Source

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RawCamera:
    """One camera as its file gives it, lengths in the file's unit.

    Attributes
    ----------
    table : str
        Where in the file it stands, for messages.
    name : str
    K : (3, 3) pixels
    R : (3, 3) world → camera, to the digits of the file
    t : (3,) world → camera
    distortion : (n,) in OpenCV's order, or None
    fisheye : bool
    size : (width, height) pixels, or None if the format has no place for it
    """

    table: str
    name: str
    K: Array
    R: Array
    t: Array
    distortion: Array | None
    fisheye: bool
    size: tuple[int, int] | None


@dataclass(frozen=True)
class Parsed:
    """The cameras of a file, and their unit (mm, cm or m) if the format or the file says which it is."""

    cameras: Sequence[RawCamera]
    unit: str | None = None


@dataclass(frozen=True)
class Options:
    """What only some formats need to be told; None is a format's default.

    Attributes
    ----------
    camera_type : which of a file's cameras: a type that the format names, or "all"
    subject : whose extrinsics, where a file holds several recordings
    size : (width, height) of all images, or of each camera's by name
    binning : how many pixels of the sensor a pixel of the image is wide
    """

    camera_type: str | None = None
    subject: str | None = None
    size: tuple[int, int] | Mapping[str, tuple[int, int]] | None = None
    binning: float | None = None


@dataclass(frozen=True)
class CalibrationFormat:
    """A registered format: `matches` looks at a source, `parse` turns it into at least one camera.

    `options` names the fields of `Options` that the format takes; any other that is given is refused.
    """

    name: str
    describes: str
    matches: Callable[[Source], bool]
    parse: Callable[[Source, Options], Parsed]
    options: frozenset[str] = frozenset()
