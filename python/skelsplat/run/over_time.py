"""Gap filling and filtering over time, applied and described in words."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat import temporal
from skelsplat._arrays import Array, Index, Mask
from skelsplat.exceptions import InvalidInputError

if TYPE_CHECKING:
    from skelsplat.io import PoseData
    from skelsplat.run.job import Job


# Numbers that may follow the name of the filter, with their defaults: zero-lag, with −3 dB at the cutoff and
# the order of both passes.
_BUTTERWORTH: dict[str, float] = {"cutoff_hz": 6.0, "order": 4}
Filter = dict[str, Any]  # its name and numbers


def parse_filter(text: str) -> Filter:
    """Return the filter of a text such as ``butterworth`` or ``butterworth:6:4``."""
    name, *values = text.strip().lower().split(":")
    if name != "butterworth" or len(values) > len(_BUTTERWORTH):
        raise InvalidInputError(f"filter: expected butterworth[:HZ[:ORDER]], got {text!r}")
    given = zip(_BUTTERWORTH.items(), values, strict=False)
    try:
        return {"name": name, **_BUTTERWORTH, **{key: type(usual)(value) for (key, usual), value in given}}
    except ValueError as error:
        raise InvalidInputError(f"filter: expected numbers after {name}, got {text!r}") from error


def try_over_time(job: Job) -> None:
    """Fill and filter three frames, so that wrong numbers and missing packages are errors before the work."""
    if job.fill_gaps:
        temporal.fill_gaps([[[0.0] * 3], [[np.nan] * 3], [[0.0] * 3]], 1)
    if job.low_pass is not None and job.rates:
        try:
            none = np.zeros((3, 1), dtype=np.bool_)
            _filtered(job.low_pass, np.zeros((3, 1, 3)), np.arange(3), none, min(job.rates))
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
        pose, short = _filtered(low_pass, data.pose, data.frames, weak, data.frame_rate)
        data = replace(data, pose=pose)
        left = {"left_as_they_are": short, "weak_left": int(weak.sum())}
        entry["filter"] = {**low_pass, **left}
        unchanged = f"weak joint positions are unchanged ({weak.sum()}) and do not influence other frames"
        words = f"Low-pass: Butterworth of order {low_pass['order']}, −3 dB at {low_pass['cutoff_hz']:g} Hz, "
        words += f"zero-lag (forward and backward){f'; {unchanged}' if weak.any() else ''}"
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


def _filtered(low_pass: Filter, pose: Array, frames: Index, weak: Mask, fps: float) -> tuple[Array, int]:
    """Filter poses; also return how many were in runs too short for it."""
    cutoff, order = low_pass["cutoff_hz"], low_pass["order"]
    result, left = temporal.butterworth(pose, fps, cutoff, order=order, frames=frames, weak=weak)
    return result, int((left & ~weak).sum())
