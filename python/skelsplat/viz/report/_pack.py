"""Arrays of a sequence as short text: whole numbers of a stated size, base64."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

MISSING = -32768
_LARGEST = 32767
# Ellipsoids are drawn up to this standard deviation, in mm: a body's height.
_WIDEST_MM = 2000.0


@dataclass(frozen=True)
class Grid:
    """Whole numbers for positions: position = origin + step · number, in mm."""

    origin: Array
    step: float

    @classmethod
    def over(cls, low: Array, high: Array) -> Grid:
        """Return the finest grid of 16-bit numbers that covers a box."""
        return cls((low + high) / 2, max(float((high - low).max()), 1.0) / (2 * _LARGEST))

    def pack(self, positions: Array) -> str:
        """Return positions (…, 3) as text; what is NaN or outside the box becomes `MISSING`."""
        numbers = np.rint((positions - self.origin) / self.step)
        inside = (np.abs(numbers) <= _LARGEST).all(axis=-1, keepdims=True)  # False for NaN
        return as_text(np.where(inside, numbers, MISSING), "<i2")


def pack_spreads(covariances: Array) -> dict[str, Any]:
    """Return the symmetric roots of covariances (…, 3, 3) in mm²: xx, xy, xz, yy, yz, zz of each joint.

    A root turns the unit sphere into the ellipsoid of one standard deviation. None is wider than 2 m.
    """
    known = np.asarray(np.isfinite(covariances).all(axis=(-2, -1)))
    values, vectors = np.linalg.eigh(np.where(known[..., None, None], covariances, 0.0))
    widths = np.sqrt(np.clip(values, 0.0, _WIDEST_MM**2))
    roots = (vectors * widths[..., None, :]) @ np.swapaxes(vectors, -2, -1)
    six = roots[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    step = max(float(np.abs(six).max(initial=0.0)), 1.0) / _LARGEST
    numbers = np.where(known[..., None], np.rint(six / step), MISSING)
    return {"step_mm": step, "numbers": as_text(numbers, "<i2")}


def pack_labels(labels: npt.NDArray[np.str_]) -> dict[str, Any]:
    """Return labels as one byte each, with the list that the bytes count from."""
    names, places = np.unique(labels, return_inverse=True)
    return {"names": names.tolist(), "numbers": as_text(places, "<u1")}


def as_text(values: npt.NDArray[Any], kind: str) -> str:
    """Return the bytes of an array, as numbers of a kind such as ``"<f4"``, in base64."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
