"""Gap filling and filtering over time, applied and described in words."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat import temporal
from skelsplat._arrays import Array, Index, Mask
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import InvalidInputError

if TYPE_CHECKING:
    from skelsplat.io import PoseData
    from skelsplat.run.job import Job


# Numbers that may follow the name of a filter, with their defaults. "butterworth" is zero-lag, with −3 dB at
# the cutoff and the order of both passes; "one-euro" is causal, and its cutoff grows with the speed.
_FILTERS: dict[str, dict[str, float]] = {
    "butterworth": {"cutoff_hz": 6.0, "order": 4},
    "one-euro": {"min_cutoff_hz": 1.0, "beta_hz_per_mm_s": 0.01},
}
Filter = dict[str, Any]  # its name and numbers


def parse_filter(text: str) -> Filter:
    """Return the filter of a text such as ``butterworth:6:4`` or ``one-euro``."""
    name, *values = text.strip().lower().split(":")
    known = _FILTERS.get(name, {})
    if len(values) > len(known) or not known:
        expected = "butterworth[:HZ[:ORDER]] or one-euro[:HZ[:BETA]]"
        raise InvalidInputError(f"filter: expected {expected}, got {text!r}")
    try:
        given = {key: type(known[key])(value) for key, value in zip(known, values, strict=False)}
    except ValueError as error:
        raise InvalidInputError(f"filter: expected numbers after {name}, got {text!r}") from error
    return {"name": name, **known, **given}


def try_over_time(job: Job) -> None:
    """Fill and filter three frames, so that wrong numbers and missing packages are errors before the work."""
    if job.fill_gaps:
        temporal.fill_gaps([[[0.0] * 3], [[np.nan] * 3], [[0.0] * 3]], 1)
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
        entry["gaps"] = {"max_frames": job.fill_gaps, "weak_joints_too": job.fill_weak, "filled": count}
        if count:
            what = "Gaps and weak stretches" if job.fill_weak else "Gaps"
            sentences.append(
                f"{what} of at most {job.fill_gaps} frames filled by cubic splines: "
                f"{count} joint positions, whose status is filled."
            )
    low_pass = None if job is None else job.low_pass
    if low_pass is not None and data.frame_rate is not None:
        weak = (data.joint_status == "weak") & np.isfinite(data.pose).all(axis=-1)
        mm = MM_PER_UNIT[data.unit]
        pose, short = _filtered(low_pass, data.pose, data.frames, weak, data.frame_rate, mm)
        data = replace(data, pose=pose)
        left = {"left_as_they_are": short, "weak_left": int(weak.sum())}
        entry["filter"] = {**low_pass, **left}
        unchanged = f"weak joint positions are unchanged ({weak.sum()}) and do not influence other frames"
        words = f"Low-pass: {_in_words(low_pass)}{f'; {unchanged}' if weak.any() else ''}"
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
    if low_pass["name"] == "one-euro":
        cutoff, beta = low_pass["min_cutoff_hz"], low_pass["beta_hz_per_mm_s"] * mm
        return temporal.one_euro(pose, fps, min_cutoff=cutoff, beta=beta, frames=frames, weak=weak), 0
    cutoff, order = low_pass["cutoff_hz"], low_pass["order"]
    result, left = temporal.butterworth(pose, fps, cutoff, order=order, frames=frames, weak=weak)
    return result, int((left & ~weak).sum())


def _in_words(low_pass: Filter) -> str:
    if low_pass["name"] == "one-euro":
        speed = f"{low_pass['beta_hz_per_mm_s']:g} Hz per mm/s"
        return f"one-euro filter, {low_pass['min_cutoff_hz']:g} Hz at rest and {speed}, causal"
    cutoff = f"−3 dB at {low_pass['cutoff_hz']:g} Hz"
    return f"Butterworth of order {low_pass['order']}, {cutoff}, zero-lag (forward and backward)"
