"""Findings on whether a run follows one person: who else is there, and how long limbs stay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index, Mask, medians
from skelsplat._words import decimals, length, listed, number, percent
from skelsplat.association import body_sizes
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.run.joints import frames_in_words
from skelsplat.run.person import MIXED, Crowd
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import finite_median

# No distribution has more than 1/9 beyond four standard deviations from its median: the median is within one
# of the mean, and Chebyshev's inequality leaves 1/9 beyond three from the mean.
_OFF_SHARE = 1 / 9
# Part of the frames in which another person is as visible as the one followed: not just passing.
_TOGETHER = 0.25
_CONSISTENT = (Remedy("person", "consistent"),)
# Standard deviation of a limb's length, as a part of it: a detector does not place joints at quite the same
# point of the body in every pose.
_DEFINITION = 0.05
# A limb is off its median beyond so many standard deviations.
_OFF = 4.0
# A body that is elsewhere in the next frame by this part of its size, and faster than anybody runs, mm/s, is
# another one; it takes so many joints to say where it is.
_JUMP, _FASTEST_MM_S, _LEAST_JOINTS = 0.5, 12_000.0, 4
# Findings that a camera does not fit the others.
_DOUBTS = ("camera_disagrees", "camera_displaced")
# Fewer frames are no distribution of lengths.
_LEAST_FRAMES = 10


def find_people(inputs: Inputs, outcome: Outcome) -> Iterator[Finding]:
    """Yield findings on mixed people, on others as visible, on jumps and on limbs of varying length."""
    yield from inputs.doubts
    if inputs.crowd is not None:
        mixed = are_mixed(inputs)
        if mixed:
            yield _mixed(inputs.person, inputs.crowd)
        if inputs.crowd.together.mean() >= _TOGETHER:
            yield _others(inputs, inputs.crowd, mixed=mixed)
    yield from find_lengths(inputs, _spread(inputs, outcome))
    if not are_mixed(inputs):
        yield from find_jumps(inputs, outcome)


def are_mixed(inputs: Inputs) -> bool:
    """Whether the detections are of several people, chosen without a comparison of the views."""
    return inputs.crowd is not None and inputs.person != "consistent" and inputs.crowd.mixes


def _mixed(person: str, crowd: Crowd) -> Finding:
    share = float(crowd.mixed.mean())
    if share >= MIXED:  # hardly a step is left to judge
        numbers: dict[str, Any] = {"person": person, "different_people_share": share}
        fault = f"the views show different people in {percent(share)} of the frames"
    else:
        numbers = {"person": person, "changes": crowd.changed, "steps": crowd.compared}
        steps = f"{crowd.changed:,} of {crowd.compared:,} steps from frame to frame"
        fault = f"it changes to another person in {steps}"
    entry = f"The order of people in a file is arbitrary: entry {person} is"
    why = "The largest in each image is" if person == "largest" else entry
    return Finding(
        "people_mixed",
        "warning",
        numbers=numbers,
        remedy=_CONSISTENT,
        sentence=f"Following person {person} mixes people: {fault}. {why} not always the same person; the "
        "person the views agree on is, and with the frame rate so is this choice.",
    )


def _others(inputs: Inputs, crowd: Crowd, *, mixed: bool) -> Finding:
    people, share = max(2, crowd.visible), float(crowd.together.mean())
    known, place = inputs.fps is not None, None if mixed else _place(inputs)
    where = f" (the one at {place[0]} in frame {place[1]})" if place else ""
    check = "" if mixed else f" Check that the right one is followed{where}: a number, the size, the motion "
    check += "" if mixed else "or a place chooses another."
    rate = "" if known else " To refine everybody, the frame rate must be known."
    return Finding(
        "people_visible",
        "warning",
        numbers={
            "person": inputs.person,
            "people": people,
            "share_of_frames": share,
            "mixed": mixed,
            "rate_known": known,
            "followed": place,
        },
        remedy=(*(_CONSISTENT if mixed else ()), Remedy("people", "all")),
        sentence=f"{people} people are visible in about the same number of views in {percent(share)} of the "
        f"frames.{check}{rate}",
    )


def _place(inputs: Inputs) -> list[str | int] | None:
    """Return where the person is first seen: a point as ``person`` takes it, and the frame's number."""
    there = np.argwhere(np.isfinite(inputs.detections[..., 0]).any(axis=2))
    if not len(there):
        return None
    t, m = there[0]
    joints = inputs.detections[t, m, :, :2]
    # a joint, not the middle itself, which may be nearer to a joint of somebody else
    x, y = joints[int(np.nanargmin(np.hypot(*(joints - np.nanmedian(joints, axis=0)).T)))]
    return [f"{inputs.rig.names[m]}:{x:.0f},{y:.0f}", int(inputs.frames[t])]


