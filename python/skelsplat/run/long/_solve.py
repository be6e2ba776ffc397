"""A long recording solved part by part, over time or frame by frame, with the bits of the whole."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._sequence import frames_of
from skelsplat.io._rows import RowFile
from skelsplat.run.job import Job
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Progress, even_clock, why_alone

# A part of a recording: its frames, first and end, and what was found in them.
Part = tuple[slice, sk.Refinement]


class OnClock:
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


def solve(
    inputs: Inputs, detections: RowFile, job: Job, size: int, progress: Progress | None
) -> Iterator[Part]:
    """Refine all frames, so many at a time; ``inputs`` has all but the detections."""
    steps = len(inputs.frames)
    if why_alone(inputs, job):
        places, rate = np.arange(steps), None
    else:
        places, rate = even_clock(inputs)
    clock = OnClock(detections, places)

    def told(done: int, _: int) -> None:
        if progress is not None:
            progress(done * steps // len(clock), steps)

    results = sk.refine_batches(
        clock,
        inputs.rig,
        fps=rate,
        layout=inputs.layout,
        config=job.settings,
        frames_per_chunk=size,
        progress=False if progress is None else told,
    )
    first = 0
    for result in results:
        end = first + len(result.pose)
        own = slice(*np.searchsorted(places, [first, end]).tolist())
        yield own, frames_of(result, places[own] - first)
        first = end
