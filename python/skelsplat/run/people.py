"""Findings on people: who else is visible, whether a run follows one body, and doubts about those found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index, body_sizes, medians
from skelsplat._people import layouts_alike
from skelsplat._words import length, listed, percent
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.layouts import mirror_images
from skelsplat.run.frames import frames_in_words
from skelsplat.run.person import OFTEN, Crowd
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import finite_median

# A body that is elsewhere in the next frame by this part of its size, and faster than anybody runs, mm/s, is
# another one; it takes so many joints to say where it is.
_JUMP, _FASTEST_MM_S, _LEAST_JOINTS = 0.5, 12_000.0, 4
# A third view confirms a person; two agree on whatever lies where their rays meet.
CONFIRMED = 3
# Nobody stands as still as this for so long, while posters and dummies do, mm and s: detections of good
# detectors scatter by 4 mm once smoothed, and somebody at rest sways by 5 mm and moves a hand or the head.
_STILL_MM, _STILL_S = 7.0, 3.0
# So near is nobody to the reflection of somebody else, at least this far apart, in nine tenths of the joints,
# mm: of 40 simulated scenes the nearest are 106 mm from it, simulated reflections at most 28 mm.
_SAME_MM, _APART_MM = 60.0, 500.0
_SAME_BONES = 0.05  # bones that differ by less, in the median, may be of one person
# Part of the people detected who may be left out: those whom one view sees, and false detections.
_LEFT_OUT = 0.25
# Fewer are no pattern.
_LEAST_DETECTED = 20


def find_people(inputs: Inputs, outcome: Outcome) -> Iterator[Finding]:
    """Yield the doubts about who is followed, and findings on others and on jumps."""
    yield from inputs.doubts
    if inputs.crowd is not None and inputs.crowd.together >= OFTEN:
        yield _others(inputs, inputs.crowd)
    known = np.asarray(outcome.result.joint_status) == "ok"
    yield from _find_jumps(inputs, np.where(known[..., None], outcome.result.pose, np.nan))


def _others(inputs: Inputs, crowd: Crowd) -> Finding:
    place, words = _place(inputs), f"{crowd.visible} people are visible in about the same number of views in "
    where = f" (the one at {place[0]} in frame {place[1]})" if place else ""
    words += f"{percent(crowd.together)} of the frames. Check that the right one is followed{where}"
    if inputs.fps is not None:
        words += ": a number, the size, the motion or a place chooses another."
    else:
        words += ". To refine everybody, the frame rate must be known."
    numbers = {"people": crowd.visible, "share_of_frames": crowd.together, "followed": place}
    return Finding(
        "people_visible", "warning", Subject(), numbers, (Remedy("people", "all"),), sentence=words
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


def _find_jumps(inputs: Inputs, pose: Array) -> Iterator[Finding]:
    """Yield a finding if the body is elsewhere from one frame to the next: another person."""
    pairs = np.stack([pose[:-1], pose[1:]])  # joints of one frame alone would move the centre
    pairs[:, ~np.isfinite(pairs).all(axis=(0, -1))] = np.nan
    centres, sizes = medians(np.moveaxis(pairs, -1, -2), _LEAST_JOINTS), body_sizes(pose)
    steps = np.linalg.norm(centres[1] - centres[0], axis=-1)
    allowed = _JUMP * np.maximum(np.minimum(sizes[1:], sizes[:-1]), finite_median(sizes[sizes > 0]))
    if inputs.fps is not None:
        allowed = np.maximum(allowed, _FASTEST_MM_S / inputs.fps / inputs.rig.mm_per_unit)
    jumps = np.flatnonzero((steps > allowed) & (np.diff(inputs.frames) == 1))
    if not len(jumps):
        return
    longest = float(steps[jumps].max() * inputs.rig.mm_per_unit)
    frames = inputs.frames[jumps + 1].tolist()
    times = "once" if len(jumps) == 1 else f"{len(jumps):,} times"
    far = f"{longest / 1000:.1f} m" if longest >= 100 else f"{length(longest, 0, 10.0)} mm"
    words = f"The person jumps {times} from one frame to the next, by up to {far} "
    words += f"({frames_in_words(frames)}): the detections change to another person, or frames are missing "
    words += "or out of order."
    numbers = {"jumps": len(jumps), "longest_mm": longest}
    yield Finding("person_jumps", "warning", Subject(frames=tuple(frames)), numbers, sentence=words)


def find_doubts(people: Sequence[Inputs], of: Inputs) -> Iterator[Finding]:
    """Yield doubts about one of the people who were followed over time."""
    who: dict[str, Any] = {"person": int(of.person)}
    seen = np.asarray(np.isfinite(of.detections[..., 0]).any(axis=-1))
    views = float(np.median(seen.sum(axis=1)))
    if len(of.rig) >= CONFIRMED and views < CONFIRMED:
        counts = dict(zip(of.rig.names, seen.sum(axis=0).tolist(), strict=True))
        counts = {name: count for name, count in counts.items() if count}
        cameras = listed([f"{name} in {count:,}" for name, count in counts.items()])
        words = f"Mostly two views or fewer see this person ({cameras} of {len(seen):,} frames), so no "
        words += "third view confirms the pose."
        numbers = {"frames_seen": [*counts.values()], "frames": len(seen), "views": views}
        subject = Subject(cameras=tuple(counts))
        yield Finding("person_of_few_views", "warning", subject, {**who, **numbers}, sentence=words)
    still = _moved_mm(of)
    seconds = float(of.frames[-1] - of.frames[0]) / of.fps if of.fps else 0.0
    if still < _STILL_MM and seconds >= _STILL_S and any(_moved_mm(one) >= _STILL_MM for one in people):
        words = f"This person hardly moves: positions vary by {still:.0f} mm in {seconds:.0f} s. A poster, "
        words += "a dummy, or somebody who keeps still?"
        numbers = {**who, "moved_mm": still, "seconds": seconds}
        yield Finding("person_still", "warning", Subject(), numbers, sentence=words)
    yield from _find_mirrored(people, of)
    yield from _find_return(people, of)


def _find_mirrored(people: Sequence[Inputs], of: Inputs) -> Iterator[Finding]:
    """Yield a finding if the person is the reflection of somebody who is nearer to the cameras."""
    centre = np.mean([camera.centre for camera in of.rig], axis=0)
    away = [np.linalg.norm(np.nanmedian(one.solved_pose, axis=(0, 1)) - centre) for one in (of, *people)]
    nearer = [one for one, distance in zip(people, away[1:], strict=True) if distance < away[0]]
    apart, same = min(((_reflection_mm(one, of), int(one.person)) for one in nearer), default=(np.inf, 0))
    if apart < _SAME_MM:
        words = f"This person is the mirror image of person {same}, within {apart:.0f} mm: a reflection?"
        numbers = {"person": int(of.person), "of": same, "apart_mm": apart}
        yield Finding("person_mirrored", "warning", Subject(), numbers, sentence=words)


def _reflection_mm(one: Inputs, other: Inputs) -> float:
    """Return how far 0.9 of a person's joints are at most from another's reflection; inf if they touch."""
    _, here, there = np.intersect1d(one.frames, other.frames, return_indices=True)
    swapped = mirror_images(one.layout.n_joints, one.layout.left_right)
    both = np.stack([one.solved_pose[here][:, swapped], other.solved_pose[there]]) * one.rig.mm_per_unit
    own, image = both[:, np.isfinite(both).all(axis=(0, -1))]
    normal = (image - own).mean(axis=0) if len(own) >= _LEAST_DETECTED else np.zeros(3)
    if np.linalg.norm(normal) < _APART_MM:
        return float("inf")
    normal /= np.linalg.norm(normal)
    depth = np.median((own + image) @ normal) / 2 - own @ normal  # of the plane that fits best
    return float(np.quantile(np.linalg.norm(own + 2 * depth[:, None] * normal - image, axis=-1), 0.9))


def _find_return(people: Sequence[Inputs], of: Inputs) -> Iterator[Finding]:
    """Yield a note if somebody of the same bones was there before, and gone: perhaps the same person."""
    gone = []
    for one in people:
        if one.solved is not None and of.solved is not None and one.frames[-1] < of.frames[0]:
            ratio = np.asarray(one.solved.bone_lengths) / np.asarray(of.solved.bone_lengths)
            gone.append((finite_median(np.abs(np.log(ratio))), int(one.person), int(one.frames[-1])))
    for differ, before, last in sorted(some for some in gone if some[0] < _SAME_BONES)[:1]:
        words = f"This may be person {before} again, who was last seen in frame {last}: their bones differ "
        words += f"by {100.0 * differ:.0f} %. Whoever is away for over five seconds gets a new number."
        numbers = {"person": int(of.person), "before": before, "last": last, "percent": 100.0 * differ}
        yield Finding("person_back", "note", Subject(), numbers, sentence=words)


def _moved_mm(of: Inputs) -> float:
    """Return how far the joint that moves most, but for a tenth, varies over time; NaN if unknown."""
    place = of.solved_pose
    known = place[:, np.isfinite(place).all(axis=(0, 2))]
    if not known.size:
        return float("nan")
    return float(np.quantile(np.sqrt(known.var(axis=0).sum(axis=-1)), 0.9)) * of.rig.mm_per_unit


def find_over_people(people: Mapping[int, Sequence[Finding]], cameras: Sequence[str]) -> Iterator[Finding]:
    """Yield one finding on the rig if cameras disagree with the others for some of several people."""
    found = {
        who: [one for one in own if one.kind == "camera_disagrees" and one.severity != "note"]
        for who, own in people.items()
    }
    found = {who: own for who, own in found.items() if own}
    if not found or len(people) < 2:
        return
    named = {who: [one.subject.cameras[0] for one in own] for who, own in found.items()}
    rivals = {
        who: [rival for one in own for rival in one.numbers.get("also_displaced", ())]
        for who, own in found.items()
    }
    suspects = [
        {*names, *(rival["camera"] for rival in rivals[who] if rival["may_be_the_cause"])}
        for who, names in named.items()
    ]
    blamed = {name: [who for who, own in named.items() if name in own] for name in cameras}
    blamed = {name: who for name, who in blamed.items() if who}
    common = [name for name in cameras if all(name in own for own in suspects)]
    contradict = max(map(len, blamed.values())) < len(named)
    numbers = {"people": len(people), "named": list(blamed.values()), "contradict": contradict}
    said = "A wrong calibration shows for every person in the camera's view, an obstructed view does not"
    if contradict:
        cause = f"; {listed(common, 'or')} may be the cause for all of them" if common else ""
        said = f"The people contradict each other about which is wrong{cause}"
    remove = len(common) == 1 and len(cameras) > 2 and not contradict
    shown = [
        f"{name} for {len(who)} ({listed([f'person {one}' for one in who])})" for name, who in blamed.items()
    ]
    yield Finding(
        "cameras_over_people",
        "warning",
        Subject(cameras=tuple(blamed)),
        {**numbers, "may_be_the_cause": common},
        (Remedy("without", common[0]),) if remove else (),
        sentence=f"Cameras that disagree with the others, over {len(people)} people: {listed(shown)}. "
        f"{said}.",
    )


def find_left_out(detected: Index, assigned: Index, of: Inputs) -> Iterator[Finding]:
    """Yield a finding if many of the people detected (T, M) are none of those found."""
    everybody, left = detected.sum(), (detected - assigned).sum(axis=0)
    if everybody < _LEAST_DETECTED or left.sum() < _LEFT_OUT * everybody:
        return
    shares, share = left / np.maximum(detected.sum(axis=0), 1), float(left.sum() / everybody)
    named = np.flatnonzero(shares >= _LEFT_OUT)
    cameras = ", ".join(f"{of.rig.names[i]} {percent(shares[i])}" for i in named)
    alike = " or ".join(layouts_alike(of.layout))
    layout = f"a wrong layout ({alike} has as many joints)" if alike else "a wrong layout"
    words = f"{percent(share)} of the people detected are none of those found ({cameras}): people "
    words += f"whom one view sees, false detections, {layout}, or cameras that do not fit. Check the cameras."
    subject = Subject(cameras=tuple(of.rig.names[i] for i in named))
    numbers = {"left_out_share": share, "shares": shares[named].tolist()}
    yield Finding("people_left_out", "warning", subject, numbers, (Remedy("layout", None),), sentence=words)