def find_jumps(inputs: Inputs, outcome: Outcome) -> Iterator[Finding]:
    """Yield a finding if the body is elsewhere from one frame to the next: another person."""
    result = outcome.result
    pose = np.where((np.asarray(result.joint_status) == "ok")[..., None], result.pose, np.nan)
    pairs = np.stack([pose[:-1], pose[1:]])  # joints of one frame alone would move the centre
    pairs[:, ~np.isfinite(pairs).all(axis=(0, -1))] = np.nan
    centres, sizes = medians(np.moveaxis(pairs, -1, -2), _LEAST_JOINTS), body_sizes(pose)
    steps = np.linalg.norm(centres[1] - centres[0], axis=-1)
    allowed = _JUMP * np.maximum(np.minimum(sizes[1:], sizes[:-1]), finite_median(sizes[sizes > 0]))
    if inputs.fps is not None:
        allowed = np.maximum(allowed, _FASTEST_MM_S / inputs.fps / inputs.rig.mm_per_unit)
    jumps = np.flatnonzero((steps > allowed) & (np.diff(inputs.frames) == 1))
    if len(jumps):
        longest = float(steps[jumps].max() * inputs.rig.mm_per_unit)
        frames = inputs.frames[jumps + 1].tolist()
        times = "once" if len(jumps) == 1 else f"{len(jumps):,} times"
        far = f"{longest / 1000:.1f} m" if longest >= 100 else f"{length(longest, 0, 10.0)} mm"
        yield Finding(
            "person_jumps",
            "warning",
            Subject(frames=tuple(frames)),
            {"jumps": len(jumps), "longest_mm": longest, "person": inputs.person},
            sentence=f"The person jumps {times} from one frame to the next, by up to {far} "
            f"({frames_in_words(frames)}): the detections change to another person, or frames are missing "
            "or out of order.",
        )


def _spread(inputs: Inputs, outcome: Outcome) -> LimbSpread:
    """Measure the segments of arms and legs, which have a fixed length."""
    result = outcome.result
    limbs = [limb for pair in inputs.layout.symmetric_pairs(2) for limb in pair]
    known = np.asarray(result.joint_status) == "ok"
    return limb_spread(np.asarray(result.pose), np.asarray(result.uncertainty), known, limbs)


def find_lengths(inputs: Inputs, spread: LimbSpread) -> Iterator[Finding]:
    """Yield a finding on the limb that varies most, if lengths vary by more than scatter explains."""
    if spread.off <= _OFF_SHARE:
        return
    worst = int(np.argmax(spread.relative))
    a, b = (inputs.layout.joints[joint] for joint in spread.limbs[worst])
    low, high = (float(size[worst] * inputs.rig.mm_per_unit) for size in (spread.low, spread.high))
    relative, off, mixed = float(spread.relative[worst]), float(spread.off), are_mixed(inputs)
    digits = decimals(high, 0, 10.0)
    cause = "Either the views show different people, or most views are wrong about these joints"
    yield Finding(
        "limb_lengths_vary",
        "warning",
        Subject(joints=(a, b)),
        {"relative_range": relative, "range_mm": [low, high], "off_share": off},
        _CONSISTENT if mixed else (),
        sentence=f"Limb lengths vary by up to {percent(relative)} over the recording, which is impossible "
        f"for one body. {a} to {b} is {number(low, digits)} to {number(high, digits)} mm long (5th to 95th "
        f"percentile), and {percent(off)} of the lengths of arms and legs deviate by more than scatter "
        f"explains. {'The detections probably mix people' if mixed else cause}.",
    )


