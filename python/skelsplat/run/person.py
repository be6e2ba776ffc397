"""Which person to follow among those detected, and who else is visible."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import skelsplat as sk
from skelsplat import association
from skelsplat._arrays import Array, Index, Mask, medians
from skelsplat._people import most_people, people_uncompared
from skelsplat.findings import warn

# Choices that need no frame rate, and one that needs people followed over time.
BY_FRAME, MOVES_MOST = ("consistent", "largest"), "moves-most"
# By whom cameras are judged, unless by one of them.
EVERYBODY = "everybody"
# A person counts as detected with this many joints of this confidence; others are not considered.
_MIN_JOINTS, _MIN_CONFIDENCE = 4, 0.2
# Share of the frames with several people in two views or more from which these people are examined.
_CROWDED = 0.1
# Frames of a recording in which people are told apart: 5 ms each with four people in four views.
_MOST_FRAMES = 200
# Someone is as visible as another with so much of the other's number of views: 3 of 4, 5 of 6, both of 2.
_AS_VISIBLE = 0.75
# A person on whom so many views agree is no chance meeting of two strangers' rays.
_SURE_VIEWS = 3
# Median distance of two detections, as a part of the image's diagonal, from which they are of two bodies: the
# gate of `choose_person`.
_APART = 0.03
# Part of the frames in which views show different people: more than a detector's ghosts now and then.
MIXED = 0.1
# Part of the frames in which someone is as visible as another: not just passing.
_OFTEN = 0.25
# A person changes for another by a step of this part of a body's size, ...
_STEP = 0.5
# ... while someone else is nearer to where the person was by this factor.
_NEARER = 3.0


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
    """Return one person's indices (T, M) in P, -1 for none, and the mask (T, M) of views without a match.

    None matches in a view in which people are detected, and in another as well, but not the person the views
    agree on. The largest person, or one chosen by number, always matches.

    Parameters
    ----------
    people : (T, M, P, N, 3)
        All detections; NaN where missing. The order in P is the detector's.
    rig
        The M cameras.
    person
        ``"consistent"``: the person the views agree on; ``"largest"``: the largest in each image; a
        number: the one at that index in each file, from 0.
    layout
        Also finds a person whose left and right are swapped in a view.

    Raises
    ------
    InvalidInputError
        If no file has a person at that index.
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
    """Return what `pick_places` does for the person the views agree on, without a warning.

    And the frames (T,) in which there were too many people to compare all of them.
    """
    people = association.with_confidences(people)
    index, cut = association.chosen_places(
        people, rig, layout=layout, min_confidence=_MIN_CONFIDENCE, min_joints=_MIN_JOINTS
    )
    there = count_people(people) > 0
    return index, there & (index < 0) & (there.sum(axis=1, keepdims=True) >= 2), cut


def look_around(
    people: Array,
    index: Index,
    rig: sk.CameraRig,
    person: str,
    layout: sk.Layout | None = None,
    steps: Index | None = None,
) -> Crowd | None:
    """Return who is visible apart from the person of ``index`` (T, M), and whether this mixes people.

    None where hardly any frame has several people in two views. Long recordings are sampled, unless people
    and index are already those of a sample, ``steps`` (S,). The other arguments are those of `pick_places`.
    """
    several = (count_people(people) >= 2).sum(axis=1) >= 2
    if several.mean() < _CROWDED:
        return None
    if steps is None:
        steps = sampled(len(people))
        people, index = people[steps], index[steps]
    found, poses = association.separate_people(
        people,
        rig,
        first=index if person == "consistent" else None,
        layout=layout,
        min_confidence=_MIN_CONFIDENCE,
        min_joints=_MIN_JOINTS,
    )
    return describe(people, index, found, poses, gates_px(rig), steps)


def count_people(people: Array) -> Index:
    """Count those in every view, (T, M), who have enough joints of enough confidence."""
    sure = np.isfinite(people[..., :2]).all(axis=-1) & (people[..., 2] >= _MIN_CONFIDENCE)
    count: Index = (sure.sum(axis=-1) >= min(_MIN_JOINTS, people.shape[3])).sum(axis=2)
    return count


def seen_apart(people: Array, cameras: Sequence[str]) -> tuple[str, ...]:
    """Return the cameras that detect people, if no two ever do so in the same frame."""
    there = count_people(people) > 0
    together = (there.sum(axis=1) >= 2).any()
    return () if together else tuple(np.array(cameras)[there.any(axis=0)].tolist())


