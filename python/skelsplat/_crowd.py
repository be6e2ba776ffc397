"""Whether a result can be one person's: what the views show of several people, and how long limbs stay.

Numbers alone, from arrays; what they mean to a reader is said elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skelsplat._arrays import medians
from skelsplat.association import body_sizes, take_people

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    import skelsplat as sk

    Array = npt.NDArray[np.float64]
    Index = npt.NDArray[np.int64]
    Mask = npt.NDArray[np.bool_]

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
# Standard deviation of a limb's length, as a part of it: a detector does not place joints at quite the same
# point of the body in every pose.
_DEFINITION = 0.05
# A limb is off its median beyond so many standard deviations.
_OFF = 4.0
# Fewer frames are no distribution of lengths.
_LEAST_FRAMES = 10


@dataclass(frozen=True)
class Crowd:
    """The people whom the cameras see, and the one who was chosen among them.

    Attributes
    ----------
    visible : int
        People who are as visible as the one seen by the most views, that one among them.
    together : (S,)
        Frames in which two or more are.
    mixed : (S,)
        Frames in which a view shows somebody else than the other views, though the person is detected in it.
    changed, compared : int
        Steps from one frame to the next at which the chosen detections go over to another person, and the
        steps that could be judged.
    """

    visible: int
    together: Mask
    mixed: Mask
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

    Parameters
    ----------
    people : (S, M, P, K, 3)
    chosen : (S, M)
        Places in P, -1 for none.
    found, poses : (Q, S, M), (Q, S, K, 3)
        What `skelsplat.association.separate_people` returned.
    apart_px : (M,)
        Median distance from which two detections are of different people.
    steps : (S,)
        Numbers of the frames; those that follow each other are compared.
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
    offset = (take_people(people, chosen) - take_people(people, own))[..., :2]
    elsewhere = medians(np.hypot(offset[..., 0], offset[..., 1])) > apart_px
    mixed: Mask = enough & ((own >= 0) & (chosen != own) & elsewhere).any(axis=1)
    return mixed


def person_changes(person: Index, poses: Array, clear: Mask, steps: Index) -> tuple[int, int]:
    """Count the steps to the next frame at which the person becomes another, and those that could be judged.

    Parameters
    ----------
    person : (S,)
        Who of Q is followed, -1 for nobody.
    poses : (Q, S, K, 3)
    clear : (S,)
        Frames to look at.
    steps : (S,)
        Numbers of the frames.
    """
    centres = medians(np.moveaxis(poses, -1, -2))  # (Q, S, 3)
    sizes = np.array([body_sizes(pose) for pose in poses])
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


@dataclass(frozen=True)
class LimbSpread:
    """How the lengths of limbs vary over the frames; of limbs that are known in ten frames or more.

    Attributes
    ----------
    limbs : (B, 2) int
        The joints of these limbs.
    median, low, high : (B,)
        Median, 5th and 95th percentile of the length, in the poses' unit.
    off : float
        Part of all lengths that differ from the limb's median by more than four standard deviations.
    """

    limbs: Index
    median: Array
    low: Array
    high: Array
    off: float

    @property
    def relative(self) -> Array:
        """Distance of the two percentiles, as a part of the median, (B,)."""
        return (self.high - self.low) / self.median


def limb_spread(pose: Array, uncertainty: Array, known: Mask, limbs: Sequence[tuple[int, int]]) -> LimbSpread:
    """Compare how limb lengths vary over the frames with the scatter that a constant length would have.

    The variance of a length is that of its two ends along the limb, and (5 % of the length)², as a detector
    does not place joints at quite the same point of the body in every pose.

    Parameters
    ----------
    pose, uncertainty : (T, N, 3), (T, N, 3, 3)
        As of `skelsplat.Refinement`.
    known : (T, N)
        Joints that count.
    limbs
        Pairs of joints.
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
