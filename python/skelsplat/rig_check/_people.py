"""The detections by which cameras are judged: those of one person, or of everybody the views agree on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat.association import choose_person, extents, separate_people, take_people
from skelsplat.rig_check._scene import Scene, scene_of

# A camera in which the chosen person is found in fewer frames is judged by whoever is there.
_LOST = 0.2
# Two cameras do not tell which of them is wrong, and whom only two see may be a chance meeting of rays.
_THREE = 3
# Someone seen in fewer frames tells nothing.
_LEAST_FRAMES = 12
# Empty frames between people: more than clocks are compared by.
_GAP = 40


def judge(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Scene:
    """Return the scene of the person that is followed."""
    return scene_of(cameras, follow_person(cameras, people, layout)[..., :2], np.arange(len(people)))


def follow_person(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Array:
    """Return one person's detections (T, M, N, 2 | 3), also in a view that no other view agrees with.

    A camera in which the person is almost never found, although people are there, may be wrong; the largest
    person of each of its images then stands in.
    """
    if people.shape[2] == 1 or len(cameras) < 2:
        return people[:, :, 0]
    chosen, index = choose_person(people, cameras, layout=layout)
    largest = take_people(people, extents(people).argmax(axis=2))
    return np.where(_is_lost(people, index)[None, :, None, None], largest, chosen)


def _is_lost(people: Array, index: Index) -> Array:
    """Return the cameras (M,) that see people, but hardly ever this one."""
    there = np.isfinite(people[..., 0]).any(axis=(2, 3))
    lost: Array = (index >= 0).sum(axis=0) / np.maximum(there.sum(axis=0), 1) < _LOST
    return lost


def several(cameras: Sequence[sk.Camera], people: Array) -> bool:
    """Whether there are several people (T, M, P, N, 2 | 3) to be told apart, by more than two cameras."""
    return people.shape[2] > 1 and len(cameras) >= _THREE


def everybody(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> tuple[Array, ...]:
    """Return the detections (T, M, N, 2 | 3) of everybody the views agree on, of `choose_person`'s first.

    The others count in frames in which three views or more see them.
    """
    return _told_apart(cameras, people, layout)[0]


def followed(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> tuple[Array, ...]:
    """Return what `everybody` does; if a camera hardly ever sees the first, only that of `follow_person`.

    The camera may be wrong.
    """
    if several(cameras, people):
        everyone, lost = _told_apart(cameras, people, layout)
        if not lost:
            return everyone
    return (follow_person(cameras, people, layout),)


def _told_apart(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[tuple[Array, ...], bool]:
    """Return `everybody`, and whether a camera sees people, but hardly ever the first of them."""
    index, _ = separate_people(people, cameras, layout=layout)
    sure = np.where((index >= 0).sum(axis=2, keepdims=True) >= _THREE, index, -1)
    often = [one for one in sure[1:] if (one >= 0).any(axis=1).sum() >= _LEAST_FRAMES]
    everyone = tuple(take_people(people, one) for one in (index[0], *often))
    return everyone, bool(_is_lost(people, index[0]).any())


def one_after_another(everyone: Sequence[Array]) -> Array:
    """Return the detections of several people as those of one recording, with empty frames between."""
    none = np.full((_GAP, *everyone[0].shape[1:]), np.nan)
    return np.concatenate([part for one in everyone for part in (none, one)][1:])


def scene_of_everybody(
    cameras: Sequence[sk.Camera], people: Array, frames: Index, layout: sk.Layout | None
) -> Scene:
    """Return the scene of everybody who is `followed`, one after another."""
    everyone = followed(cameras, people, layout)
    span = int(frames[-1] - frames[0]) + _GAP
    numbers = np.concatenate([frames + k * span for k in range(len(everyone))])
    return scene_of(cameras, np.concatenate(everyone)[..., :2], numbers)
