"""Which person to follow among those detected, and who else is visible."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import skelsplat as sk
from skelsplat import association
from skelsplat._arrays import Array, Index, Mask
from skelsplat._people import most_people, people_uncompared
from skelsplat.findings import warn

# Choices that need no frame rate, and one that needs people followed over time.
BY_FRAME, MOVES_MOST = ("consistent", "largest"), "moves-most"
# By whom cameras are judged, unless by one of them.
EVERYBODY = "everybody"
# Share of the frames with several people in two views or more from which these people are examined.
_CROWDED = 0.1
# Frames of a recording in which people are told apart: 5 ms each with four people in four views.
_MOST_FRAMES = 200
# Someone is as visible as another with so much of the other's number of views: 3 of 4, 5 of 6, both of 2.
_AS_VISIBLE = 0.75
# Median distance of two detections, as a part of the image's diagonal, from which they are of two bodies: the
# gate of `choose_person`.
_APART = 0.03
# Part of the frames in which views show different people: more than a detector's ghosts now and then.
MIXED = 0.1
# Part of the frames in which someone is as visible as another: not just passing.
OFTEN = 0.25


def check_person(person: str | int) -> None:
    """Raise `InvalidInputError` unless it is a choice of `skelsplat.run.Job`."""
    named = str(person) in (*BY_FRAME, MOVES_MOST)
    if not named and not str(person).isdecimal() and point_of(person) is None:
        expected = f"{', '.join(BY_FRAME)}, {MOVES_MOST}, a number or a point such as cam01:640,360"
        raise sk.InvalidInputError(f"person: expected {expected}, got {person!r}")


def check_slot(person: str) -> None:
    """Raise `InvalidInputError` unless it is everybody, or a choice that each frame allows by itself."""
    choices = (EVERYBODY, *BY_FRAME)
    if person not in choices and not person.isdecimal():
        raise sk.InvalidInputError(f"person: expected {', '.join(choices)} or a number, got {person!r}")


def point_of(person: str | int) -> tuple[str, float, float] | None:
    """Return camera, x and y of a choice such as ``cam01:640,360``; None if it is another one."""
    found = re.fullmatch(r"(.+):(\d+(?:\.\d+)?),(\d+(?:\.\d+)?)", str(person).strip())
    return None if found is None else (found[1], float(found[2]), float(found[3]))


def pick_places(
    people: Array, rig: sk.CameraRig, person: str, layout: sk.Layout | None = None
) -> tuple[Index, Mask]:
    """Choose one of the people (T, M, P, N, 3) in each view, by "consistent", "largest" or a place in P.

    Returns the places (T, M) in P, -1 for none, and the views without a match (T, M): people are detected
    there and in another view, but not the person the views agree on. A layout also finds swapped sides.
    """
    if person == "consistent":
        index, unmatched, cut = pick_consistent(people, rig, layout)
        if cut.any():
            warn(people_uncompared(int(cut.sum()), most_people(people)))
        return index, unmatched
    never = np.zeros(people.shape[:2], dtype=bool)
    if person == "largest":
        return association.extents(people).argmax(axis=2), never
    if int(person) >= people.shape[2]:
        expected = f"less than {people.shape[2]} (no file has more people)"
        raise sk.InvalidInputError(f"person: expected {expected}, got {person}")
    return np.full(people.shape[:2], int(person), dtype=np.int64), never


def pick_consistent(people: Array, rig: sk.CameraRig, layout: sk.Layout | None) -> tuple[Index, Mask, Mask]:
    """Choose the person the views agree on; also return frames (T,) with too many people to compare."""
    people = association.with_confidences(people)
    index, cut = association.chosen_places(people, rig, layout)
    there = count_people(people) > 0
    return index, there & (index < 0) & (there.sum(axis=1, keepdims=True) >= 2), cut


def count_people(people: Array) -> Index:
    """Count those in every view, (T, M), who have enough joints of enough confidence."""
    sure = np.isfinite(people[..., :2]).all(axis=-1) & (people[..., 2] >= association.MIN_CONFIDENCE)
    count: Index = (sure.sum(axis=-1) >= min(association.MIN_JOINTS, people.shape[3])).sum(axis=2)
    return count


@dataclass(frozen=True)
class Crowd:
    """The people whom the cameras see."""

    visible: int  # people often as visible as the one seen by the most views, that one among them
    together: float  # share of the frames in which two or more are


def look_around(
    people: Array,
    index: Index,
    rig: sk.CameraRig,
    person: str,
    layout: sk.Layout | None = None,
    steps: Index | None = None,
) -> Crowd | None:
    """Return who is visible besides the person of ``index`` (T, M); the other arguments as of `pick_places`.

    None where hardly any frame has several people in two views. Unless people and index are those of a
    sample, ``steps`` (S,), long recordings are sampled.
    """
    several = (count_people(people) >= 2).sum(axis=1) >= 2
    if several.mean() < _CROWDED:
        return None
    if steps is None:
        steps = sampled(len(people))
        people, index = people[steps], index[steps]
    first = index if person == "consistent" else None
    found = association.separate_people(people, rig, first=first, layout=layout)
    views = (found >= 0).sum(axis=2)
    alike = (views >= 2) & (views >= _AS_VISIBLE * views.max(axis=0))
    often = alike.mean(axis=1) >= OFTEN
    return Crowd(max(2, int(often.sum())), float((alike.sum(axis=0) >= 2).mean()))


def sampled(frames: int) -> Index:
    """Return indices of some frames: all of a few, of many 200 as pairs of neighbours, evenly spread."""
    if frames <= _MOST_FRAMES:
        return np.arange(frames)
    first = np.linspace(0, frames - 2, _MOST_FRAMES // 2).astype(np.int64)
    return np.unique(np.concatenate([first, first + 1]))


def gates_px(cameras: Sequence[sk.Camera]) -> Array:
    """Return the distances (M,) from which two detections are of different people."""
    return np.array([_APART * np.hypot(*camera.size) for camera in cameras])
