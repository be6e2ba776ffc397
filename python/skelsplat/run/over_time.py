"""Gap filling and filtering over time, applied and described in words."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from skelsplat import temporal
from skelsplat._arrays import Array, Index, Mask
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import InvalidInputError

if TYPE_CHECKING:
    from skelsplat.io import PoseData
    from skelsplat.run.job import Job

_METHODS = {"cubic": "cubic splines", "linear": "straight lines"}


@dataclass(frozen=True)
class Butterworth:
    """Low-pass without lag: ``cutoff_hz`` is the −3 dB frequency and ``order`` that of both passes."""

    name: ClassVar[str] = "butterworth"
    cutoff_hz: float = 6.0
    order: int = field(default=4, kw_only=True)

    def __str__(self) -> str:
        zero_lag = "zero-lag (forward and backward)"
        return f"Butterworth of order {self.order}, −3 dB at {self.cutoff_hz:g} Hz, {zero_lag}"


@dataclass(frozen=True)
class OneEuro:
    """Causal low-pass whose cutoff grows with the speed: by ``beta_hz_per_mm_s``, from ``min_cutoff_hz``."""

    name: ClassVar[str] = "one-euro"
    min_cutoff_hz: float = 1.0
    beta_hz_per_mm_s: float = 0.01

    def __str__(self) -> str:
        speed = f"{self.beta_hz_per_mm_s:g} Hz per mm/s"
        return f"one-euro filter, {self.min_cutoff_hz:g} Hz at rest and {speed}, causal"


Filter = Butterworth | OneEuro


def parse_filter(text: str) -> Filter:
    """Return the filter of a text such as ``butterworth:6:4`` or ``one-euro``.

    Raises
    ------
    InvalidInputError
        If the text names no filter, or anything but numbers follows the name.
    """
    name, *values = text.strip().lower().split(":")
    try:
        if name == "butterworth" and len(values) <= 2:
            order = int(values[1]) if len(values) == 2 else Butterworth.order
            return Butterworth(*map(float, values[:1]), order=order)
        if name == "one-euro" and len(values) <= 2:
            return OneEuro(*map(float, values))
    except ValueError as error:
        raise InvalidInputError(f"filter: expected numbers after {name}, got {text!r}") from error
    expected = "butterworth[:HZ[:ORDER]] or one-euro[:HZ[:BETA]]"
    raise InvalidInputError(f"filter: expected {expected}, got {text!r}")


def try_over_time(job: Job) -> None:
    """Fill and filter three frames, so that errors are raised before the work.

    Raises
    ------
    InvalidInputError
        If the filter's numbers are not valid at the frame rate.
    MissingPackageError
        If SciPy is needed and not installed.
    """
    if job.fill_gaps:
        temporal.fill_gaps([[[0.0] * 3], [[np.nan] * 3], [[0.0] * 3]], 1, method=job.interpolation)
    if job.low_pass is not None and job.fps is not None:
        try:
            none = np.zeros((3, 1), dtype=np.bool_)
            _filtered(job.low_pass, np.zeros((3, 1, 3)), np.arange(3), none, job.fps, 1.0)
        except InvalidInputError as error:
            raise InvalidInputError(f"filter: {error}") from error


def apply_over_time(data: PoseData, job: Job | None) -> tuple[PoseData, dict[str, Any]]:
    """Fill and filter; return the poses with their status and sentences, and the entry of the report."""
    entry: dict[str, Any] = {"gaps": None, "filter": None}
    sentences = []
    if job is not None and job.fill_gaps:
        data, count = _filled(data, job)
        settings = {"max_frames": job.fill_gaps, "method": job.interpolation}
        entry["gaps"] = {**settings, "weak_joints_too": job.fill_weak, "filled": count}
        if count:
            what = "Gaps and weak stretches" if job.fill_weak else "Gaps"
            sentences.append(
                f"{what} of at most {job.fill_gaps} frames filled by {_METHODS[job.interpolation]}: "
                f"{count} joint positions, whose status is filled."
            )
    low_pass = None if job is None else job.low_pass
    if low_pass is not None and data.frame_rate is not None:
        weak = (data.joint_status == "weak") & np.isfinite(data.pose).all(axis=-1)
        mm = MM_PER_UNIT[data.unit]
        pose, short = _filtered(low_pass, data.pose, data.frames, weak, data.frame_rate, mm)
        data = replace(data, pose=pose)
        left = {"left_as_they_are": short, "weak_left": int(weak.sum())}
        entry["filter"] = {"name": low_pass.name, **asdict(low_pass), **left}
        unchanged = f"weak joint positions are unchanged ({weak.sum()}) and do not influence other frames"
        words = f"Low-pass: {low_pass}{f'; {unchanged}' if weak.any() else ''}"
        words += f"; {short} joint positions in runs too short for it are unchanged" if short else ""
        sentences.append(
            f"{words}. Uncertainties, weights and reprojection errors are from before filtering."
        )
    data = replace(data, processing=(*data.processing, *sentences))
    return data, {**entry, "processing": list(data.processing)}


def _filled(data: PoseData, job: Job) -> tuple[PoseData, int]:
    """Fill the gaps; return the poses and how many joint positions were put in."""
    pose, filled = temporal.fill_gaps(
        data.pose,
        job.fill_gaps,
        method=job.interpolation,
        frames=data.frames,
        gaps=data.joint_status == "weak" if job.fill_weak else None,
    )
    return replace(
        data,
        pose=pose,
        joint_status=np.where(filled, "filled", data.joint_status),
        uncertainty=np.where(filled[..., None, None], np.nan, data.uncertainty),
    ), int(filled.sum())


def _filtered(
    low_pass: Filter, pose: Array, frames: Index, weak: Mask, fps: float, mm: float
) -> tuple[Array, int]:
    """Filter poses whose unit is ``mm`` millimetres; also return how many were in runs too short for it."""
    if isinstance(low_pass, OneEuro):
        cutoff, beta = low_pass.min_cutoff_hz, low_pass.beta_hz_per_mm_s * mm
        return temporal.one_euro(pose, fps, min_cutoff=cutoff, beta=beta, frames=frames, weak=weak), 0
    cutoff, order = low_pass.cutoff_hz, low_pass.order
    result, left = temporal.butterworth(pose, fps, cutoff, order=order, frames=frames, weak=weak)
    return result, int((left & ~weak).sum())
