"""Recordings in time: ``refine_sequence`` in one solve, ``refine_batches`` in the memory of a chunk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat import _skelsplat
from skelsplat._arrays import Array, Index, numbers, positive
from skelsplat._frozen import of_new_images
from skelsplat._refine import Cameras, Progress, Refinement, refinement_fields, reporter, warn_of_size
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat.exceptions import InvalidInputError

# Frames per chunk of an array: several windows in time at any usual rate, and some 100 MB of results.
PER_CHUNK = 10_000
# Fields that all frames share.
OF_BONES = ("bones", "bone_lengths", "bone_length_sigma", "view_noise")

_Kind = TypeVar("_Kind", bound=Refinement)


@dataclass(frozen=True, slots=True)
class SequenceRefinement(Refinement):
    """What ``refine_sequence`` returns: a `Refinement` of T frames, and what they show together.

    ``init_pose`` is the pose of each frame alone, ``noise`` that of the whole recording, and ``joint_status``
    ``"inferred"`` for a joint that its bones and the frames around it determine.

    ``velocity`` (T, N, 3) is in units of the cameras per second, NaN where a neighbouring frame is missing,
    and ``velocity_uncertainty`` (T, N, 3, 3) its posterior covariance. ``bones`` (B, 2) are the joints at
    both ends of every limb of the layout; ``bone_lengths`` and ``bone_length_sigma`` (B,), one for the whole
    recording, their lengths and standard errors: NaN and infinite for a bone that is never seen.
    ``view_noise`` (M,) is the ``noise`` of each view: a wrong camera's is large.
    """

    velocity: NDArray[np.float64]
    velocity_uncertainty: NDArray[np.float64]
    bones: NDArray[np.int64]
    bone_lengths: NDArray[np.float64]
    bone_length_sigma: NDArray[np.float64]
    view_noise: NDArray[np.float64]


def refine_sequence(
    detections: ArrayLike,
    cameras: Cameras,
    *,
    fps: float,
    layout: str | Layout | None = None,
    init_pose: ArrayLike | None = None,
    confidence: ArrayLike | None = None,
    config: RefineConfig | None = None,
    progress: bool | Progress = False,
) -> SequenceRefinement:
    """Refine the frames of one motion together: bones keep their length, joints move smoothly.

    Lengths of the layout's limbs, speeds and the detector's errors are learnt from the recording. Gaps of up
    to a second are bridged. Where all of at least three views agree on a joint, the other frames never
    outvote them. docs/method.md has the mathematics.

    Parameters
    ----------
    detections : (T, M, N, 2|3)
        As in ``refine``: the frames of one motion in order, at a constant rate. A frame without detections is
        NaN, not left out.
    cameras, layout, init_pose, confidence, config, progress
        As in ``refine``; ``annealed`` only. Without a layout, or with one that has no limbs, there are no
        bones.
    fps : float
        Frames per second.
    """
    positive("fps", fps)
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    seen = numbers(detections, "detections")
    if seen.ndim == 4 and seen.shape[1] == len(cameras):
        seen = of_new_images(seen, [camera.name or f"camera {i}" for i, camera in enumerate(cameras)])
    with reporter(progress) as report:
        out = prepared.refine_sequence(init_pose, seen, float(fps), confidence=confidence, progress=report)
    warn_of_size(out["pose"], cameras, layout)
    return SequenceRefinement(**refinement_fields(out))


def frames_of(result: _Kind, frames: Index | slice) -> _Kind:
    """Return some frames of a result."""
    names = {entry.name for entry in fields(result)} - {*OF_BONES}
    return replace(result, **{name: getattr(result, name)[frames] for name in names})


def joined(results: Sequence[_Kind]) -> _Kind:
    """Return the frames of all results of one recording, in time with the bones of the last."""
    names = {entry.name for entry in fields(results[0])} - {*OF_BONES}
    parts = {name: np.concatenate([getattr(result, name) for result in results]) for name in names}
    return replace(results[-1], **parts)


class Sliceable(Protocol):
    """Frames (T, M, N, 2|3) that are read where they are sliced: a memory map, an HDF5 or a Zarr array."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, frames: slice, /) -> Any: ...


