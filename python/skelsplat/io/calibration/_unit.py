"""Whether a length unit is plausible for a rig, and which one is likely."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.findings import Finding, FindingWarning, Subject

# how far apart cameras are, from a macro rig on a table to a stadium; outside it the unit is wrong rather
# than the rig unusual, except under a microscope: with fields of view below 14°
_PLAUSIBLE_M = (0.05, 100.0)
_SMALLEST_M, _NARROW = 1e-4, 4.0
# on a table or in a room; a unit that alone puts the cameras so far apart is likely
_USUAL_M = (0.1, 15.0)


def check_unit(path: Path, rig: Sequence[sk.Camera], unit: str | None, *, stated: str | None = None) -> str:
    """Return the unit, given or `stated` by the file; warn if the cameras' spread makes it implausible."""
    spread, narrow = _spread([np.asarray(camera.centre) for camera in rig]), _is_narrow(rig)
    if stated is not None:
        if unit not in (None, stated):
            raise InvalidInputError(f'unit: expected none or "{stated}", the unit of {path}, got {unit!r}')
        unit = stated
    if unit is None:
        actual = f"none; {_hint(spread, narrow)}"
        raise InvalidInputError(f'unit: expected "mm", "cm" or "m" for {path}, got {actual}')
    one_of("unit", unit, MM_PER_UNIT)
    metres = _metres(spread)[unit]
    least = _SMALLEST_M if narrow else _PLAUSIBLE_M[0]
    if spread > 0.0 and not least <= metres <= _PLAUSIBLE_M[1]:
        numbers = {"metres": metres, "unit": unit, "spread": spread, "hint": _hint(spread, narrow)}
        words = f"{path}: unit: if it is {unit}, the cameras are {_length(metres)} apart; {numbers['hint']}"
        subject = Subject(files=(str(path),))
        finding = Finding("unit_wrong", "warning", subject, numbers, sentence=words)
        warnings.warn(FindingWarning(finding), stacklevel=3)
    return unit


def _spread(centres: Sequence[Array]) -> float:
    """Largest distance between two camera centres, in the file's unit; 0 for one camera."""
    points = np.stack(centres)
    return max(float(np.linalg.norm(point - points, axis=-1).max()) for point in points)


def _is_narrow(rig: Sequence[sk.Camera]) -> bool:
    """Whether the cameras look through telescopes or microscopes: their focal length is 4 images wide."""
    return float(np.median([camera.K[0, 0] / max(camera.size) for camera in rig])) > _NARROW


def _metres(spread: float) -> dict[str, float]:
    return {name: spread * factor / 1000.0 for name, factor in MM_PER_UNIT.items()}


def _hint(spread: float, narrow: bool) -> str:
    """Return which unit is likely, if only one is, and what each would mean."""
    if spread == 0.0:
        return "one camera gives no hint of it"
    metres = _metres(spread)
    usual = [] if narrow else [name for name in metres if _USUAL_M[0] <= metres[name] <= _USUAL_M[1]]
    so = f'so "{usual[0]}" is likely' if len(usual) == 1 else "that is " + _meanings(metres, usual)
    return f"the largest distance between cameras is {spread:.4g} in the file, {so}"


def _meanings(metres: Mapping[str, float], usual: Sequence[str]) -> str:
    parts = [f'{_length(metres[name])} in "{name}"' for name in usual or metres]
    return f"{', '.join(parts[:-1])} or {parts[-1]}"


def _length(metres: float) -> str:
    if metres < 0.1:
        return f"{metres * 1000:.2g} mm"
    return f"{metres:.2g} m" if metres < 99.5 else f"{metres:.0f} m"
