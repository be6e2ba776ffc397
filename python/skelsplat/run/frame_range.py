"""Which frames of a run to draw, in its own numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass

from skelsplat._arrays import Index
from skelsplat.exceptions import InvalidInputError

MANY = 50_000
"""Frames of a run from which a range of them is read without the others."""


@dataclass(frozen=True)
class FrameRange:
    """First and last frame number, None for an open end."""

    first: int | None = None
    last: int | None = None

    @classmethod
    def parse(cls, value: str | None) -> FrameRange:
        """Return what ``A-B``, ``A-``, ``-B`` or ``A`` alone means; None is every frame."""
        match = re.fullmatch(r"\s*(\d*)\s*(-?)\s*(\d*)\s*", value or "-")
        if match is None or (value is not None and not (match[1] or match[3])):
            raise InvalidInputError(f"range: expected A-B, A-, -B or A, frame numbers, got {value!r}")
        first, dash, last = match.groups()
        ends = (first, last) if dash else (first, first)
        return cls(*(int(end) if end else None for end in ends))

    def to_read(self, frames: Index) -> tuple[int, int]:
        """Return the first and the last number to read: of few frames all, of many as `within`."""
        if len(frames) <= MANY:
            return (int(frames[0]), int(frames[-1])) if len(frames) else (0, 0)
        return self.within(frames)

    def within(self, frames: Index) -> tuple[int, int]:
        """Return the first and the last number to draw of a run's ascending ``frames``."""
        known = int(frames[0]), int(frames[-1])
        first = known[0] if self.first is None else self.first
        last = known[1] if self.last is None else self.last
        if not ((frames >= first) & (frames <= last)).any():
            given = "-".join(
                dict.fromkeys("" if end is None else str(end) for end in (self.first, self.last))
            )
            raise InvalidInputError(
                f"range: expected some of the frames {known[0]} to {known[1]}, got {given}"
            )
        return max(first, known[0]), min(last, known[1])
