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
        yield Finding(
            "many_rejected",
            "warning",
            Subject(joints=rejected),
            sentence=f"Most detections are rejected for {some(rejected)}.",
        )
    typical = finite_median(statistics.scatter_mm)
    scatter = [finite_median(joint) for joint in statistics.scatter_mm.T]
    wide = [j for j, own in enumerate(scatter) if own > _BAR_RATIO * typical]
    if wide:
        named = tuple(statistics.joints[j].name for j in wide)
        digits = decimals(typical, 0)
        sizes = [f"{name} ({number(scatter[j], digits)} mm)" for name, j in zip(named, wide, strict=True)]
        yield Finding(
            "joints_uncertain",
            "warning",
            Subject(joints=named),
            {"median_scatter_mm": typical, "scatter_mm": [scatter[j] for j in wide]},
            sentence=f"Scatter far above the median of {length(typical, 0)} mm: {some(sizes)}.",
        )


# Frames by joint, of a kind of finding on statuses, those filled over time apart.
JointFrames = dict[tuple[str, bool], dict[int, list[int]]]


def joint_frames(inputs: Inputs, outcome: Outcome, written: npt.NDArray[np.str_]) -> JointFrames:
    """Return the frames in which joints are weak or unobserved, by their place in the layout.

    ``written`` (T, N) is the status of the poses written, where joints may be filled over time.
    """
    status, filled = np.asarray(outcome.result.joint_status), written == "filled"
    placed = np.isfinite(outcome.result.pose).all(axis=-1)
    asked = np.array([joint not in inputs.lacking for joint in inputs.layout.joints])
    found: JointFrames = {}
    for kind, where in (
        ("weak_joints", (status == "weak") & placed),
        ("joints_without_position", (status == "weak") & ~placed),
        ("unobserved_joints", status == "unobserved"),
    ):
        for left, done in ((where & asked & ~filled, False), (where & asked & filled, True)):
            for j in np.flatnonzero(left.any(axis=0)).tolist():
                found.setdefault((kind, done), {})[j] = inputs.frames[left[:, j]].tolist()
    return found


def find_statuses(
    inputs: Inputs, outcome: Outcome, found: JointFrames, counts: Mapping[Any, int]
) -> Iterator[Finding]:
    """Yield findings on weak and unobserved joints with their frames, those not filled first.

    ``counts`` are of the frames by kind, filled or not, and joint, where ``found`` names the first ones only.
    What lies between frames in which the joint is known can be filled.
    """
    names, placed = inputs.layout.joints, np.isfinite(np.asarray(outcome.result.pose)).all(axis=-1)
    weak = np.asarray(outcome.result.joint_status) == "weak"
    for kind, filled in ((kind, filled) for kind in _STATUS for filled in (False, True)):
        by_joint = dict(sorted(found.get((kind, filled), {}).items()))
        if not by_joint:
            continue
        label, meaning, note, remedy = _STATUS[kind]
        known: Mask = placed & ~(weak & (kind == "weak_joints"))
        there = {j: inputs.frames[known[:, j]] for j in by_joint if known[:, j].any()}
        inside = any(a[0] < t < a[-1] for j, a in there.items() for t in by_joint[j])
        in_all = [counts[kind, filled, j] if counts else len(frames) for j, frames in by_joint.items()]
        pairs = zip(by_joint.items(), in_all, strict=True)
        listed = some([f"{names[j]} ({frames_in_words(own, count)})" for (j, own), count in pairs])
        yield Finding(
            kind,
            "warning",
            Subject(joints=tuple(names[j] for j in by_joint)),
            {
                "frames": list(by_joint.values()),
                "filled": filled,
                **({"frames_in_all": in_all} if counts else {}),
            },
            remedy if inside and not filled else (),
            sentence=f"{label}, now filled from neighbouring frames: {listed}."
            if filled
            else f"{label} ({meaning}): {listed}.{note}",
        )


# Of each status in which a joint is not determined: its name, what it means, what is done about it, and what
# helps between frames in which the joint is known.
_GAPS = Remedy("fill_gaps", None)
_STATUS: dict[str, tuple[str, str, str, tuple[Remedy, ...]]] = {
    "weak_joints": (
        "Weak joints",
        "fewer than two views agree, or equally many agree on another position",
        " They are written as usual.",
        (_GAPS, Remedy("fill_weak")),
    ),
    "joints_without_position": (
        "Weak joints without a position",
        "detected in one view only, or in views from the same place",
        "",
        (_GAPS,),
    ),
    "unobserved_joints": (
        "Unobserved joints",
        "no usable detection; they keep their initial position, if any",
        "",
        (),
    ),
}
