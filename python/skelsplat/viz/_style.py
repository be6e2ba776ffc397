"""What all figures share: colours, sizes, heading, and files written whole or not at all."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D

from skelsplat._atomic import atomic_write

# Okabe and Ito's palette: distinguishable with the common colour-vision deficiencies.
BEFORE = "#8c8c8c"
AFTER = "#0072b2"
LEFT = "#0072b2"
RIGHT = "#d55e00"
MIDDLE = "#222222"
SIDES = {"left": LEFT, "right": RIGHT, "middle": MIDDLE}
DETECTION = "#009e73"
REJECTED = "#b3006b"
SWAPPED = "#e69f00"
# One colour per person, in the order of their identities; the eighth has that of the first.
PEOPLE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222")
_PALEST = 0.22  # of a tint

# matplotlib's settings of every figure. No text is a formula: names may hold dollar signs. Type 42 fonts:
# text in a PDF can be selected and edited, and publishers take it.
_COMMON: Any = {
    "text.parse_math": False,
    "pdf.fonttype": 42,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.titlelocation": "left",
    "grid.color": "0.92",
    "legend.frameon": False,
    "legend.borderpad": 0.0,
    "legend.borderaxespad": 0.8,
}
SCREEN: Any = {
    **_COMMON,
    "figure.dpi": 100,
    "figure.constrained_layout.w_pad": 0.15,
    "figure.constrained_layout.h_pad": 0.1,
    "font.size": 10,
    "axes.titlesize": 13,
    "axes.labelsize": 11,
    "legend.fontsize": 11,
    "legend.title_fontsize": 13,
}
# As a paper prints it: 180 mm wide, two columns of a journal.
PRINT: Any = {
    **_COMMON,
    "figure.dpi": 300,
    "font.size": 7,
    "axes.titlesize": 7,
    "axes.labelsize": 7,
    "axes.linewidth": 0.6,
    "axes.titlepad": 3,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    **{f"{axis}tick.major.{what}": size for axis in "xy" for what, size in (("size", 2.5), ("width", 0.6))},
    "legend.fontsize": 7,
    "legend.title_fontsize": 9,
}
SCREEN_IN, PRINT_IN = 14.0, 7.1  # widths
_SCREEN_LETTERS, _NOTE_LETTERS = 135, 138  # of a line of a heading, and of a note

_ABOUT: dict[str, str | None] = {"Creator": "skelsplat", "CreationDate": None}  # same data, same file


@contextmanager
def drawn_for(settings: Any) -> Iterator[None]:
    """Draw with matplotlib's settings `SCREEN` or `PRINT`; a decorator, too."""
    with rc_context(settings):
        yield


def person_colour(place: int) -> str:
    """Return the colour of the person at a place among several."""
    return PEOPLE[place % len(PEOPLE)]


def tint(colour: str, share: float) -> str:
    """Return ``#rrggbb`` on white: pale for a share of 0, itself for 1."""
    strength = _PALEST + (1 - _PALEST) * min(max(share, 0.0), 1.0)
    parts = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return "#" + "".join(f"{round(255 + strength * (part - 255)):02x}" for part in parts)


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure that places its axes, legends and texts by itself, on an Agg canvas."""
    figure = Figure(figsize=(width_in, height_in), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def head(figure: FigureBase, title: str, entries: Sequence[Artist] = ()) -> None:
    """Write a title above a figure, and below it a legend in one line."""
    figure.legend(
        handles=list(entries),
        loc="outside upper left",
        ncols=max(len(entries), 1),
        title="\n".join(textwrap.wrap(title, _SCREEN_LETTERS)),
        alignment="left",
    )


def entry(colour: str, label: str, **style: object) -> Line2D:
    """Return a line, or with ``marker`` and no ``linestyle`` a mark, for a legend."""
    line = {"linestyle": "" if "marker" in style else "-", "color": colour, "label": label, **style}
    return Line2D([], [], **line)  # type: ignore[arg-type]


def write_notes(figure: Figure, notes: Sequence[str]) -> None:
    """Write notes below a printed page; each begins a line."""
    lines = [line for note in notes for line in textwrap.wrap(note, _NOTE_LETTERS)]
    figure.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=7, color="0.25")


@drawn_for(_COMMON)
def save_png(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write ``figure`` as a PNG, whole or not at all; `DatasetError` if the folder cannot be written."""
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=figure.dpi, metadata={"Software": "skelsplat"})
    return Path(path)


@drawn_for(_COMMON)
def write_pages(pages: Sequence[Figure], stem: Path, formats: Sequence[str]) -> list[Path]:
    """Write pages as ``stem.png``, ``stem_2.png`` … and as one ``stem.pdf``; each file whole or not at all.

    Pages of an earlier, longer series of PNG files are removed.
    """
    written = []
    if "png" in formats:
        written += [save_png(page, _numbered(stem, number)) for number, page in enumerate(pages, 1)]
        number = len(pages) + 1
        while _numbered(stem, number).is_file():
            _numbered(stem, number).unlink()
            number += 1
    if "pdf" in formats:
        written.append(stem.with_name(f"{stem.name}.pdf"))
        with atomic_write(written[-1]) as stream, PdfPages(stream, metadata=_ABOUT) as document:
            for page in pages:
                document.savefig(page, dpi=page.dpi)
    return written


def _numbered(stem: Path, number: int) -> Path:
    return stem.with_name(f"{stem.name}.png" if number == 1 else f"{stem.name}_{number}.png")
