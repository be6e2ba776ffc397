"""Where the frames of a big csv file of detections are: one pass finds blocks of lines, read later."""

from __future__ import annotations

import csv
import io
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from skelsplat._budget import MOST_LINE, no_text, opened

_LINES = 4096  # of a block, at least


@dataclass
class Index:
    """The blocks of a file whose lines are together by camera and frame, the frames of each in order."""

    path: Path
    columns: Mapping[str, int]
    joints: dict[str, None] = field(default_factory=dict)  # in the order in which they come
    # by camera, its frames, ascending, and the block that each is in
    frames: dict[str, array[int]] = field(default_factory=dict)
    blocks: dict[str, array[int]] = field(default_factory=dict)
    _begins: list[tuple[int, int]] = field(
        default_factory=list
    )  # of blocks: the byte, and the number of the line
    _width: int = 0  # fields in a line

    @classmethod
    def of(cls, path: Path, columns: Mapping[str, int], width: int) -> Index | None:
        """Return the index; None if the lines are in another order, or not plain enough to be told apart."""
        found = cls(path, columns, _width=width)
        with opened(path) as stream:
            return found if found._scan(stream) else None

    def _scan(self, stream: IO[bytes]) -> bool:
        at = len(stream.readline())
        frame, camera, joint = (self.columns.get(name) for name in ("frame", "camera", "joint"))
        last, first = (b"", b""), 2
        lines = iter(lambda: stream.readline(MOST_LINE + 1), b"")
        for number, line in enumerate(lines, start=2):
            cells = line.split(b",")
            if len(line) > MOST_LINE or len(cells) != self._width or b'"' in line:
                return False
            key = (cells[frame or 0], cells[camera] if camera is not None else b"")
            self.joints.setdefault(cells[joint or 0].decode("utf-8", "replace").strip())
            if key != last:
                begins = not self._begins or (number - first >= _LINES and key[0] != last[0])
                if begins:
                    self._begins.append((at, number))
                    first = number
                if not self._add(*(part.decode("utf-8", "replace").strip() for part in key)):
                    return False
                last = key
            at += len(line)
        self._begins.append((at, 0))
        return len(self._begins) > 1

    def _add(self, frame: str, camera: str) -> bool:
        frames = self.frames.setdefault(camera, array("q"))
        if not frame.isdecimal() or len(frame) > 18 or (frames and int(frame) <= frames[-1]):
            return False
        frames.append(int(frame))
        self.blocks.setdefault(camera, array("q")).append(len(self._begins) - 1)
        return True

    def lines(self, block: int) -> Iterator[tuple[int, list[str]]]:
        """Yield the lines of a block with their numbers."""
        (at, first), (end, _) = self._begins[block : block + 2]
        with opened(self.path) as stream:
            stream.seek(at)
            content = stream.read(end - at)
        try:
            text = content.decode()
        except UnicodeDecodeError as error:
            raise no_text(self.path, content, error.start, at) from error
        return enumerate(csv.reader(io.StringIO(text, newline=""), strict=True), start=first)
