"""Findings on joints: rejected, uncertain, weak or missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Mask
from skelsplat._words import decimals, length, number
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import Statistics, finite_median

# Most: at least this share.
MOSTLY = 0.5
# A joint's scatter over the typical joint's.
_BAR_RATIO = 2.0
# Names and frame numbers that a sentence lists; the rest are counted.
MOST_NAMES = 6
# What is said of joints that are not determined, by kind of finding.
_STATUS = {
    "weak_joints": "Weak joints, which are written as usual (fewer than two views agree, or equally many "
    "agree on another position)",
    "unobserved_joints": "Unobserved joints (no usable detection, or one view only; they keep their initial "
    "position, if any)",
}
# Frames by kind and joint.
JointFrames = dict[tuple[str, int], list[int]]


def some(joints: Sequence[str]) -> str:
    """Return the joints, the first of many and the number of the others."""
    more = len(joints) - MOST_NAMES
    return ", ".join(joints) if more <= 1 else f"{', '.join(joints[:MOST_NAMES])} and {more} more joints"


def frames_in_words(numbers: Sequence[int], count: int | None = None) -> str:
    """Return the numbers of frames, of many how many they are; ``count`` if not all are named."""
    count = len(numbers) if count is None else count
    if count > MOST_NAMES:
        return f"{count} frames"
    return f"frame{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"


def find_joints(alone: Statistics, statistics: Statistics) -> Iterator[Finding]:
    """Yield findings on joints that most views reject, frame by frame, and on uncertain ones."""
    rejected = tuple(group.name for group in alone.joints if group.rejected_share >= MOSTLY)
    if 0 < len(rejected) <= MOSTLY * len(alone.joints):  # of more, the whole recording is in doubt
        words = f"Most detections are rejected for {some(rejected)}."
        yield Finding("many_rejected", "warning", Subject(joints=rejected), sentence=words)
    typical = finite_median(statistics.scatter_mm)
    names = [group.name for group in statistics.joints]
    wide = {name: finite_median(mm) for name, mm in zip(names, statistics.scatter_mm.T, strict=True)}
    wide = {name: mm for name, mm in wide.items() if mm > _BAR_RATIO * typical}
    if wide:
        sizes = some([f"{name} ({number(mm, decimals(typical, 0))} mm)" for name, mm in wide.items()])
        words = f"Scatter far above the median of {length(typical, 0)} mm: {sizes}."
        numbers = {"median_scatter_mm": typical, "scatter_mm": [*wide.values()]}
        yield Finding("joints_uncertain", "warning", Subject(joints=tuple(wide)), numbers, sentence=words)


def joint_frames(inputs: Inputs, outcome: Outcome, written: npt.NDArray[np.str_]) -> JointFrames:
    """Return the frames in which joints are weak, or unobserved: without a position of their own.

    Not those declared missing, nor those ``written`` (T, N) as filled over time.
    """
    status, placed = np.asarray(outcome.result.joint_status), np.isfinite(outcome.result.pose).all(axis=-1)
    asked = np.array([joint not in inputs.lacking for joint in inputs.layout.joints])
    left, weak = asked & (written != "filled"), status == "weak"
    found: JointFrames = {}
    unobserved = (status == "unobserved") | (weak & ~placed)
    for kind, where in (("weak_joints", left & weak & placed), ("unobserved_joints", left & unobserved)):
        for j in np.flatnonzero(where.any(axis=0)).tolist():
            found[kind, j] = inputs.frames[where[:, j]].tolist()
    return found


def find_statuses(
    inputs: Inputs, outcome: Outcome, found: JointFrames, counts: Mapping[tuple[str, int], int]
) -> Iterator[Finding]:
    """Yield findings on weak and unobserved joints with their frames.

    ``counts`` are of the frames, where ``found`` has the first ones only.
    """
    names, status = inputs.layout.joints, np.asarray(outcome.result.joint_status)
    placed: Mask = np.asarray(np.isfinite(outcome.result.pose).all(axis=-1))
    for kind, label in _STATUS.items():
        by_joint = {j: frames for (own, j), frames in sorted(found.items()) if own == kind}
        if not by_joint:
            continue
        in_all = {j: counts.get((kind, j), len(frames)) for j, frames in by_joint.items()}
        numbers: dict[str, Any] = {"frames": [*by_joint.values()]}
        if any(in_all[j] > len(frames) for j, frames in by_joint.items()):
            numbers["frames_in_all"] = [*in_all.values()]
        told = some([f"{names[j]} ({frames_in_words(own, in_all[j])})" for j, own in by_joint.items()])
        known, remedy = placed, [Remedy("fill_gaps", None)]
        if kind == "weak_joints":
            known, remedy = placed & (status != "weak"), [*remedy, Remedy("fill_weak")]
        there = {j: inputs.frames[known[:, j]] for j in by_joint if known[:, j].any()}
        inside = any(a[0] < t < a[-1] for j, a in there.items() for t in by_joint[j])
        subject = Subject(joints=tuple(names[j] for j in by_joint))
        own = tuple(remedy) if inside else ()  # what lies between frames with the joint can be filled
        yield Finding(kind, "warning", subject, numbers, own, sentence=f"{label}: {told}.")
