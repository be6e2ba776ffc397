"""Poses of a recording that is too long for the memory, in files of rows, for the writers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Index
from skelsplat.io._rows import RowFile
from skelsplat.io.poses._pose_data import ARRAYS, PoseData

_TEXT = np.dtype("U16")  # room for every status and stop reason


class PoseParts:
    """The poses of T frames in a folder, of which a few are in memory: iterating yields them as `PoseData`.

    Attributes
    ----------
    head : PoseData
        What is not by frame, of the last part: names, unit, frame rate, bones; it has no frames.
    frames : (T,) int
        As of `PoseData`, those that are not appended yet as well.
    rows : dict of RowFile
        By name of the array of `PoseData`, those that the poses have.
    """

    head: PoseData

    def __init__(self, folder: Path, frames: Index, size: int) -> None:
        self.frames, self.rows = frames, dict[str, RowFile]()
        self._folder, self._size = folder, size

    @property
    def frame_rate(self) -> float | None:
        """As of `PoseData`."""
        return self.head.frame_rate

    def append(self, data: PoseData) -> None:
        """Add further frames."""
        nobody: dict[str, Any] = {"frames": data.frames[:0]}
        for name, (_, kind) in ARRAYS.items():
            array = getattr(data, name)
            if len(array) != len(data.frames):
                continue
            if name not in self.rows:
                dtype = _TEXT if kind is np.str_ else np.dtype(kind)
                self.rows[name] = RowFile(self._folder / name, array.shape[1:], dtype)
            self.rows[name].append(array)
            nobody[name] = array[:0]
        self.head = replace(data, **nobody)

    def __iter__(self) -> Iterator[PoseData]:
        for first in range(0, len(self.frames), self._size):
            end = min(first + self._size, len(self.frames))
            arrays: dict[str, Any] = {name: rows.read(first, end) for name, rows in self.rows.items()}
            yield replace(self.head, **arrays, frames=self.frames[first:end])


Poses = PoseData | PoseParts


def parts_of(data: Poses) -> tuple[PoseData, Index, Iterator[PoseData]]:
    """Return what is said of the whole, the frames, and the parts: of poses in memory a single one."""
    head = data if isinstance(data, PoseData) else data.head
    return head, data.frames, iter([data] if isinstance(data, PoseData) else data)