@dataclass(frozen=True)
class Crowd:
    """The people whom the cameras see, and the one who was chosen among them."""

    visible: int  # people who are as visible as the one seen by the most views, that one among them
    together: Mask  # (S,) frames in which two or more are
    # (S,) frames in which a view shows somebody else than the other views, though the person is
    # detected in it
    mixed: Mask
    # steps from one frame to the next at which the chosen detections go over to another person, and the
    # steps that could be judged
    changed: int
    compared: int

    @property
    def mixes(self) -> bool:
        """Whether the chosen detections are of several people."""
        return bool(self.mixed.mean() >= MIXED or self.changed)


def sampled(frames: int, most: int = _MOST_FRAMES) -> Index:
    """Return up to ``most`` of the frames' indices: all of them, or pairs of neighbours, evenly spread."""
    if frames <= most:
        return np.arange(frames)
    first = np.linspace(0, frames - 2, most // 2).astype(np.int64)
    return np.unique(np.concatenate([first, first + 1]))


def gates_px(cameras: Sequence[sk.Camera]) -> Array:
    """Return the distances (M,) from which two detections are of different people."""
    return np.array([_APART * np.hypot(*camera.size) for camera in cameras])


def describe(
    people: Array, chosen: Index, found: Index, poses: Array, apart_px: Array, steps: Index
) -> Crowd:
    """Compare the detections that were chosen with the people whom the views show.

    ``people`` (S, M, P, K, 3), ``chosen`` (S, M) are places in P, -1 for none; ``found`` (Q, S, M) and
    ``poses`` (Q, S, K, 3) as of `skelsplat.association.separate_people`. Detections are of different people
    from a median distance of ``apart_px`` (M,). Of ``steps`` (S,), those that follow each other are compared.
    """
    as_visible = visible_alike(found)
    mixed = mixed_frames(people, chosen, found, apart_px)
    changed, compared = person_changes(_followed(chosen, found), poses, ~mixed, steps)
    often = as_visible.mean(axis=1) >= _OFTEN
    return Crowd(max(1, int(often.sum())), as_visible.sum(axis=0) >= 2, mixed, changed, compared)


def visible_alike(found: Index) -> Mask:
    """Return who (Q, S) is seen by two views and by three quarters of those that see the best seen person."""
    views = (found >= 0).sum(axis=2)
    alike: Mask = (views >= 2) & (views >= _AS_VISIBLE * views.max(axis=0))
    return alike


def mixed_frames(people: Array, chosen: Index, found: Index, apart_px: Array) -> Mask:
    """Return the frames (S,) in which the chosen detections of some view are of another person than most are.

    That person must be detected in the view as well, further than ``apart_px`` (M,) away, and be one on whom
    three views agree, or both of two.
    """
    person = _followed(chosen, found)
    own = np.where((person >= 0)[:, None], found[np.maximum(person, 0), np.arange(len(chosen))], -1)
    enough = (own >= 0).sum(axis=1) >= min(_SURE_VIEWS, chosen.shape[1])
    offset = (association.take_people(people, chosen) - association.take_people(people, own))[..., :2]
    elsewhere = medians(np.hypot(offset[..., 0], offset[..., 1])) > apart_px
    mixed: Mask = enough & ((own >= 0) & (chosen != own) & elsewhere).any(axis=1)
    return mixed


def person_changes(person: Index, poses: Array, clear: Mask, steps: Index) -> tuple[int, int]:
    """Count the steps to the next frame at which the person becomes another, and those that could be judged.

    ``person`` (S,) is who of Q is followed, -1 for nobody; ``poses`` (Q, S, K, 3). Only frames that are
    ``clear`` (S,), with numbers ``steps`` (S,), are compared.
    """
    centres = medians(np.moveaxis(poses, -1, -2))  # (Q, S, 3)
    sizes = np.array([association.body_sizes(pose) for pose in poses])
    here = np.flatnonzero((np.diff(steps) == 1) & (person[:-1] >= 0) & (person[1:] >= 0))
    here = here[clear[here] & clear[here + 1]]
    before = centres[person[here], here]
    reach = np.linalg.norm(centres[:, here + 1] - before, axis=-1)  # (Q, H)
    own = reach[person[here + 1], np.arange(len(here))]
    nearest = np.where(np.isnan(reach), np.inf, reach).min(axis=0, initial=np.inf)
    judged = np.isfinite(own)
    changed = judged & (own > _STEP * sizes[person[here], here]) & (own > _NEARER * nearest)
    return int(changed.sum()), int(judged.sum())


def _followed(chosen: Index, found: Index) -> Index:
    """Return who of Q has the most of the chosen detections, (S,); -1 for nobody."""
    hits = ((found == chosen) & (found >= 0)).sum(axis=2)
    return np.where(hits.max(axis=0) >= 1, hits.argmax(axis=0), -1)
