"""What every calibration format is parsed into."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RawCamera:
    """One camera as its file gives it, lengths in the file's unknown unit.

    Attributes
    ----------
    table : str
        Where in the file it stands, for messages.
    name : str
    K : (3, 3) pixels
    R : (3, 3) world → camera
    t : (3,) world → camera
    distortion : (n,) or None
    fisheye : bool
    size : (width, height) pixels
    """

    table: str
    name: str
    K: Array
    R: Array
    t: Array
    distortion: Array | None
    fisheye: bool
    size: tuple[int, int]

    def centre(self) -> Array:
        """Camera centre in the world (3,), −Rᵀt."""
        return -self.R.T @ self.t


@dataclass(frozen=True)
class CalibrationFormat:
    """A registered format: `matches` looks at a file's text, `parse` turns it into at least one camera."""

    name: str
    matches: Callable[[str], bool]
    parse: Callable[[Path, str], list[RawCamera]]
