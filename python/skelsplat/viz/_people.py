"""Several people in one recording: who is there when, where, and how many views see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, ArrayFields, Index, Mask, medians


@dataclass(frozen=True)
class PersonTrack(ArrayFields):
    """One of several people, in the frames (F,) in which they are followed."""

    name: str  # how the person is called, such as "person 0"
    frames: Index  # (F,) ascending frame numbers
    # (F, N, 3) joint positions before and after the refinement, in mm; NaN where unknown
    start: Array
    refined: Array
    error_bar: Array  # (F, N, 3, 3) covariances of the refined joints, in mm²; NaN where unknown
    status: npt.NDArray[np.str_]  # (F, N) joints whose status is not ``"ok"`` are drawn hollow
    seen: Mask  # (F, M) cameras with a detection of the person that is used and not rejected
    # (F,) median reprojection error in px, and part of the detections used that is rejected; NaN without any
    error_px: Array
    rejected: Array

    @property
    def views(self) -> Index:
        """How many cameras see the person, (F,)."""
        return np.asarray(self.seen.sum(axis=1), dtype=np.int64)

    @property
    def middle(self) -> Array:
        """Median of the joints, (F, 3): of those that are ``"ok"`` if there are any; NaN without joints."""
        ok = self.status == "ok"
        sure = np.where((ok | ~ok.any(axis=1, keepdims=True))[..., None], self.refined, np.nan)
        return medians(np.moveaxis(sure, 1, -1))


def all_frames(people: Sequence[PersonTrack]) -> Index:
    """Return the numbers of the frames in which anybody is followed, ascending."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(person.frames for person in people)]))


def spread_out(frames: Index, own: Index, values: npt.NDArray[Any], empty: object) -> npt.NDArray[Any]:
    """Return ``values`` (F, …) of the frames ``own`` in the frames ``frames`` (T,), ``empty`` in others."""
    whole = np.full((len(frames), *values.shape[1:]), empty, dtype=values.dtype)
    kept = np.isin(own, frames)
    whole[np.searchsorted(frames, own[kept])] = values[kept]
    return whole


def thinned(people: Sequence[PersonTrack], most: int) -> list[PersonTrack]:
    """Return people in some ``most`` of all frames, evenly chosen; nobody is lost."""
    frames = all_frames(people)
    if len(frames) <= most:
        return list(people)
    some, kept = frames[:: -(-len(frames) // most)], []
    for person in people:
        rows = np.isin(person.frames, some)
        rows[:1] |= not rows.any()
        arrays = {field.name: getattr(person, field.name)[rows] for field in fields(person)[1:]}
        kept.append(replace(person, **arrays))
    return kept