Chunks: TypeAlias = Sliceable | Iterable[ArrayLike] | Callable[[], Iterable[ArrayLike]]
_Judge: TypeAlias = Callable[[NDArray[np.float64]], None]


def refine_batches(
    chunks: Chunks,
    cameras: Cameras,
    *,
    fps: float | None = None,
    layout: str | Layout | None = None,
    config: RefineConfig | None = None,
    frames_per_chunk: int | None = None,
    progress: bool | Progress = False,
) -> Iterator[Refinement]:
    """Refine a recording of any length chunk after chunk, in memory that does not grow with it.

    Without ``fps`` the frames are refined as by `refine`, with ``fps`` in time, as by `refine_sequence`. The
    k-th result is that of the k-th chunk, with the bits of one call with the whole recording, except for
    ``bone_length_sigma``, which is that of the part solved with the chunk. Images that a camera repeats are
    not looked for.

    Parameters
    ----------
    chunks : array, iterable or function
        Detections of consecutive frames:

        - an array (T, M, N, 2|3) that is read where it is sliced, such as a memory map of NumPy or a data set
          of h5py or Zarr: it is cut into chunks of ``frames_per_chunk``;
        - an iterable of chunks (T, M, N, 2|3), or a function that returns a new one at each call. T may
          differ, also be 0.

        With ``fps`` an iterable or function is gone through three times (to count the frames, for a sample to
        learn from, to solve), so a generator has to be given as the function that makes it.
    cameras, layout, config
        As in `refine`.
    fps : float, optional
        Frames per second, of one motion in order. None refines every frame by itself.
    frames_per_chunk : int, optional
        For an array. In time, windows of 40 s (at least 600 frames) are solved, one per core: chunks of
        several windows use all cores.
    progress : bool or callable
        As in `refine`; the number of frames in all is that read so far where more is not known.

    Returns
    -------
    iterator of Refinement
        Of `SequenceRefinement` with ``fps``. Chunks are read when results are asked for. The message of an
        `InvalidInputError` in the iteration begins with ``chunks[k]``.
    """
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    source = _source_of(chunks, len(cameras), frames_per_chunk)
    judge: _Judge = partial(warn_of_size, cameras=cameras, layout=layout)
    if fps is None:
        return _alone(prepared, source, judge, progress)
    positive("fps", fps)
    if not source.again:
        expected = "an array, a list or a function that returns an iterator, to read it more than once"
        raise InvalidInputError(f"chunks: expected {expected}, got {type(chunks).__name__}")
    prepared.refine_sequence(None, np.empty((0, len(cameras), 1, 2)), float(fps))  # rejects what it must
    return _in_time(prepared, source, float(fps), judge, progress)


