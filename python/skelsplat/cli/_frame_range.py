"""``--range``: which frames of a run to draw, in its own numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

Range = Annotated[
    str | None,
    typer.Option(
        "--range",
        metavar="A-B",
        help="Frames to draw, in the run's numbers; A- and -B leave one end open; A is one frame.",
        show_default="all",
        rich_help_panel="Drawing",
    ),
]


@dataclass(frozen=True)
class FrameRange:
    """First and last frame number, None for an open end."""

    first: int | None = None
    last: int | None = None

    @classmethod
    def parse(cls, value: str | None) -> FrameRange:
        """Return what ``A-B``, ``A-``, ``-B`` or ``A`` alone says, or raise `typer.BadParameter`."""
        if value is None:
            return cls()
        if re.fullmatch(r"\s*\d+\s*", value):
            return cls(int(value), int(value))
        match = re.fullmatch(r"\s*(\d*)\s*-\s*(\d*)\s*", value)
        if match is None or not any(match.groups()):
            raise _refused("A-B, A-, -B or A, frame numbers", repr(value))
        first, last = (int(end) if end else None for end in match.groups())
        return cls(first, last)

    def within(self, frames: npt.NDArray[np.int64]) -> tuple[int, int]:
        """Return the first and the last number to draw of a run's ascending ``frames``.

        Raises
        ------
        typer.BadParameter
            If the range holds none of them.
        """
        known = int(frames[0]), int(frames[-1])
        first = known[0] if self.first is None else self.first
        last = known[1] if self.last is None else self.last
        if not ((frames >= first) & (frames <= last)).any():
            ends = ["" if end is None else str(end) for end in (self.first, self.last)]
            said = ends[0] if ends[0] == ends[1] else "-".join(ends)
            raise _refused(f"some of the frames {known[0]} to {known[1]}", said)
        return max(first, known[0]), min(last, known[1])


def _refused(expected: str, actual: str) -> typer.BadParameter:
    return typer.BadParameter(f"expected {expected}, got {actual}", param_hint="--range")
