"""A long recording in parts: the person followed, the frames solved, and what all parts add up to."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat import association
from skelsplat._arrays import Array, Index
from skelsplat._people import most_people, people_uncompared
from skelsplat._sequence import frames_of, joined
from skelsplat.findings import warn
from skelsplat.io._arrays import RowFile
from skelsplat.io.poses._pose_data import PoseParts
from skelsplat.run.frames import FrameFacts, JointFrames, joint_frames
from skelsplat.run.job import Job
from skelsplat.run.person import look_around, without_match
from skelsplat.run.read import Inputs, Opened
from skelsplat.run.session import padded
from skelsplat.run.solve import Outcome, Progress, even_clock, part_of, poses_of, silent, why_alone
from skelsplat.run.summary import COUNTED, summarise

# Detections in memory at a time, but 600 frames or more: 100 MB with their results.
_PER_PART, _LEAST_FRAMES = 400_000, 600
# Frames on either side of a part among which the person is chosen as well: in those before, only the one
# followed there is left.
_BESIDE = 300
# Frames that medians, findings, figures and the page are from, at least half of these.
DRAWN = 10_000
# Frames of each joint that a finding names.
MOST_NAMED = 10_000
_BY_FRAME = ("detections", "unmatched", "frames")  # fields of `Inputs`


def in_parts(opened: Opened, job: Job, folder: Path, progress: Progress) -> tuple[Inputs, Outcome, Gathered]:
    """Refine the person the views agree on; return every so many-th frame, and what is known of all."""
    size = max(_LEAST_FRAMES, _PER_PART // (len(opened.rig) * opened.detections.skeleton.n_joints))
    progress(0, len(opened.detections.frames))
    whole, detections, unmatched = follow(opened, job, folder, size, part_of(progress, 0, 2))
    gathered = Gathered(whole, detections, PoseParts(folder, whole.frames, size), folder)
    seconds, begin = 0.0, time.perf_counter()
    for own, result in _solved(whole, detections, job, size, part_of(progress, 1, 2)):
        seconds += time.perf_counter() - begin
        part = replace(
            whole,
            detections=detections.read(own.start, own.stop),
            unmatched=unmatched.read(own.start, own.stop),
            frames=whole.frames[own],
        )
        gathered.add(own, part, Outcome.of(result, job.settings, part))
        begin = time.perf_counter()
    inputs, outcome = gathered.drawn()
    return inputs, replace(outcome, seconds=seconds, alone=why_alone(whole, job)), gathered


def follow(
    opened: Opened, job: Job, folder: Path, size: int, progress: Progress = silent
) -> tuple[Inputs, RowFile, RowFile]:
    """Follow the person the views agree on: all inputs, and in files detections and where nobody matches."""
    whole = opened.nobody(job)
    rig, layout, steps = opened.rig, opened.detections.skeleton, len(opened.detections.frames)
    shape = (len(rig), layout.n_joints, 3)
    detections = RowFile(folder / "detections", shape, np.float64)
    unmatched = RowFile(folder / "unmatched", shape[:1], np.bool_)
    nobody = np.empty((0, shape[0], 1, *shape[1:]))
    before, done, uncompared, most, views = nobody, 0, 0, 0, list[Index]()
    for part, after in pairwise(chain(opened.detections.stretches(size), [nobody])):
        beside = [before, part, after[:_BESIDE]]
        most_there = max(one.shape[2] for one in beside)
        people = association.with_confidences(np.concatenate([padded(one, most_there) for one in beside]))
        own = slice(len(before), len(before) + len(part))
        found, not_all = association.told_apart(people, rig, layout, whole.fps, before=len(before))
        index, cut = found[0, own], int(not_all[own].sum())
        if cut:
            uncompared, most = uncompared + cut, max(most, most_people(part))
        taken = association.take_people(part, index)
        detections.append(taken)
        unmatched.append(without_match(people, found[0])[own])
        views.append((found[:, own] >= 0).sum(axis=2))
        before, done = taken[-_BESIDE:, :, None], done + len(part)
        progress(done, steps)
    if uncompared:
        warn(people_uncompared(uncompared, most))
    people_in_all = max(map(len, views))  # no view sees those whom a part lacks
    counts = [np.pad(part, ((0, people_in_all - len(part)), (0, 0))) for part in views]
    return replace(whole, crowd=look_around(np.concatenate(counts, axis=1))), detections, unmatched


class _OnClock:
    """Detections (T, M, N, 3) on an even clock, NaN in missing frames, read where they are sliced."""

    def __init__(self, rows: RowFile, places: Index) -> None:
        self._rows, self._places = rows, places
        self.shape = (int(places[-1]) + 1, *rows.shape[1:])

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, frames: slice) -> Array:
        first, end, _ = frames.indices(len(self))
        there = slice(*np.searchsorted(self._places, [first, end]).tolist())
        found = np.full((end - first, *self.shape[1:]), np.nan)
        found[self._places[there] - first] = self._rows.read(there.start, there.stop)
        return found


def _solved(
    whole: Inputs, detections: RowFile, job: Job, size: int, progress: Progress
) -> Iterator[tuple[slice, sk.Refinement]]:
    """Refine all frames, so many at a time: yield the places of frames, and their result."""
    steps = len(whole.frames)
    places, rate = (np.arange(steps), None) if why_alone(whole, job) else even_clock(whole)
    clock = _OnClock(detections, places)
    results = sk.refine_batches(
        clock,
        whole.rig,
        fps=rate,
        layout=whole.layout,
        config=job.settings,
        frames_per_chunk=size,
        progress=lambda done, _: progress(done * steps // len(clock), steps),
    )
    first = 0
    for result in results:
        end = first + len(result.pose)
        own = slice(*np.searchsorted(places, [first, end]).tolist())
        yield own, frames_of(result, places[own] - first)
        first = end


@dataclass
class Gathered:
    """What is known of all frames once the parts were added, in order.

    The counts of the parts, the frames in which joints are weak or missing, and in files the poses and
    what single frames are judged from; the results themselves of every so many-th frame alone.
    """

    whole: Inputs  # without detections
    detections: RowFile
    poses: PoseParts
    folder: Path
    named: JointFrames = field(default_factory=dict)  # the first frames, and how many there are
    named_count: Counter[tuple[str, int]] = field(default_factory=Counter)
    counts: list[dict[str, Any]] = field(default_factory=list)
    _drawn: list[tuple[Inputs, Outcome]] = field(default_factory=list)

    @property
    def every(self) -> int:
        """One in so many frames is drawn."""
        return -(-len(self.whole.frames) // DRAWN)

    def add(self, place: slice, inputs: Inputs, outcome: Outcome) -> None:
        """Add the frames of a part."""
        statistics, poses = summarise(inputs, outcome), poses_of(inputs, outcome.result)
        self.poses.append(poses)
        facts = asdict(FrameFacts.of(inputs, outcome, statistics, poses.joint_status))
        np.savez(self.folder / f"facts_{len(self.counts)}.npz", **facts)
        self.counts.append({name: getattr(statistics, name) for name in COUNTED})
        for key, frames in joint_frames(inputs, outcome, poses.joint_status).items():
            named = self.named.setdefault(key, [])
            named += frames[: MOST_NAMED - len(named)]
            self.named_count[key] += len(frames)
        rows = np.arange(-place.start % self.every, place.stop - place.start, self.every)
        if len(rows):
            own = {name: getattr(inputs, name)[rows] for name in _BY_FRAME}
            drawn = replace(outcome, result=frames_of(outcome.result, rows), start=outcome.start[rows])
            self._drawn.append((replace(inputs, **own), drawn))

    def drawn(self) -> tuple[Inputs, Outcome]:
        """Return the frames drawn of all parts, one after the other."""
        inputs, outcomes = zip(*self._drawn, strict=True)
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(one, name) for one in inputs]) for name in _BY_FRAME
        }
        result = joined([one.result for one in outcomes])
        start = np.concatenate([one.start for one in outcomes])
        outcome = replace(outcomes[0], result=result, start=start)
        return replace(self.whole, **arrays, every=self.every, recorded=self.whole.frames), outcome

    def facts(self) -> Iterator[FrameFacts]:
        """Yield what single frames are judged from, part by part."""
        for k in range(len(self.counts)):
            with np.load(self.folder / f"facts_{k}.npz") as arrays:
                yield FrameFacts(**arrays)
