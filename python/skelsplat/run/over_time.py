"""Gaps and noise over time, as the options ask for it: parsed, applied, and said in words."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import typer

from skelsplat import temporal
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.cli.options import one_of
from skelsplat.exceptions import InvalidInputError

if TYPE_CHECKING:
    from skelsplat.io import PoseData


@dataclass(frozen=True)
class Butterworth:
    """Low-pass without lag: ``cutoff_hz`` is the −3 dB frequency and ``order`` that of both passes."""

    name: ClassVar[str] = "butterworth"
    cutoff_hz: float = 6.0
    order: int = field(default=4, kw_only=True)


@dataclass(frozen=True)
class OneEuro:
    """Causal low-pass whose cutoff grows with the speed: by ``beta_hz_per_mm_s``, from ``min_cutoff_hz``."""

    name: ClassVar[str] = "one-euro"
    min_cutoff_hz: float = 1.0
    beta_hz_per_mm_s: float = 0.01


Filter = Butterworth | OneEuro


@dataclass(frozen=True)
class OverTime:
    """What to do with gaps and noise over time.

    Parameters
    ----------
    max_gap
        Longest gap to fill, in frames; 0: none.
    method
        ``"cubic"`` or ``"linear"``.
    weak
        Joints with the status ``weak`` are gaps as well.
    filter
        The filter, which then needs a frame rate; None: none.
    """

    max_gap: int = 0
    method: str = "cubic"
    weak: bool = False
    filter: Filter | None = None


def over_time(
    filter_text: str | None, fps: float | None, max_gap: int | None, method: str | None, *, weak: bool
) -> OverTime:
    """Return what the options ask for, tried on three frames so that a fault shows before the work.

    Raises
    ------
    typer.BadParameter
        If an option is not valid or lacks the one it needs.
    MissingPackageError
        If SciPy is needed and not installed.
    """
    for option, given in (("--fill-weak", weak), ("--fill-method", method)):
        if given and not max_gap:
            raise typer.BadParameter("expected --fill-gaps beside it, got none", param_hint=option)
    method = one_of("--fill-method", method or temporal.METHODS[0], temporal.METHODS)
    chosen = None if filter_text is None else _parse(filter_text)
    if chosen is not None and fps is None:
        raise typer.BadParameter("expected --fps beside it, got none", param_hint="--filter")
    if max_gap:
        temporal.fill_gaps([[[0.0] * 3], [[np.nan] * 3], [[0.0] * 3]], 1, method=method)
    try:
        _filtered(np.zeros((3, 1, 3)), np.arange(3), np.zeros((3, 1), dtype=np.bool_), chosen, fps, 1.0)
    except InvalidInputError as error:
        raise typer.BadParameter(str(error), param_hint="--filter") from error
    return OverTime(max_gap or 0, method, weak, chosen)


def _parse(text: str) -> Filter:
    """Return the filter of a text such as ``butterworth:6:4`` or ``one-euro``."""
    name, *values = text.strip().lower().split(":")
    try:
        if name == "butterworth" and len(values) == 2:
            return Butterworth(float(values[0]), order=int(values[1]))
        if name == "butterworth" and len(values) < 2:
            return Butterworth(*map(float, values))
        if name == "one-euro" and len(values) <= 2:
            return OneEuro(*map(float, values))
    except ValueError as error:
        raise typer.BadParameter(
            f"expected numbers after {name}, got {text!r}", param_hint="--filter"
        ) from error
    expected = "butterworth[:HZ[:ORDER]] or one-euro[:HZ[:BETA]]"
    raise typer.BadParameter(f"expected {expected}, got {text!r}", param_hint="--filter")


def apply_over_time(data: PoseData, wanted: OverTime) -> tuple[PoseData, dict[str, Any]]:
    """Fill and filter; return the poses with their status and sentences, and the entry of the report."""
    entry: dict[str, Any] = {"gaps": None, "filter": None}
    sentences = []
    if wanted.max_gap:
        data, count = _filled(data, wanted)
        settings = {"max_frames": wanted.max_gap, "method": wanted.method, "weak_joints_too": wanted.weak}
        entry["gaps"] = {**settings, "filled": count}
        if count:
            what = "Gaps and weak stretches" if wanted.weak else "Gaps"
            sentences.append(
                f"{what} of at most {wanted.max_gap} frames filled by {_METHODS[wanted.method]}: "
                f"{count} joint positions, whose status is filled."
            )
    if wanted.filter is not None:
        mm = MM_PER_UNIT[data.unit]
        weak = (data.joint_status == "weak") & np.isfinite(data.pose).all(axis=-1)
        pose, short = _filtered(data.pose, data.frames, weak, wanted.filter, data.frame_rate, mm)
        data = replace(data, pose=pose)
        left = {"left_as_they_are": short, "weak_left": int(weak.sum())}
        entry["filter"] = {"name": wanted.filter.name, **asdict(wanted.filter), **left}
        sentences.append(f"Low-pass: {_in_words(wanted.filter, left)}. {_UNTOUCHED}")
    data = replace(data, processing=(*data.processing, *sentences))
    return data, {**entry, "processing": list(data.processing)}


def nothing_filled(entry: dict[str, Any]) -> list[str]:
    """Return a sentence if gaps were to be filled and none was, from the entry of the report."""
    gaps = entry["gaps"]
    if gaps is None or gaps["filled"]:
        return []
    return [f"No gap of at most {gaps['max_frames']} frames between others, so that none was filled."]


_METHODS = {"cubic": "cubic splines", "linear": "straight lines"}
_UNTOUCHED = "Uncertainties, weights and reprojection errors are those before it."


def _filled(data: PoseData, wanted: OverTime) -> tuple[PoseData, int]:
    """Fill the gaps; return the poses and how many joint positions were put in."""
    pose, filled = temporal.fill_gaps(
        data.pose,
        wanted.max_gap,
        method=wanted.method,
        frames=data.frames,
        gaps=data.joint_status == "weak" if wanted.weak else None,
    )
    return replace(
        data,
        pose=pose,
        joint_status=np.where(filled, "filled", data.joint_status),
        uncertainty=np.where(filled[..., None, None], np.nan, data.uncertainty),
    ), int(filled.sum())


def _filtered(
    pose: temporal.Array,
    frames: Any,
    weak: temporal.Mask,
    chosen: Filter | None,
    fps: float | None,
    mm: float,
) -> tuple[temporal.Array, int]:
    """Filter poses whose unit is ``mm`` millimetres; also return how many were in runs too short for it."""
    if isinstance(chosen, Butterworth) and fps is not None:
        result, left = temporal.butterworth(
            pose, fps, chosen.cutoff_hz, order=chosen.order, frames=frames, weak=weak
        )
        return result, int((left & ~weak).sum())
    if isinstance(chosen, OneEuro) and fps is not None:
        cutoff, beta = chosen.min_cutoff_hz, chosen.beta_hz_per_mm_s * mm
        return temporal.one_euro(pose, fps, min_cutoff=cutoff, beta=beta, frames=frames, weak=weak), 0
    return pose, 0


def _in_words(chosen: Filter, left: dict[str, int]) -> str:
    if isinstance(chosen, OneEuro):
        speed = f"{chosen.beta_hz_per_mm_s:g} Hz per mm/s"
        text = f"one-euro filter, {chosen.min_cutoff_hz:g} Hz at rest and {speed}, causal"
    else:
        text = f"Butterworth of order {chosen.order}, −3 dB at {chosen.cutoff_hz:g} Hz, both ways, no lag"
    if left["weak_left"] == 1:
        text += "; 1 weak joint position is left as it is and does not pull on others"
    elif left["weak_left"]:
        text += f"; {left['weak_left']} weak joint positions are left as they are and do not pull on others"
    if left["left_as_they_are"]:
        text += f"; {left['left_as_they_are']} joint positions in runs too short for it are as they were"
    return text
