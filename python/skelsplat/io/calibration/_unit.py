"""The length unit of a calibration, checked against how far apart the cameras stand, and converted."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat.cameras import MM_PER_UNIT, altered
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, FindingWarning, Subject
from skelsplat.io.calibration._format import Array

# from a macro rig on a table to a stadium; outside it the unit is wrong rather than the rig unusual
_PLAUSIBLE_M = (0.05, 100.0)
# cameras of a room stand about this far apart; the likely unit is the one that comes closest
_TYPICAL_M = 4.0


def check_unit(path: Path, centres: Sequence[Array], unit: str | None, *, stated: str | None = None) -> str:
    """Return the unit that is given or stated; warn if the cameras' spread makes it implausible.

    Parameters
    ----------
    path : Path
        The calibration file, for messages.
    centres : sequence of (3,)
        Camera centres in the file's unit.
    unit : str or None
        What the caller says.
    stated : str or None
        What the format or the file says.
    """
    spread = _spread(centres)
    if stated is not None:
        if unit not in (None, stated):
            raise InvalidInputError(f'unit: expected none or "{stated}", the unit of {path}, got {unit!r}')
        unit = stated
    if unit is None:
        raise InvalidInputError(f'unit: expected "mm", "cm" or "m" for {path}, got none; {_hint(spread)}')
    if unit not in MM_PER_UNIT:
        raise InvalidInputError(f'unit: expected "mm", "cm" or "m", got {unit!r}')
    metres = spread * MM_PER_UNIT[unit] / 1000.0
    if spread > 0.0 and not _PLAUSIBLE_M[0] <= metres <= _PLAUSIBLE_M[1]:
        numbers = {"metres": metres, "unit": unit, "spread": spread, "likely": _likely(spread)}
        subject = Subject(files=(str(path),))
        warnings.warn(FindingWarning(Finding("unit_implausible", "warning", subject, numbers)), stacklevel=3)
    return unit


def _spread(centres: Sequence[Array]) -> float:
    """Largest distance between two camera centres, in the file's unit; 0 for one camera."""
    points = np.stack(centres)
    return float(np.linalg.norm(points[:, None] - points[None], axis=-1).max())


def _hint(spread: float) -> str:
    if spread == 0.0:
        return "one camera gives no hint of it"
    return (
        f'the largest distance between cameras is {spread:.4g} in the file, so "{_likely(spread)}" is likely'
    )


def _likely(spread: float) -> str:
    return min(MM_PER_UNIT, key=lambda name: abs(np.log(spread * MM_PER_UNIT[name] / 1000.0 / _TYPICAL_M)))


def convert_unit(rig: sk.CameraRig, unit: str) -> sk.CameraRig:
    """Return the same cameras with lengths in another unit.

    Raises
    ------
    InvalidInputError
        If the unit is not mm, cm or m.
    """
    if unit not in MM_PER_UNIT:
        raise InvalidInputError(f'unit: expected "mm", "cm" or "m", got {unit!r}')
    factor = rig.mm_per_unit / MM_PER_UNIT[unit]
    cameras = [altered(camera, t=np.asarray(camera.t) * factor) for camera in rig]
    return sk.CameraRig(cameras, unit=unit)
