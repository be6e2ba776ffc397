"""Findings on whether a run follows one person."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat._crowd import MIXED, limb_spread
from skelsplat.findings import Finding, Remedy, Subject

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skelsplat._crowd import Crowd, LimbSpread
    from skelsplat.run.read import Inputs
    from skelsplat.run.solve import Outcome

# No distribution has more than 1/9 beyond four standard deviations from its median: the median is within one
# of the mean, and Chebyshev's inequality leaves 1/9 beyond three from the mean.
_OFF_SHARE = 1 / 9
# Part of the frames in which another person is as visible as the one followed: not just passing.
_TOGETHER = 0.25
_CONSISTENT = (Remedy("person", "consistent"),)


def find_people(inputs: Inputs, outcome: Outcome) -> Iterator[Finding]:
    """Yield findings on mixed people, on others as visible, and on limbs of varying length."""
    if inputs.crowd is not None:
        mixed = are_mixed(inputs)
        if mixed:
            yield _mixed(inputs.person, inputs.crowd)
        if inputs.crowd.together.mean() >= _TOGETHER:
            yield _others(inputs.person, inputs.crowd, mixed=mixed)
    yield from find_lengths(inputs, _spread(inputs, outcome))


def are_mixed(inputs: Inputs) -> bool:
    """Whether the detections are of several people, chosen without a comparison of the views."""
    return inputs.crowd is not None and inputs.person != "consistent" and inputs.crowd.mixes


def _mixed(person: str, crowd: Crowd) -> Finding:
    share = float(crowd.mixed.mean())
    if share >= MIXED:  # hardly a step is left to judge
        numbers = {"person": person, "different_people_share": share}
    else:
        numbers = {"person": person, "changes": crowd.changed, "steps": crowd.compared}
    return Finding("people_mixed", "warning", numbers=numbers, remedy=_CONSISTENT)


def _others(person: str, crowd: Crowd, *, mixed: bool) -> Finding:
    choices = ("consistent",) if mixed else ("consistent", "largest")
    numbers = {
        "person": person,
        "people": max(2, crowd.visible),
        "share_of_frames": float(crowd.together.mean()),
        "mixed": mixed,
    }
    remedy = tuple(Remedy("person", choice) for choice in choices if choice != person)
    return Finding("people_visible", "warning", numbers=numbers, remedy=remedy)


def _spread(inputs: Inputs, outcome: Outcome) -> LimbSpread:
    """Measure the segments of arms and legs, which have a fixed length."""
    result = outcome.result
    limbs = [limb for pair in inputs.layout.symmetric_pairs(2) for limb in pair]
    known = np.asarray(result.joint_status) == "ok"
    return limb_spread(np.asarray(result.pose), np.asarray(result.uncertainty), known, limbs)


def find_lengths(inputs: Inputs, spread: LimbSpread) -> Iterator[Finding]:
    """Yield a finding on the limb that varies most, if lengths vary by more than error bars explain."""
    if spread.off <= _OFF_SHARE:
        return
    worst = int(np.argmax(spread.relative))
    a, b = (inputs.layout.joints[joint] for joint in spread.limbs[worst])
    numbers = {
        "relative_range": float(spread.relative[worst]),
        "range_mm": [float(size[worst] * inputs.rig.mm_per_unit) for size in (spread.low, spread.high)],
        "off_share": float(spread.off),
    }
    remedy = _CONSISTENT if are_mixed(inputs) else ()
    yield Finding("limb_lengths_vary", "warning", Subject(joints=(a, b)), numbers, remedy)
