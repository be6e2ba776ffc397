"""``refine_batches``: recordings of any length, chunk after chunk, in the memory of a chunk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat import _skelsplat
from skelsplat._arrays import Array, numbers, positive
from skelsplat._refine import (
    Cameras,
    Progress,
    Refinement,
    refinement_fields,
    reporter,
    warn_of_prior,
    warn_of_size,
)
from skelsplat._sequence import SequenceRefinement, frames_of, joined
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat.exceptions import InvalidInputError

# Frames per chunk of an array: several windows in time at any usual rate, and some 100 MB of results.
PER_CHUNK = 10_000
_ENTRIES = {"detections", "confidence", "init_pose"}


class Sliceable(Protocol):
    """Frames (T, M, N, 2|3) that are read where they are sliced: a memory map, an HDF5 or a Zarr array."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, frames: slice, /) -> Any: ...


Chunk: TypeAlias = ArrayLike | Mapping[str, ArrayLike]
Chunks: TypeAlias = Sliceable | Iterable[Chunk] | Callable[[], Iterable[Chunk]]
_Judge: TypeAlias = Callable[[NDArray[np.float64]], None]


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
    k-th result is that of the k-th chunk, with the bits of one call with the whole recording, except for
    ``bone_length_sigma``, which is that of the part solved with the chunk.

    Parameters
    ----------
    chunks : array, iterable or function
        Detections of consecutive frames:

        - an array (T, M, N, 2|3) that is read where it is sliced, such as a memory map of NumPy or a data set
          of h5py or Zarr: it is cut into chunks of ``frames_per_chunk``;
        - an iterable of chunks, or a function that returns a new one at each call. A chunk is an array
          (T, M, N, 2|3), or a mapping with ``detections`` and, where there are any, ``confidence`` and
          ``init_pose``, as `refine` takes them. T may differ, also be 0.

        With ``fps`` an iterable or function is gone through three times (to count the frames, for a sample to
        learn from, to solve), so a generator has to be given as the function that makes it.
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
        iteration if a chunk is: the message begins with ``chunks[k]``. Warnings are those of `refine`, judged
        by the first chunk that has frames.

    Examples
    --------
    >>> detections = np.load("detections.npy", mmap_mode="r")                            # doctest: +SKIP
    >>> for result in sk.refine_batches(detections, rig, fps=100, layout="coco17"):      # doctest: +SKIP
    ...     file.write(result.pose)
    """
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    source = _source_of(chunks, len(cameras), frames_per_chunk)
    judge: _Judge = partial(warn_of_size, cameras=cameras, layout=layout)
    if fps is None:
        return _alone(prepared, source, init_sigma, judge, progress)
    positive("fps", fps)
    if init_sigma is not None:
        raise InvalidInputError("init_sigma: expected None with fps, got a standard deviation")
    if not source.again:
        expected = "an array, a list or a function that returns an iterator, to read it more than once"
        raise InvalidInputError(f"chunks: expected {expected}, got {type(chunks).__name__}")
    prepared.refine_sequence(None, np.empty((0, len(cameras), 1, 2)), float(fps))  # rejects what it must
    return _in_time(prepared, source, float(fps), judge, progress)


def _alone(
    prepared: _skelsplat.Refiner,
    source: _Source,
    init_sigma: ArrayLike | None,
    judge: _Judge,
    progress: bool | Progress,
) -> Iterator[Refinement]:
    done = 0
    with reporter(progress) as report:
        for chunk in source:
            tell = _after(report, done, source.n_frames or 0)
            given = (chunk.init_pose, chunk.detections)
            out = prepared.refine(*given, init_sigma=init_sigma, progress=tell)
            result = Refinement(**refinement_fields(out))
            if done == 0:
                judge(result.pose)
                if init_sigma is not None:
                    warn_of_prior(result)
            yield result
            done += len(chunk)


def _after(report: Progress | None, done: int, total: int) -> Progress | None:
    """Return what reports the progress of a part, after so many frames."""
    if report is None:
        return None
    return lambda now, of_part: report(done + now, max(total, done + of_part))


def _in_time(
    prepared: _skelsplat.Refiner, source: _Source, fps: float, judge: _Judge, progress: bool | Progress
) -> Iterator[SequenceRefinement]:
    solver, ends = _Solver(prepared, source, fps), deque[int]()
    with reporter(progress) as report:
        for chunk in source:
            solver.take(chunk)
            ends.append(solver.read)
            begin = solver.end
            solver.solve(_after(report, begin, solver.n_frames))
            if begin == 0 and solver.solved is not None:
                judge(solver.solved.pose)
            while ends and ends[0] <= solver.end:
                yield solver.frames(ends.popleft())
    solver.check(solver.read == solver.n_frames)


class _Solver:
    """A recording solved in windows: each when its frames are there, with what a sample of all shows."""

    def __init__(self, prepared: _skelsplat.Refiner, source: _Source, fps: float) -> None:
        self.prepared, self.fps, self.n_frames = prepared, fps, source.count()
        self.windows, ranges = _skelsplat.sequence_windows(self.n_frames, fps)
        _, self.overlap = _skelsplat.sequence_window_size(fps)
        self.known: Array | None = None  # what the sample shows; None where one window is all
        if len(self.windows) > 1:
            sample = source.sample(ranges)
            frames, lengths = _Frames.joined(sample), [len(part) for part in sample]
            self.known = prepared.learn_sequence(frames.init_pose, frames.detections, fps, lengths)
        self.held: list[_Frames] = []  # frames that windows still look at, from ``first`` to ``read``
        self.first = self.read = 0
        self.solved: SequenceRefinement | None = None  # frames not returned yet, from ``begin`` to ``end``
        self.begin = self.end = 0

    def check(self, fits: bool) -> None:
        """Raise unless the source had as many frames each time."""
        if not fits:
            expected = f"the same {self.n_frames} frames each time they are gone through"
            raise InvalidInputError(f"chunks: expected {expected}, got {self.read}")

    def take(self, chunk: _Frames) -> None:
        """Add the next frames."""
        self.held.append(chunk)
        self.read += len(chunk)
        self.check(self.read <= self.n_frames)

    def solve(self, report: Progress | None) -> None:
        """Solve the windows whose frames are there."""
        ready = [row for row in self.windows if row[3] <= self.read]
        if not ready:
            return
        frames = _Frames.joined(self.held)
        pose, detections = frames.init_pose, frames.detections
        if self.known is None:
            out = self.prepared.refine_sequence(pose, detections, self.fps, progress=report)
        else:
            rows = [[frame - self.first for frame in row] for row in ready]
            out = self.prepared.refine_windows(pose, detections, self.known, rows, progress=report)
        found = SequenceRefinement(**refinement_fields(out))
        self.solved = found if self.solved is None else joined([self.solved, found])
        self.end, self.windows = ready[-1][2], self.windows[len(ready) :]
        kept = max(self.first, self.end - self.overlap)
        self.held, self.first = [frames.part(kept - self.first, len(frames)).copy()], kept

    def frames(self, stop: int) -> SequenceRefinement:
        """Return the solved frames before ``stop`` and forget them."""
        count, self.begin = stop - self.begin, stop
        if self.solved is None or count == 0:
            out = self.prepared.refine_sequence(None, self.held[0].detections[:0], self.fps)
            return SequenceRefinement(**refinement_fields(out))
        found = frames_of(self.solved, slice(count))
        self.solved = frames_of(self.solved, slice(count, None))
        return found


@dataclass(frozen=True, slots=True)
class _Frames:
    """Checked frames: detections (T, M, N, 2|3), and initial poses (T, N, 3) if there are any."""

    detections: Array
    init_pose: Array | None

    def __len__(self) -> int:
        return len(self.detections)

    def part(self, start: int, stop: int) -> _Frames:
        start = max(start, 0)
        init = None if self.init_pose is None else self.init_pose[start:stop]
        return _Frames(self.detections[start:stop], init)

    def copy(self) -> _Frames:
        init = None if self.init_pose is None else self.init_pose.copy()
        return _Frames(self.detections.copy(), init)

    @staticmethod
    def joined(chunks: list[_Frames]) -> _Frames:
        if len(chunks) == 1:
            return chunks[0]
        init = [chunk.init_pose for chunk in chunks if chunk.init_pose is not None]
        detections = np.concatenate([chunk.detections for chunk in chunks])
        return _Frames(detections, np.concatenate(init) if init else None)


@dataclass(frozen=True)
class _Source:
    """Where chunks come from."""

    open: Callable[[], Iterable[Chunk]]
    n_views: int
    again: bool = True  # whether they can be gone through more than once
    array: Sliceable | None = None
    n_frames: int | None = None  # where it is known without reading

    def __iter__(self) -> Iterator[_Frames]:
        first: _Frames | None = None
        for k, given in enumerate(self.open()):
            chunk = self.checked(given, f"chunks[{k}]", first)
            first = chunk.part(0, 0).copy() if first is None else first
            yield chunk

    def count(self) -> int:
        """Return the number of all frames."""
        return sum(map(len, self)) if self.n_frames is None else self.n_frames

    def sample(self, ranges: list[list[int]]) -> list[_Frames]:
        """Return these frames, given in order."""
        if self.array is not None:
            return [self.checked(self.array[a:b], f"chunks[{a}:{b}]") for a, b in ranges]
        parts: list[list[_Frames]] = [[] for _ in ranges]
        begin = 0
        for chunk in self:
            for (start, stop), part in zip(ranges, parts, strict=True):
                if start < begin + len(chunk) and begin < stop:
                    part.append(chunk.part(start - begin, stop - begin).copy())
            begin += len(chunk)
            if begin >= ranges[-1][1]:
                break
        return [_Frames.joined(part) for part in parts]

    def checked(self, given: Chunk, name: str, first: _Frames | None = None) -> _Frames:
        """Return a chunk, of the same views and joints as the first one."""
        try:
            chunk = _read(dict(given) if isinstance(given, Mapping) else {"detections": given}, self.n_views)
            if first is not None:
                _compare(chunk, first)
        except InvalidInputError as error:
            raise InvalidInputError(f"{name}, {error}") from error
        return chunk


def _read(entries: dict[str, ArrayLike], n_views: int) -> _Frames:
    if "detections" not in entries or not set(entries) <= _ENTRIES:
        has = ", ".join(map(repr, entries)) or "none"
        expected = "'detections' and perhaps 'confidence' and 'init_pose'"
        raise InvalidInputError(f"entries: expected {expected}, got {has}")
    given = _skelsplat.checked_detections(entries["detections"], entries.get("confidence"), n_views)
    if not len(given):  # no frame tells whether there are confidences
        channels = np.shape(entries["detections"])[-1] if entries.get("confidence") is None else 3
        given = np.empty((*given.shape[:-1], channels))
    if entries.get("init_pose") is None:
        return _Frames(given, None)
    init, shape = numbers(entries["init_pose"], "init_pose"), (len(given), given.shape[2], 3)
    if init.shape != shape:
        raise InvalidInputError(f"init_pose: expected shape {shape}, got {init.shape}")
    return _Frames(given, init.copy())  # a source may fill the same array again


def _compare(chunk: _Frames, first: _Frames) -> None:
    shape, of_first = chunk.detections.shape[1:], first.detections.shape[1:]
    if shape != of_first:
        raise InvalidInputError(f"detections: expected frames {of_first} as in the first chunk, got {shape}")
    if (chunk.init_pose is None) != (first.init_pose is None):
        expected, got = ("one", "none") if chunk.init_pose is None else ("none", "one")
        raise InvalidInputError(f"init_pose: expected {expected}, as in the first chunk, got {got}")


def _source_of(chunks: Chunks, n_views: int, per_chunk: int | None) -> _Source:
    """Return what the user gave as a source of chunks."""
    shape: tuple[int, ...] = getattr(chunks, "shape", ())
    if len(shape) == 4 and hasattr(chunks, "__getitem__"):
        array: Any = chunks
        positive("frames_per_chunk", PER_CHUNK if per_chunk is None else per_chunk, "integer")
        size, n = int(per_chunk or PER_CHUNK), int(shape[0])
        pieces = [slice(a, min(a + size, n)) for a in range(0, n, size)]
        return _Source(lambda: (array[piece] for piece in pieces), n_views, array=array, n_frames=n)
    if per_chunk is not None:
        raise InvalidInputError(f"frames_per_chunk: expected None unless chunks is an array, got {per_chunk}")
    if callable(chunks):
        return _Source(chunks, n_views)
    if not isinstance(chunks, Iterable):
        expected = "an array (T, M, N, 2|3), an iterable of such arrays, or a function that returns one"
        raise InvalidInputError(f"chunks: expected {expected}, got {type(chunks).__name__}")
    given: Iterable[Chunk] = chunks
    return _Source(lambda: given, n_views, again=iter(given) is not given)