def _alone(
    prepared: _skelsplat.Refiner, source: _Source, judge: _Judge, progress: bool | Progress
) -> Iterator[Refinement]:
    done = 0
    with reporter(progress) as report:
        for chunk in source:
            tell = _after(report, done, source.n_frames or 0)
            result = Refinement(**refinement_fields(prepared.refine(None, chunk, progress=tell)))
            if done == 0:
                judge(result.pose)
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
        self.known: _skelsplat.Known | None = None  # what the sample shows; None where one window is all
        if len(self.windows) > 1:
            sample = source.sample(ranges)
            self.known = prepared.learn_sequence(None, np.concatenate(sample), fps, [*map(len, sample)])
        self.held: list[Array] = []  # frames that windows still look at, from ``first`` to ``read``
        self.first = self.read = 0
        self.solved: SequenceRefinement | None = None  # frames not returned yet, from ``begin`` to ``end``
        self.begin = self.end = 0

    def check(self, fits: bool) -> None:
        """Raise unless the source had as many frames each time."""
        if not fits:
            expected = f"the same {self.n_frames} frames each time they are gone through"
            raise InvalidInputError(f"chunks: expected {expected}, got {self.read}")

    def take(self, chunk: Array) -> None:
        """Add the next frames."""
        self.held.append(chunk)
        self.read += len(chunk)
        self.check(self.read <= self.n_frames)

    def solve(self, report: Progress | None) -> None:
        """Solve the windows that have all their frames."""
        ready = [row for row in self.windows if row[3] <= self.read]
        if not ready:
            return
        frames = np.concatenate(self.held)
        if self.known is None:
            out = self.prepared.refine_sequence(None, frames, self.fps, progress=report)
        else:
            rows = [[frame - self.first for frame in row] for row in ready]
            out = self.prepared.refine_windows(None, frames, self.known, rows, progress=report)
        found = SequenceRefinement(**refinement_fields(out))
        self.solved = found if self.solved is None else joined([self.solved, found])
        self.end, self.windows = ready[-1][2], self.windows[len(ready) :]
        kept = max(self.first, self.end - self.overlap)
        self.held, self.first = [frames[kept - self.first :].copy()], kept

    def frames(self, stop: int) -> SequenceRefinement:
        """Return the solved frames before ``stop`` and forget them."""
        count, self.begin = stop - self.begin, stop
        if self.solved is None or count == 0:
            out = self.prepared.refine_sequence(None, self.held[0][:0], self.fps)
            return SequenceRefinement(**refinement_fields(out))
        found = frames_of(self.solved, slice(count))
        self.solved = frames_of(self.solved, slice(count, None))
        return found


@dataclass(frozen=True)
class _Source:
    """Where chunks come from."""

    open: Callable[[], Iterable[ArrayLike]]
    n_views: int
    again: bool = True  # whether they can be gone through more than once
    array: Sliceable | None = None
    n_frames: int | None = None  # where it is known without reading

    def __iter__(self) -> Iterator[Array]:
        shape: tuple[int, ...] | None = None
        for k, given in enumerate(self.open()):
            chunk = self.checked(given, f"chunks[{k}]")
            shape = chunk.shape[1:] if shape is None else shape
            if chunk.shape[1:] != shape:
                expected = f"frames of shape {shape} as in the first chunk"
                raise InvalidInputError(
                    f"chunks[{k}], detections: expected {expected}, got {chunk.shape[1:]}"
                )
            yield chunk

    def count(self) -> int:
        """Return the number of all frames."""
        return sum(map(len, self)) if self.n_frames is None else self.n_frames

    def sample(self, ranges: list[list[int]]) -> list[Array]:
        """Return these frames, given in order."""
        if self.array is not None:
            return [self.checked(self.array[a:b], f"chunks[{a}:{b}]") for a, b in ranges]
        parts: list[list[Array]] = [[] for _ in ranges]
        begin = 0
        for chunk in self:
            for (start, stop), part in zip(ranges, parts, strict=True):
                if start < begin + len(chunk) and begin < stop:
                    part.append(chunk[max(start - begin, 0) : stop - begin].copy())
            begin += len(chunk)
            if begin >= ranges[-1][1]:
                break
        return [np.concatenate(part) for part in parts]

    def checked(self, given: ArrayLike, name: str) -> Array:
        """Return a chunk; a source may fill the same array again."""
        try:
            chunk = _skelsplat.checked_detections(given, None, self.n_views)
        except InvalidInputError as error:
            raise InvalidInputError(f"{name}, {error}") from error
        # without frames it does not tell whether there are confidences
        return chunk if len(chunk) else np.empty((*chunk.shape[:-1], np.shape(given)[-1]))


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
    given: Iterable[ArrayLike] = chunks
    return _Source(lambda: given, n_views, again=iter(given) is not given)