def find_over_people(people: Mapping[int, Sequence[Finding]], cameras: Sequence[str]) -> Iterator[Finding]:
    """Yield one finding on the rig if cameras do not fit the others for some of several people.

    One rig is judged by everybody it sees: ``people`` are the findings on each.
    """
    named: dict[int, list[str]] = {}
    suspects: dict[int, set[str]] = {}
    commands = []
    for identity, findings in people.items():
        found = [one for one in findings if one.kind in _DOUBTS and one.severity != "note"]
        if found:
            named[identity] = [one.subject.cameras[0] for one in found]
            rivals = (other for one in found for other in one.numbers.get("also_displaced", ()))
            may = {other["camera"] for other in rivals if other["may_be_the_cause"]}
            suspects[identity] = may | set(named[identity])
            commands.append(found[0].numbers.get("check"))
    if not named or len(people) < 2:
        return
    blamed = {name: [who for who, own in named.items() if name in own] for name in cameras}
    blamed = {name: who for name, who in blamed.items() if who}
    common = [name for name in cameras if all(name in own for own in suspects.values())]
    contradict = max(map(len, blamed.values())) < len(named)
    numbers = {
        "people": len(people),
        "named": list(blamed.values()),
        "contradict": contradict,
        "may_be_the_cause": common,
        **({"check": commands[0]} if commands[0] else {}),
    }
    remove = len(common) == 1 and len(cameras) > 2 and not contradict
    whose = listed([f"{name} for {len(who)} ({_numbers(who)})" for name, who in blamed.items()])
    said = "A wrong calibration shows for every person in the camera's view, an obstructed view does not."
    if contradict:
        cause = f"; {listed(common, 'or')} may be the cause for all of them" if common else ""
        said = f"The people contradict each other about which is wrong{cause}."
    look = f" {commands[0]} looks for the cause." if commands[0] else ""
    yield Finding(
        "cameras_over_people",
        "warning",
        Subject(cameras=tuple(blamed)),
        numbers,
        (Remedy("without", common[0]),) if remove else (),
        sentence=f"Cameras that disagree with the others, over {len(people)} people: {whose}. {said}{look}",
    )


def _numbers(people: Sequence[int]) -> str:
    return f"person {people[0]}" if len(people) == 1 else f"people {listed([str(who) for who in people])}"


@dataclass(frozen=True)
class LimbSpread:
    """How the lengths of limbs vary over the frames; of limbs that are known in ten frames or more."""

    limbs: Index  # (B, 2) the joints of these limbs
    # (B,) median, 5th and 95th percentile of the length, in the poses' unit
    median: Array
    low: Array
    high: Array
    off: float  # part of all lengths that differ from the limb's median by more than four standard deviations

    @property
    def relative(self) -> Array:
        """Distance of the two percentiles, as a part of the median, (B,)."""
        return (self.high - self.low) / self.median


def limb_spread(pose: Array, uncertainty: Array, known: Mask, limbs: Sequence[tuple[int, int]]) -> LimbSpread:
    """Compare how limb lengths vary over the frames with the scatter that a constant length would have.

    The variance of a length is that of its two ends along the limb, and (5 % of the length)², as a detector
    does not place joints at quite the same point of the body in every pose. Joints ``known`` (T, N) count.
    """
    kept, rows, off, count = [], [], 0, 0
    for a, b in limbs:
        both = known[:, a] & known[:, b]
        limb = pose[both, b] - pose[both, a]
        length = np.linalg.norm(limb, axis=-1)
        if len(length) < _LEAST_FRAMES or not (length > 0).all():
            continue
        along = limb / length[:, None]
        variance = np.einsum("ti,tij,tj->t", along, uncertainty[both, a] + uncertainty[both, b], along)
        row = np.percentile(length, [50, 5, 95])
        allowed = _OFF * np.sqrt(variance + (_DEFINITION * row[0]) ** 2)
        off, count = off + int((np.abs(length - row[0]) > allowed).sum()), count + len(length)
        kept.append((a, b))
        rows.append(row)
    median, low, high = np.array(rows).reshape(-1, 3).T
    return LimbSpread(np.array(kept, dtype=np.int64).reshape(-1, 2), median, low, high, off / max(count, 1))
