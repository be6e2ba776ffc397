"""``refine_batches``: recordings of any length, chunk after chunk, in the memory of a chunk."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from itertools import chain, count, takewhile

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import _skelsplat
from skelsplat._arrays import Array, positive
from skelsplat._chunks import CheckedChunk, Chunks, Source, sample_of, source_of
from skelsplat._refine import Cameras, Judge, Progress, Refinement, refined, refinement_fields, reporter
from skelsplat._sequence import SequenceRefinement, frames_of, joined
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat.exceptions import InvalidInputError

# Windows at the beginning from which is learnt if nothing more is there yet.
_EARLY = 3


def refine_batches(
    chunks: Chunks,
    cameras: Cameras,
    *,
    fps: float | None = None,
    layout: str | Layout | None = None,
    init_sigma: ArrayLike | None = None,
    config: RefineConfig | None = None,
    frames_per_chunk: int | None = None,
    progress: bool | Progress = False,
) -> Iterator[Refinement]:
    """Refine a recording of any length chunk after chunk, in memory that does not grow with it.

    Without ``fps`` the frames are refined as by `refine`, with ``fps`` in time, as by `refine_sequence`. The
    k-th result is that of the k-th chunk, with the bits of one call with the whole
    recording. Exceptions, both with ``fps``: ``bone_length_sigma`` is that of the part solved with the chunk,
    and of a generator, which can be gone through only once, only the beginning is there to learn from.

    Parameters
    ----------
    chunks : array, iterable or function
        Detections of consecutive frames:

        - an array (T, M, N, 2|3) that is read where it is sliced, such as a memory map of NumPy or a data set
          of h5py or Zarr: it is cut into chunks of ``frames_per_chunk``;
        - an iterable of chunks, or a function that returns a new one at each call. A chunk is an array
          (T, M, N, 2|3), or a mapping with ``detections`` and, where there are any, ``confidence`` and
          ``init_pose``, as `refine` takes them. T may differ, also be 0.

        With ``fps`` an iterable or function is gone through three times: to count the frames, for a sample
        to learn from, and to solve; of a generator only the first two minutes are learnt from (at least 1800
        frames).
    cameras, layout, config
        As in `refine`.
    fps : float, optional
        Frames per second, of one motion in order. None refines every frame by itself.
    init_sigma : float, (N,) or (N, 3, 3), optional
        As in `refine`, for all frames; not with ``fps``.
    frames_per_chunk : int, optional
        For an array. In time, windows of 40 s (at least 600 frames) are solved, one per core: chunks of
        several windows use all cores.
    progress : bool or callable
        As in `refine`; the number of frames in all is that read so far where more is not known.

    Returns
    -------
    iterator of Refinement
        Of `SequenceRefinement` with ``fps``. Chunks are read when results are asked for, in time up to 44 s
        of the recording ahead.

    Raises
    ------
    InvalidInputError
        At once if the cameras, ``fps`` or settings are invalid, as by `refine` and `refine_sequence`; in the
        iteration if a chunk is: the message begins with ``chunks[k]``. Errors of the iterable itself
        are passed on. The iteration then has ended.

    Warns
    -----
    UserWarning
        As `refine`, judged by the first chunk that has frames.

    Examples
    --------
    >>> detections = np.load("detections.npy", mmap_mode="r")                            # doctest: +SKIP
    >>> for result in sk.refine_batches(detections, rig, fps=100, layout="coco17"):      # doctest: +SKIP
    ...     file.write(result.pose)
    """
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    source = source_of(chunks, len(cameras), frames_per_chunk)
    judge = Judge(cameras, layout, config)
    if fps is None:
        return _alone(prepared, source, judge, init_sigma, progress)
    positive("fps", fps)
    if init_sigma is not None:
        raise InvalidInputError("init_sigma: expected None with fps, got a standard deviation")
    prepared.refine_sequence(None, np.empty((0, len(cameras), 1, 2)), float(fps))  # rejects what it must
    return _in_time(_Solver(prepared, float(fps)), source, judge, progress)


def _alone(
    prepared: _skelsplat.Refiner,
    source: Source,
    judge: Judge,
    init_sigma: ArrayLike | None,
    progress: bool | Progress,
) -> Iterator[Refinement]:
    done, total = 0, source.n_frames or 0
    with reporter(progress) as report:
        for chunk in source:
            yield refined(
                prepared,
                chunk.init_pose,
                chunk.detections,
                None if done else judge,
                init_sigma=init_sigma,
                progress=_after(report, done, total),
            )
            done += len(chunk)


def _after(report: Progress | None, done: int, total: int) -> Progress | None:
    """Return what reports the progress of a part, after so many frames."""
    if report is None:
        return None
    return lambda now, of_part: report(done + now, max(total, done + of_part))


def _in_time(
    solver: _Solver, source: Source, judge: Judge, progress: bool | Progress
) -> Iterator[SequenceRefinement]:
    chunks, ends, done = iter(source), deque[int](), 0
    early = solver.prepare(source, chunks)
    with reporter(progress) as report:
        for chunk in chain(_drained(early), chunks, [None]):
            if chunk is not None:
                solver.take(chunk)
                ends.append(solver.read)
            begin = solver.end
            solver.solve(_after(report, begin, solver.n_frames or 0), last=chunk is None)
            if begin == 0 < solver.end:
                judge.unit(solver.solved[0].pose)
            while ends and ends[0] <= solver.end:
                yield solver.frames(done, ends[0])
                done = ends.popleft()


def _drained(chunks: deque[CheckedChunk]) -> Iterator[CheckedChunk]:
    while chunks:
        yield chunks.popleft()


class _Solver:
    """A recording solved in windows: each when its frames are there, with what a sample of them shows."""

    def __init__(self, prepared: _skelsplat.Refiner, fps: float) -> None:
        self.prepared, self.fps = prepared, fps
        self.length, self.overlap = _skelsplat.sequence_window_size(fps)
        self.n_frames: int | None = None
        self.windows: list[list[int]] = []
        self.known: Array | None = None  # what the sample shows; None where one window is all
        self.held: list[CheckedChunk] = []  # frames that windows still look at, from ``first`` to ``read``
        self.first = self.read = 0
        self.solved: list[SequenceRefinement] = []  # frames not returned yet, from ``begin`` to ``end``
        self.begin = self.end = 0
        self.done = 0  # windows

    def prepare(self, source: Source, chunks: Iterator[CheckedChunk]) -> deque[CheckedChunk]:
        """Learn from a sample, else from the beginning; return the chunks read for that."""
        early = deque[CheckedChunk]()
        self.n_frames = source.count()
        enough = _EARLY * self.length
        if self.n_frames is None:
            for chunk in chunks:
                early.append(chunk)
                if sum(map(len, early)) > enough:
                    break
            else:
                self.n_frames = sum(map(len, early))
        of = enough if self.n_frames is None else self.n_frames
        self.windows, ranges = _skelsplat.sequence_windows(of, self.fps)
        if len(self.windows) > 1:
            sample = sample_of(early, ranges) if early else source.sample(ranges)
            frames = CheckedChunk.joined(sample)
            self.known = self.prepared.learn_sequence(
                frames.init_pose, frames.detections, self.fps, [len(part) for part in sample]
            )
        return early

    def take(self, chunk: CheckedChunk) -> None:
        """Add the next frames."""
        self.held.append(chunk)
        self.read += len(chunk)

    def solve(self, report: Progress | None, *, last: bool) -> None:
        """Solve the windows whose frames are there."""
        n = self.n_frames
        if n is not None and (self.read > n or (last and self.read < n)):
            expected = f"the same {n} frames each time they are gone through"
            raise InvalidInputError(f"chunks: expected {expected}, got {self.read}")
        ready = self._ready(last)
        if not ready:
            return
        frames = CheckedChunk.joined(self.held)
        pose, detections = frames.init_pose, frames.detections
        if self.known is None:
            out = self.prepared.refine_sequence(pose, detections, self.fps, progress=report)
        else:
            rows = [[frame - self.first for frame in row] for row in ready]
            out = self.prepared.refine_windows(pose, detections, self.known, rows, progress=report)
        self.solved.append(SequenceRefinement(**refinement_fields(out)))
        self.end, self.done = ready[-1][2], self.done + len(ready)
        kept = max(self.first, self.end - self.overlap)
        self.held, self.first = [frames.part(kept - self.first, len(frames)).copy()], kept

    def _ready(self, last: bool) -> list[list[int]]:
        """Return the next windows whose frames are there."""
        rows = self.windows[self.done :] if self.n_frames is not None else self._even(last)
        return list(takewhile(lambda row: row[3] <= self.read, rows))

    def _even(self, last: bool) -> Iterator[list[int]]:
        """Yield windows of even length: nobody knows yet how many there will be."""
        for begin in count(self.done * self.length, self.length):
            end = begin + self.length
            row = [max(begin - self.overlap, 0), begin, end, end + self.overlap]
            row = [min(frame, self.read) for frame in row] if last else row
            if row[1] == row[2]:
                return
            yield row

    def frames(self, start: int, stop: int) -> SequenceRefinement:
        """Return solved frames and forget those before their end."""
        if start == stop:
            empty = self.held[0].detections[:0]
            out = self.prepared.refine_sequence(None, empty, self.fps)
            return SequenceRefinement(**refinement_fields(out))
        parts = []
        while start < stop:
            piece = self.solved[0]
            end = min(stop, self.begin + len(piece.pose))
            parts.append(frames_of(piece, slice(start - self.begin, end - self.begin)))
            start = end
            if end == self.begin + len(piece.pose):
                self.begin = end
                self.solved.pop(0)
        return joined(parts)
