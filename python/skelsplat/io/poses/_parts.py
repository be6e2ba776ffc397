"""Poses of a recording that is too long for the memory, in files of rows, for the writers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Index
from skelsplat.io._rows import RowFile
from skelsplat.io.poses._pose_data import ARRAYS, PoseData

_TEXT = np.dtype("U16")  # room for every status and stop reason


@dataclass(frozen=True)
class PoseParts:
    """The poses of T frames, of which a few at a time are in memory: iterating yields them as `PoseData`.

    Attributes
    ----------
    head : PoseData
        What is not by frame: names, unit, frame rate, bones; it has no frames.
    frames : (T,) int
        As of `PoseData`.
    rows : dict of RowFile
        By name of the array of `PoseData`, those that the poses have.
    size : int
        Frames that are in memory at a time.
    """

    head: PoseData
    frames: Index
    rows: Mapping[str, RowFile]
    size: int

    @property
    def frame_rate(self) -> float | None:
        """As of `PoseData`."""
        return self.head.frame_rate

    def __iter__(self) -> Iterator[PoseData]:
        names = {entry.name for entry in fields(PoseData)} - {"frames", *ARRAYS}
        fixed: dict[str, Any] = {name: getattr(self.head, name) for name in names}
        for first in range(0, len(self.frames), self.size):
            end = min(first + self.size, len(self.frames))
            arrays: dict[str, Any] = {name: rows.read(first, end) for name, rows in self.rows.items()}
            yield PoseData(**fixed, **arrays, frames=self.frames[first:end])


class PoseStore:
    """Collects poses part by part in the files of a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._rows = folder, dict[str, RowFile]()

    def append(self, data: PoseData) -> None:
        """Add further frames."""
        for name, (_, kind) in ARRAYS.items():
            array = getattr(data, name)
            if len(array) != len(data.frames):
                continue
            if name not in self._rows:
                dtype = _TEXT if kind is np.str_ else np.dtype(kind)
                self._rows[name] = RowFile(self._folder / name, array.shape[1:], dtype)
            self._rows[name].append(array)

    def parts(self, head: PoseData, frames: Index, size: int) -> PoseParts:
        """Return everything that was added, with what ``head``, any part, says of the whole."""
        nobody: dict[str, Any] = {name: getattr(head, name)[:0] for name in (*self._rows, "frames")}
        return PoseParts(replace(head, **nobody), frames, self._rows, size)


Poses = PoseData | PoseParts


def parts_of(data: Poses) -> tuple[PoseData, Index, Iterator[PoseData]]:
    """Return what is said of the whole, the frames, and the parts: of poses in memory a single one."""
    if isinstance(data, PoseData):
        return data, data.frames, iter([data])
    return data.head, data.frames, iter(data)
