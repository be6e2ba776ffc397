"""Chunks of a recording as users have them: arrays that are read by slices, iterables, functions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import _skelsplat
from skelsplat._arrays import Array, numbers, positive
from skelsplat.exceptions import InvalidInputError

# Frames per chunk of an array: several windows in time at any usual rate, and some 100 MB of results.
PER_CHUNK = 10_000
_ENTRIES = ("detections", "confidence", "init_pose")


class Sliceable(Protocol):
    """Frames (T, M, N, 2|3) that are read where they are sliced: a memory map, an HDF5 or a Zarr array."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, frames: slice, /) -> Any: ...


Chunk: TypeAlias = ArrayLike | Mapping[str, ArrayLike]
Chunks: TypeAlias = Sliceable | Iterable[Chunk] | Callable[[], Iterable[Chunk]]


@dataclass(frozen=True, slots=True)
class CheckedChunk:
    """Checked frames: detections (T, M, N, 2|3), and initial poses (T, N, 3) if there are any."""

    detections: Array
    init_pose: Array | None

    def __len__(self) -> int:
        return len(self.detections)

    def part(self, start: int, stop: int) -> CheckedChunk:
        start = max(start, 0)
        init = None if self.init_pose is None else self.init_pose[start:stop]
        return CheckedChunk(self.detections[start:stop], init)

    def copy(self) -> CheckedChunk:
        init = None if self.init_pose is None else self.init_pose.copy()
        return CheckedChunk(self.detections.copy(), init)

    @staticmethod
    def joined(chunks: list[CheckedChunk]) -> CheckedChunk:
        if len(chunks) == 1:
            return chunks[0]
        init = [chunk.init_pose for chunk in chunks if chunk.init_pose is not None]
        detections = np.concatenate([chunk.detections for chunk in chunks])
        return CheckedChunk(detections, np.concatenate(init) if init else None)


def checked(given: Chunk, name: str, n_views: int, first: CheckedChunk | None = None) -> CheckedChunk:
    """Return a chunk, of the same views and joints as the first one."""
    try:
        chunk = _read(dict(given) if isinstance(given, Mapping) else {"detections": given}, n_views)
        if first is not None:
            _compare(chunk, first)
    except InvalidInputError as error:
        raise InvalidInputError(f"{name}, {error}") from error
    return chunk


def _read(entries: dict[str, ArrayLike], n_views: int) -> CheckedChunk:
    if "detections" not in entries or not set(entries) <= set(_ENTRIES):
        has = ", ".join(map(repr, entries)) or "none"
        expected = "'detections' and perhaps 'confidence' and 'init_pose'"
        raise InvalidInputError(f"entries: expected {expected}, got {has}")
    given = _skelsplat.checked_detections(entries["detections"], entries.get("confidence"), n_views)
    if not len(given):  # no frame tells whether there are confidences
        channels = np.shape(entries["detections"])[-1] if entries.get("confidence") is None else 3
        given = np.empty((*given.shape[:-1], channels))
    if entries.get("init_pose") is None:
        return CheckedChunk(given, None)
    init, shape = numbers(entries["init_pose"], "init_pose"), (len(given), given.shape[2], 3)
    if init.shape != shape:
        raise InvalidInputError(
            f"init_pose: expected shape {shape}, as in the detections, got shape {init.shape}"
        )
    return CheckedChunk(given, init.copy())  # a source may fill the same array again


def _compare(chunk: CheckedChunk, first: CheckedChunk) -> None:
    shape, of_first = chunk.detections.shape, first.detections.shape
    if shape[1:] != of_first[1:]:
        expected = ", ".join(map(str, of_first[1:]))
        raise InvalidInputError(
            f"detections: expected shape (T, {expected}), as in the first chunk, got shape {shape}"
        )
    if (chunk.init_pose is None) != (first.init_pose is None):
        expected, got = ("one", "none") if chunk.init_pose is None else ("none", "one")
        raise InvalidInputError(f"init_pose: expected {expected}, as in the first chunk, got {got}")


@dataclass(frozen=True)
class Source:
    """Where chunks come from."""

    open: Callable[[], Iterable[Chunk]]
    n_views: int
    again: bool = True  # whether they can be gone through more than once
    array: Sliceable | None = None
    n_frames: int | None = None  # where it is known without reading

    def __iter__(self) -> Iterator[CheckedChunk]:
        first: CheckedChunk | None = None
        for k, given in enumerate(self.open()):
            chunk = checked(given, f"chunks[{k}]", self.n_views, first)
            first = chunk.part(0, 0).copy() if first is None else first
            yield chunk

    def count(self) -> int | None:
        """Return the number of all frames; None if they can be gone through only once."""
        if self.n_frames is not None or not self.again:
            return self.n_frames
        return sum(map(len, self))

    def sample(self, ranges: list[list[int]]) -> list[CheckedChunk]:
        """Return these frames, given in order."""
        if self.array is None:
            return sample_of(self, ranges)
        pieces = [(self.array[a:b], f"chunks[{a}:{b}]") for a, b in ranges]
        return [checked(piece, name, self.n_views) for piece, name in pieces]


def sample_of(chunks: Iterable[CheckedChunk], ranges: list[list[int]]) -> list[CheckedChunk]:
    """Return these frames, given in order."""
    parts: list[list[CheckedChunk]] = [[] for _ in ranges]
    begin = 0
    for chunk in chunks:
        for (start, stop), part in zip(ranges, parts, strict=True):
            if start < begin + len(chunk) and begin < stop:
                part.append(chunk.part(start - begin, stop - begin).copy())
        begin += len(chunk)
        if begin >= ranges[-1][1]:
            break
    return [CheckedChunk.joined(part) for part in parts]


def source_of(chunks: Chunks, n_views: int, per_chunk: int | None) -> Source:
    """Return what the user gave as a source of chunks."""
    shape: tuple[int, ...] = getattr(chunks, "shape", ())
    if len(shape) == 4 and hasattr(chunks, "__getitem__"):
        array: Any = chunks
        positive("frames_per_chunk", PER_CHUNK if per_chunk is None else per_chunk, "integer")
        size = int(per_chunk or PER_CHUNK)
        n = int(shape[0])
        pieces = [slice(a, min(a + size, n)) for a in range(0, n, size)]
        return Source(lambda: (array[piece] for piece in pieces), n_views, array=array, n_frames=n)
    if per_chunk is not None:
        raise InvalidInputError(f"frames_per_chunk: expected None unless chunks is an array, got {per_chunk}")
    if callable(chunks):
        return Source(chunks, n_views)
    if not isinstance(chunks, Iterable):
        expected = "an array (T, M, N, 2|3), an iterable of such arrays, or a function that returns one"
        raise InvalidInputError(f"chunks: expected {expected}, got {type(chunks).__name__}")
    given: Iterable[Chunk] = chunks
    return Source(lambda: given, n_views, again=iter(given) is not given)
