"""Doubts that the run follows one person, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat._crowd import MIXED, limb_spread

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


def people_doubts(inputs: Inputs, outcome: Outcome) -> Iterator[str]:
    """Say whether people are mixed, whether others are as visible, and whether limbs vary in length."""
    if inputs.crowd is not None:
        yield from _mixed(inputs.person, inputs.crowd)
        yield from _others(inputs.person, inputs.crowd)
    yield from _lengths(inputs, _spread(inputs, outcome))


def are_mixed(inputs: Inputs) -> bool:
    """Whether the detections are of several people, chosen without a comparison of the views."""
    return inputs.crowd is not None and inputs.person != "consistent" and inputs.crowd.mixes


def _mixed(person: str, crowd: Crowd) -> Iterator[str]:
    """Name a choice that is not one person; the one that the views agree on is."""
    if person == "consistent" or not crowd.mixes:
        return
    if crowd.mixed.mean() >= MIXED:  # hardly a step is left to judge
        fault = f"the views show different people in {_percent(crowd.mixed.mean())} of the frames"
    else:
        steps = f"{crowd.changed:,} of {crowd.compared:,} steps from frame to frame"
        fault = f"it changes to another person in {steps}"
    entry = f"The order of people in a file is arbitrary: entry {person} is"
    why = "The largest in each image is" if person == "largest" else entry
    yield (
        f"--person {person} mixes people: {fault}. {why} not always the same person; --person "
        "consistent follows the person the views agree on."
    )


def _others(person: str, crowd: Crowd) -> Iterator[str]:
    share = crowd.together.mean()
    if share < _TOGETHER:
        return
    seen = (
        f"{max(2, crowd.visible)} people are visible in about the same number of views in {_percent(share)} "
        "of the frames"
    )
    if person != "consistent" and crowd.mixes:
        yield f"{seen}; only --person consistent tells them apart."
        return
    other = {
        "consistent": "--person largest follows the largest in each image",
        "largest": "--person consistent follows the person the views agree on",
    }.get(person, "--person consistent or --person largest may follow another")
    order = "the order of people in a file is arbitrary, so --person 0 may mix them"
    more = "" if person.isdecimal() else f"; {order}"
    yield f"{seen}. Check that the right one is followed: {other}{more}."


def _spread(inputs: Inputs, outcome: Outcome) -> LimbSpread:
    """Measure arms and legs, which both sides of a body have and no joint between bends."""
    result = outcome.result
    limbs = [limb for pair in inputs.layout.symmetric_pairs(2) for limb in pair]
    known = np.asarray(result.joint_status) == "ok"
    return limb_spread(np.asarray(result.pose), np.asarray(result.uncertainty), known, limbs)


def _lengths(inputs: Inputs, spread: LimbSpread) -> Iterator[str]:
    if spread.off <= _OFF_SHARE:
        return
    worst = int(np.argmax(spread.relative))
    a, b = (inputs.layout.joints[joint] for joint in spread.limbs[worst])
    low, high = (size[worst] * inputs.rig.mm_per_unit for size in (spread.low, spread.high))
    cause = (
        "The detections probably mix people: --person consistent follows the person the views agree on"
        if are_mixed(inputs)
        else "Either the views show different people, or most views are wrong about these joints: "
        "check-cameras looks for a cause in the cameras"
    )
    yield (
        f"Limb lengths vary by up to {_percent(spread.relative[worst])} over the recording; a body's do not. "
        f"{a} to {b} is {low:,.0f} to {high:,.0f} mm long (5th to 95th percentile), and "
        f"{_percent(spread.off)} of the lengths of arms and legs are off by more than error bars explain. "
        f"{cause}."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.0f}%"
