"""The detections of one person in a long recording, chosen part by part, into a file."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path

import numpy as np

from skelsplat import association
from skelsplat._arrays import Array, Index
from skelsplat._people import most_people, people_uncompared
from skelsplat.findings import warn
from skelsplat.io._rows import RowFile
from skelsplat.run.person import Crowd, look_around, pick_consistent, sampled, seen_apart
from skelsplat.run.read import Opened
from skelsplat.run.solve import Progress

# Frames on either side of a part among which the person is chosen as well: in those before, only the one
# followed there is left.
_BESIDE = 300


@dataclass(frozen=True)
class Followed:
    """The person the views agree on, in all T frames, as of `skelsplat.run.read.Inputs`."""

    detections: RowFile  # (T, M, N, 3)
    unmatched: RowFile  # (T, M) bool
    crowd: Crowd | None
    apart: tuple[str, ...]


def follow(opened: Opened, folder: Path, size: int, progress: Progress | None = None) -> Followed:
    """Read everybody, so many frames at a time, and follow the person the views agree on."""
    rig, layout, steps = opened.rig, opened.detections.skeleton, len(opened.detections.frames)
    shape = (len(rig), layout.n_joints, 3)
    detections = RowFile(folder / "detections", shape, np.float64)
    unmatched = RowFile(folder / "unmatched", shape[:1], np.bool_)
    sample, seen, chosen = sampled(steps), list[Array](), list[Index]()
    nobody = np.empty((0, shape[0], 1, *shape[1:]))
    before, done, uncompared, most = nobody, 0, 0, 0
    for part, after in pairwise(chain(opened.detections.stretches(size), [nobody])):
        people = _joined([before, part, after[:_BESIDE]])
        own = slice(len(before), len(before) + len(part))
        places, without, not_all = pick_consistent(people, rig, layout)
        index, alone, cut = places[own], without[own], not_all[own]
        if cut.any():
            uncompared, most = uncompared + int(cut.sum()), max(most, most_people(part))
        taken = association.take_people(part, index)
        detections.append(taken)
        unmatched.append(alone)
        here = sample[(sample >= done) & (sample < done + len(part))] - done
        seen.append(part[here])
        chosen.append(index[here])
        before, done = taken[-_BESIDE:, :, None], done + len(part)
        if progress is not None:
            progress(done, steps)
    if uncompared:
        warn(people_uncompared(uncompared, most))
    some = _joined(seen)
    crowd = look_around(some, np.concatenate(chosen), rig, "consistent", layout, sample)
    return Followed(detections, unmatched, crowd, seen_apart(some, rig.names))


def _joined(parts: list[Array]) -> Array:
    """Join people (t, M, P, N, 3), padded with NaN to the largest P."""
    most = max(part.shape[2] for part in parts)
    padded = (((0, 0), (0, 0), (0, most - part.shape[2]), (0, 0), (0, 0)) for part in parts)
    return np.concatenate(
        [np.pad(part, by, constant_values=np.nan) for part, by in zip(parts, padded, strict=True)]
    )
