"""Findings on the whole recording: what to check before trusting a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat import layouts
from skelsplat._words import listed, percent
from skelsplat.findings import Finding, Remedy, Severity, Subject
from skelsplat.rig_check._check import find_swapped, same_detections
from skelsplat.run.bones import find_bones
from skelsplat.run.displaced import (
    displaced_cameras,
    find_apart,
    find_displaced,
    remedies,
    shift_of,
    to_one_side,
)
from skelsplat.run.frames import MOSTLY, JointFrames, find_joints, find_statuses
from skelsplat.run.people import find_people
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome, frame_by_frame
from skelsplat.run.summary import Group, Statistics, finite_median, summarise

# Under normal noise hardly a detection is rejected (k < 1/4 at σ = 2 s has probability 4⁻⁸), and a detector's
# outliers are a few per cent. A camera is unusual with this share and this multiple of the other cameras'
# median,
_CAMERA_SHARE, _CAMERA_RATIO = 0.1, 3.0
# or with this share and this multiple of the best camera's, as two bad cameras raise the median;
_BAD_SHARE, _BEST_RATIO = 0.2, 2.0
# the whole recording with this, or with the lesser share that also those have who are not named for it.
_WHOLE_SHARE, _REST_SHARE = 1 / 3, 0.2
# A robust fit may leave the median where it was; a tenth more is further away.
_FURTHER, _FURTHER_PX = 1.1, 0.1  # less is the rounding of the detections
_FURTHER_OVER_TIME = 1.25
# Two views' plain triangulation follows three of their four numbers.
_FURTHER_OF_TWO, _CONFIRMED = 1.25, 3
# No person that a camera detects matches the other cameras, in this share of the frames at least; if that is
# so for another camera in most frames, this share of the frames with people is enough.
_SOME, _ALSO_UNFIT = 0.1, 0.25
# About half the arms and legs, which are half of a layout's joints or more; and all that have a side.
_MIRRORED_SHARE, _ALL_SIDES = 0.25, 0.6


def find_findings(
    inputs: Inputs,
    outcome: Outcome,
    statistics: Statistics,
    frames: JointFrames,
    counts: Mapping[tuple[str, int], int] = MappingProxyType({}),
) -> list[Finding]:
    """Return findings on people, on cameras that disagree and on joints that are rejected or uncertain.

    ``frames`` are those of `joint_frames`, ``counts`` how many they are if not all are named. Cameras and
    people are judged frame by frame.
    """
    alone = frame_by_frame(inputs, outcome)
    counted = statistics if alone is outcome else summarise(inputs, alone)
    swapped = [*find_swapped(inputs.rig.names, alone.result, inputs.layout), *_mirrored(counted)]
    if len(inputs.rig) > 2:
        swapped = [replace(one, remedy=(Remedy("without", *one.subject.cameras),)) for one in swapped]
    return [
        *same_detections(inputs.rig.names, inputs.detections),
        *find_people(inputs, alone),
        *find_whole(counted, alone.config.min_confidence),
        *_in_time(statistics, counted),
        *_cameras(inputs, counted, outcome),
        *{finding.subject: finding for finding in swapped}.values(),  # the latter of two on a camera
        *find_bones(inputs, alone),
        *find_joints(counted, statistics),
        *find_statuses(inputs, frames, counts),
    ]


def find_whole(statistics: Statistics, min_confidence: float = 0.0) -> Iterator[Finding]:
    """Yield a finding if hardly any detection is used or trusted, or the pose is worse than its start."""
    total, before, after = statistics.total, statistics.total["before_px"], statistics.total["after_px"]
    further = _FURTHER if np.median(statistics.views_used) >= _CONFIRMED else _FURTHER_OF_TWO
    if total["used"] == 0:
        why = "two cameras must detect the person in the same frame, joints with a confidence of at least "
        why += f"{min_confidence:g}, in pixels of these cameras' images (not 0 to 1), x before y."
        if total["left_out"] == total["not_chosen"] == 0:
            why = "nobody is detected with enough confidence."
        yield Finding("no_detections", "error", sentence=f"No detection could be used: {why}")
    elif (
        total["rejected_share"] >= _WHOLE_SHARE
        or min(total["rejected_share"], _rest(statistics)) >= _REST_SHARE
    ):
        words = f"{percent(total['rejected_share'])} of all detections are rejected: check that calibration, "
        words += "cameras and detections belong together and all views show the same person, and check "
        words += "timing, unit and layout."
        numbers = {"rejected_share": total["rejected_share"]}
        yield Finding("many_rejected", "warning", Subject(), numbers, sentence=words)
    elif after > max(further * before, before + _FURTHER_PX):
        words = "The refined pose lies further from the detections than its start (median "
        words += f"{before:.1f} to {after:.1f} px): check the layout, the unit and the calibration."
        numbers = {"before_px": before, "after_px": after}
        yield Finding("pose_far_off", "warning", Subject(), numbers, sentence=words)


def _in_time(statistics: Statistics, alone: Statistics) -> Iterator[Finding]:
    """Yield a finding if poses solved over time are further from the detections than frame by frame explains.

    From V views a frame alone follows 3 of 2V numbers, noise and all; over time hardly any.
    """
    views = max(2.0, finite_median(statistics.views_used))
    before, after = alone.total["after_px"], statistics.total["after_px"]
    allowed = _FURTHER_OVER_TIME * np.sqrt(2 * views / (2 * views - 3)) * before
    if after > max(allowed, before + _FURTHER_PX):
        words = "Solved over time, the pose lies much further from the detections than frame by frame "
        words += f"(median {before:.1f} to {after:.1f} px): check that the frames are in order and the frame "
        words += "rate is theirs, or solve each frame alone."
        numbers, remedy = {"before_px": before, "after_px": after}, (Remedy("frame_by_frame"),)
        yield Finding("pose_far_off", "warning", Subject(), numbers, remedy, sentence=words)


def _rest(statistics: Statistics) -> float:
    """Return the share of rejected detections, without the cameras and joints that have their own finding."""
    bad = _bad_cameras(statistics.cameras)
    cameras = [group not in bad for group in statistics.cameras]
    joints = [group["rejected_share"] < MOSTLY for group in statistics.joints]
    part = np.s_[:, np.flatnonzero(cameras)[:, None], np.flatnonzero(joints)]
    used = np.isfinite(statistics.error_after[part]).sum()
    return float(statistics.rejected[part].sum() / max(1, used))


def unfit_cameras(inputs: Inputs) -> dict[int, tuple[int, int]]:
    """Return the cameras in which people are detected but mostly none matches the other cameras.

    With two numbers of frames: those without a match, and those in which this and another detect people.
    """
    people = inputs.unmatched | np.isfinite(inputs.detections[..., 0]).any(axis=2)
    count, seen = inputs.unmatched.sum(axis=0), people.sum(axis=0)
    shares = np.where(count >= _SOME * len(people), count / np.maximum(seen, 1), 0.0)
    least = _ALSO_UNFIT if (shares >= MOSTLY).any() else MOSTLY
    return {int(i): (int(count[i]), int(seen[i])) for i in np.flatnonzero(shares >= least)}


def _find_unfit(names: Sequence[str], unfit: Mapping[int, tuple[int, int]]) -> Iterator[Finding]:
    """Yield one finding on the cameras of `unfit_cameras`; ``names`` are those of all cameras."""
    if not unfit:
        return
    cameras = tuple(names[i] for i in unfit)
    counts, seen = map(list, zip(*unfit.values(), strict=True))
    frames = listed([f"{count:,} of {of:,}" for count, of in unfit.values()])
    they = "it" if len(cameras) == 1 else "they"
    words = f"In {listed(cameras)}, no person detected matches the other cameras, in {frames} of the frames "
    words += f"in which {they} and others detect a person: exchanged cameras, a wrong calibration, "
    words += "unsynchronised video, or other people? Check the cameras."
    numbers = {"frames_without_match": counts, "frames_detected": seen}
    remedy = tuple(Remedy("without", name) for name in cameras) if len(names) - len(cameras) >= 2 else ()
    yield Finding("camera_disagrees", "warning", Subject(cameras=cameras), numbers, remedy, sentence=words)


def find_detector(layout: sk.Layout) -> Iterator[Finding]:
    """Yield a finding on a detector of one person, of cameras that contradict each other."""
    if layout.name == layouts.MEDIAPIPE33.name:
        words = "MediaPipe detects one person per image. If several are in view, it may follow another one "
        words += "in each camera, so that cameras look wrong that are not: use a detector of several people, "
        words += "such as rtmlib."
        yield Finding("detector_of_one_person", "warning", sentence=words)


def _cameras(inputs: Inputs, statistics: Statistics, outcome: Outcome) -> Iterator[Finding]:
    """Yield findings on cameras that are unused, disagree or are displaced, and on views that lie apart."""
    names, shifts, unfit = inputs.rig.names, statistics.shifts, unfit_cameras(inputs)
    unfit_names = {names[i] for i in unfit}
    noise = None if outcome.sequence is None else outcome.sequence.view_noise
    displaced = displaced_cameras(inputs.rig, shifts, noise)
    bad = {group["name"] for group in _bad_cameras(statistics.cameras)}
    worst = [i for i in displaced if names[i] in bad]
    rest = [i for i in displaced if names[i] not in bad]
    sides = {names[i]: shift_of(names, shifts, i, rest if i == worst[0] else ()) for i in worst}
    apart = [*find_apart(inputs.rig, statistics, {*displaced, *unfit})]
    if unfit or apart:
        yield from find_detector(inputs.layout)
    yield from _find_unfit(names, unfit)
    adjusted = bool(inputs.source.get("adjust_cameras"))
    followed = inputs.solved is not None
    yield from find_cameras(statistics, unfit_names, sides, followed=followed, adjusted=adjusted)
    yield from find_displaced(names, shifts, [] if worst else rest, unfit_names, adjusted=adjusted)
    yield from apart


def find_cameras(
    statistics: Statistics,
    unfit: AbstractSet[str] = frozenset(),
    sides: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    *,
    followed: bool = False,
    adjusted: bool = False,
) -> Iterator[Finding]:
    """Yield findings on unused cameras and on those that disagree.

    Those that are ``unfit`` have their own finding; ``sides`` are the shifts of `shift_of` by name. A camera
    need not see one of several people who were ``followed``, or somebody stands before them. Cameras may have
    been ``adjusted`` before.
    """
    bad = _bad_cameras(statistics.cameras)
    good = [group for group in statistics.cameras if group["used"] and group not in bad]
    others = sum(group["rejected"] for group in good) / max(1, sum(group["used"] for group in good))
    compared = "" if len(bad) == 1 else ", ".join(group["name"] for group in good)
    enough = len(statistics.cameras) > 2  # two must remain
    for group in statistics.cameras:
        subject, without = Subject(cameras=(group["name"],)), (Remedy("without", group["name"]),)
        if statistics.total["used"] and not group["used"] and group["name"] not in unfit and not followed:
            words = f"{group['name']} has no usable detections. Either the person is not in view, or its "
            words += "detections do not agree with the other views."
            remedy = (Remedy("person", None), *(without if enough else ()))
            yield Finding("camera_unused", "warning", subject, remedy=remedy, sentence=words)
        elif group in bad:
            side = sides.get(group["name"], {})
            theirs = f"those of {compared}" if compared else "theirs"
            shifted = f"Its detections are shifted by {to_one_side(side)}. " if side else ""
            words = f"{group['name']} disagrees with the other cameras: {percent(group['rejected_share'])} "
            words += f"of its detections are rejected, {percent(others)} of {theirs}, and its mean weight is "
            words += f"{group['mean_weight']:.2f}. {shifted}The pose follows the others: check this camera's "
            words += "calibration and timing, and whether anything blocks its view."
            shares = {"rejected_share": group["rejected_share"], "others_rejected_share": others}
            numbers = {**shares, "mean_weight": group["mean_weight"], **side}
            remedy = without if enough else ()
            if side:
                remedy = remedies(group["name"], len(statistics.cameras), adjusted=adjusted)
            remedy = () if group["name"] in unfit else remedy
            severity: Severity = "note" if followed and not side else "warning"
            yield Finding("camera_disagrees", severity, subject, numbers, remedy, sentence=words)


def _bad_cameras(cameras: Sequence[Group]) -> list[Group]:
    """Return the cameras with an unusual share of rejected detections; never all of them."""
    used = [group for group in cameras if group["used"]]
    bad = []
    for group in used if len(used) > 1 else ():
        others = [other["rejected_share"] for other in used if other is not group]
        share = group["rejected_share"]
        far = share >= max(_CAMERA_SHARE, _CAMERA_RATIO * finite_median(others))
        if far or share >= max(_BAD_SHARE, _BEST_RATIO * min(others)):
            bad.append(group)
    return bad


def _mirrored(statistics: Statistics) -> Iterator[Finding]:
    for group in statistics.cameras:
        name, share = group["name"], group["swapped"] / max(1, group["used"])
        if share >= _MIRRORED_SHARE:
            why = "Is the image mirrored?" if share >= _ALL_SIDES else "Does the detector confuse the sides?"
            words = f"{name}: left and right are swapped in {percent(share)} of its detections. {why}"
            numbers = {"swapped_share": share}
            yield Finding("sides_swapped", "warning", Subject((name,)), numbers, sentence=words)
