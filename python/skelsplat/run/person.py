"""Which person to follow among those detected, and who else is visible."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import skelsplat as sk
from skelsplat import association
from skelsplat._arrays import Array, Index, Mask

# Choices that need no frame rate, and one that needs people followed over time.
BY_FRAME, MOVES_MOST = ("consistent", "largest"), "moves-most"
# By whom cameras are judged, unless by one of them.
EVERYBODY = "everybody"
# Joints that make a person, and the confidence that they must have.
_JOINTS, _CONFIDENCE = 4, 0.2
# Someone is as visible as another with so much of the other's number of views: 3 of 4, 5 of 6, both of 2.
_AS_VISIBLE = 0.75
# Median distance of two detections, as a part of the image's diagonal, from which they are of two bodies.
_APART = 0.03
# Part of the frames in which views show different people: more than a detector's ghosts now and then.
MIXED = 0.1
# Part of the frames in which someone is as visible as another: not just passing.
OFTEN = 0.25


def check_person(person: str | int) -> None:
    """Raise `InvalidInputError` unless it is a choice of `skelsplat.run.Job`."""
    named = str(person) in (*BY_FRAME, MOVES_MOST) or str(person).isdecimal()
    if not named and entry_of(person) is None and point_of(person) is None:
        choices = f"{', '.join(BY_FRAME)}, {MOVES_MOST}, a number"
        expected = f"{choices}, a point such as cam01:640,360, or an entry of each file such as entry:0"
        raise sk.InvalidInputError(f"person: expected {expected}, got {person!r}")


def check_slot(person: str) -> None:
    """Raise `InvalidInputError` unless it is everybody, or a choice that each frame allows by itself."""
    choices = (EVERYBODY, *BY_FRAME)
    if person not in choices and entry_of(person) is None:
        expected = f"{', '.join(choices)} or an entry of each file such as entry:0"
        raise sk.InvalidInputError(f"person: expected {expected}, got {person!r}")


def entry_of(person: str | int) -> int | None:
    """Return the place in each file of a choice such as ``entry:0``; None if it is another one."""
    found = re.fullmatch(r"entry:(\d+)", str(person).strip())
    return None if found is None else int(found[1])


def point_of(person: str | int) -> tuple[str, float, float] | None:
    """Return camera, x and y of a choice such as ``cam01:640,360``; None if it is another one."""
    found = re.fullmatch(r"(.+):(\d+(?:\.\d+)?),(\d+(?:\.\d+)?)", str(person).strip())
    return None if found is None else (found[1], float(found[2]), float(found[3]))


def pick_places(people: Array, person: str, found: Index) -> tuple[Index, Mask]:
    """Choose one of the people (T, M, P, N, 3) in each view, by "consistent", "largest" or ``entry:N``.

    ``found`` (Q, T, M) are the places of everybody, the one whom the views agree on first. Returns the places
    (T, M), -1 for none, and the views without a match (T, M): people are detected there and in another view,
    but not the person the views agree on.
    """
    never = np.zeros(people.shape[:2], dtype=bool)
    if person == "consistent":
        return found[0], without_match(people, found[0])
    if person == "largest":
        return association.extents(people).argmax(axis=2), never
    entry = int(person.removeprefix("entry:"))
    if entry >= people.shape[2]:
        expected = f"less than {people.shape[2]} (no file has more people)"
        raise sk.InvalidInputError(f"person: expected {expected}, got {person}")
    return np.full(people.shape[:2], entry, dtype=np.int64), never


def without_match(people: Array, index: Index) -> Mask:
    """Return where (T, M) people are detected, as in another view, but not the one of ``index`` (T, M)."""
    there = count_people(people) > 0
    without: Mask = there & (index < 0) & (there.sum(axis=1, keepdims=True) >= 2)
    return without


def count_people(people: Array) -> Index:
    """Count those in every view, (T, M), who have enough joints of enough confidence."""
    count: Index = are_people(people).sum(axis=2)
    return count


def are_people(people: Array) -> Mask:
    """Return who (T, M, P) has enough joints of enough confidence."""
    sure = np.isfinite(people[..., :2]).all(axis=-1) & (people[..., 2] >= _CONFIDENCE)
    enough: Mask = sure.sum(axis=-1) >= min(_JOINTS, people.shape[3])
    return enough


@dataclass(frozen=True)
class Crowd:
    """The people whom the cameras see."""

    visible: int  # people often as visible as the one seen by the most views, that one among them
    together: float  # share of the frames in which two or more are


def look_around(views: Index) -> Crowd | None:
    """Return who is visible, of people in so many views (Q, T); None if that is at most one."""
    if len(views) < 2:
        return None
    alike = (views >= 2) & (views >= _AS_VISIBLE * views.max(axis=0))
    often = alike.mean(axis=1) >= OFTEN
    return Crowd(max(2, int(often.sum())), float((alike.sum(axis=0) >= 2).mean()))


def gates_px(cameras: Sequence[sk.Camera]) -> Array:
    """Return the distances (M,) from which two detections are of different people."""
    return np.array([_APART * np.hypot(*camera.size) for camera in cameras])
