"""What all figures share: colours, sizes, legends, notes, and files written whole or not at all."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from skelsplat._atomic import atomic_write

# Okabe and Ito's palette: distinguishable with the common colour-vision deficiencies.
BEFORE = "#8c8c8c"
AFTER = "#0072b2"
LEFT = "#0072b2"
RIGHT = "#d55e00"
MIDDLE = "#222222"
SIDES = {"left": LEFT, "right": RIGHT, "middle": MIDDLE}
DETECTION = "#009e73"
REPROJECTION = "#d55e00"
REJECTED = "#b3006b"
SWAPPED = "#e69f00"
# One colour per person, in the order of their identities; the eighth has that of the first.
PEOPLE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222")
_PALEST = 0.22  # of a tint


def person_colour(place: int) -> str:
    """Return the colour of the person at a place among several."""
    return PEOPLE[place % len(PEOPLE)]


def tint(colour: str, share: float) -> str:
    """Return ``#rrggbb`` on white: pale for a share of 0, itself for 1."""
    strength = _PALEST + (1 - _PALEST) * min(max(share, 0.0), 1.0)
    parts = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return "#" + "".join(f"{round(255 + strength * (part - 255)):02x}" for part in parts)


@dataclass(frozen=True)
class Sheet:
    """Width of a figure, pixels per inch, and sizes of its texts in points."""

    width_in: float
    dpi: int
    title_pt: float
    label_pt: float
    small_pt: float


SCREEN = Sheet(width_in=14.0, dpi=100, title_pt=13, label_pt=11, small_pt=10)
# Words in place of what is not there.
REMARK: dict[str, Any] = {"fontsize": SCREEN.small_pt, "color": "0.35", "va": "center"}
# A figure as a paper prints it: 180 mm, two columns of a journal.
PRINT = Sheet(width_in=7.1, dpi=300, title_pt=9.0, label_pt=8.0, small_pt=7.0)
PRINT_HEIGHT_IN = 9.4  # what a page of A4 or letter leaves room for with a caption

_ABOUT: dict[str, str | None] = {"Creator": "skelsplat", "CreationDate": None}

_NOTE_LETTERS = 138  # of `PRINT.small_pt` across a page
_NOTE_IN = 0.135  # height of a line of them
_EDGE_IN = 0.08


def new_figure(height_in: float, sheet: Sheet = SCREEN) -> Figure:
    """Return an empty figure as wide as ``sheet`` and ``height_in`` inches tall, on an Agg canvas."""
    figure = Figure(figsize=(sheet.width_in, height_in), dpi=sheet.dpi, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def box(
    figure: Figure, left: float, bottom: float, width: float, height: float
) -> tuple[float, float, float, float]:
    """Return the place of axes in parts of ``figure``, from inches."""
    across, up = figure.get_size_inches()
    return left / across, bottom / up, width / across, height / up


def tidy(axes: Axes, sheet: Sheet = SCREEN) -> None:
    """Remove the upper and right edge of an axes and set its lines and texts to the sizes of ``sheet``."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.xaxis.label.set_fontsize(sheet.label_pt)
    axes.yaxis.label.set_fontsize(sheet.label_pt)
    if sheet is PRINT:
        for spine in axes.spines.values():
            spine.set_linewidth(0.6)
        axes.tick_params(which="major", labelsize=sheet.small_pt, width=0.6, length=2.5, pad=2)
    else:
        axes.tick_params(labelsize=sheet.small_pt)
        axes.title.set_fontsize(sheet.title_pt)


def legend(
    figure: Figure, left_in: float, top_in: float, entries: Sequence[Artist], size: float, **style: object
) -> None:
    """Draw a legend in one line whose upper left corner is at a place in inches from the lower left one."""
    figure.legend(
        handles=list(entries),
        loc="upper left",
        bbox_to_anchor=(left_in / figure.get_figwidth(), top_in / figure.get_figheight()),
        ncols=max(len(entries), 1),
        frameon=False,
        fontsize=size,
        **style,
    )


def entry(colour: str, label: str, **style: object) -> Line2D:
    """Return a line, or with ``marker`` and no ``linestyle`` a mark, for a legend."""
    line = {"linestyle": "" if "marker" in style else "-", "color": colour, "label": label, **style}
    return Line2D([], [], **line)  # type: ignore[arg-type]


def text(
    figure: Figure, left_in: float, bottom_in: float, words: str, *, size: float, **style: object
) -> None:
    """Write words at a place in inches from the lower left corner."""
    place = (left_in / figure.get_figwidth(), bottom_in / figure.get_figheight())
    figure.text(*place, words, fontsize=size, **style)  # type: ignore[arg-type]


def note_lines(notes: Sequence[str]) -> list[str]:
    """Return notes as lines that fit across a printed page; every note begins a line."""
    return [line for note in notes for line in textwrap.wrap(note, _NOTE_LETTERS)]


def notes_height(lines: Sequence[str]) -> float:
    """Return the height in inches of these lines below a page."""
    return _EDGE_IN + _NOTE_IN * len(lines)


def heading(figure: Figure, top_in: float, words: str) -> None:
    """Write words at the left edge of a figure for the screen, the top of them at a height in inches."""
    text(figure, 0.25, top_in, words, size=SCREEN.title_pt, va="top")


def write_around(figure: Figure, title: str, lines: Sequence[str]) -> None:
    """Write a title into the upper left corner of a printed page, and lines of notes at its lower edge."""
    text(figure, _EDGE_IN, figure.get_figheight() - _EDGE_IN, title, size=PRINT.title_pt, va="top")
    for k, line in enumerate(reversed(lines)):
        at = _EDGE_IN + k * _NOTE_IN
        text(figure, _EDGE_IN, at, line, size=PRINT.small_pt, va="bottom", color="0.25")


def save_png(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write ``figure`` as a PNG, whole or not at all; `DatasetError` if the folder cannot be written."""
    _show_names_as_they_are(figure)
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=figure.dpi, metadata={"Software": "skelsplat"})
    return Path(path)


def _show_names_as_they_are(figure: Figure) -> None:
    """Take nothing between dollar signs for mathematics."""
    for words in figure.findobj(Text):
        words.set_parse_math(False)


def write_pages(pages: Sequence[Figure], stem: Path, formats: Sequence[str]) -> list[Path]:
    """Write pages as ``stem.png``, ``stem_2.png`` … and as one ``stem.pdf``; each file whole or not at all.

    Pages of an earlier, longer series of PNG files are removed.
    """
    written = []
    for kind in formats:
        if kind == "pdf":
            written.append(stem.with_name(f"{stem.name}.pdf"))
            _write_pdf(written[-1], pages)
            continue
        written += [save_png(page, _numbered(stem, number)) for number, page in enumerate(pages, 1)]
        number = len(pages) + 1
        while _numbered(stem, number).is_file():
            _numbered(stem, number).unlink()
            number += 1
    return written


def _numbered(stem: Path, number: int) -> Path:
    return stem.with_name(f"{stem.name}.png" if number == 1 else f"{stem.name}_{number}.png")


def _write_pdf(path: Path, pages: Sequence[Figure]) -> None:
    # Type 42 fonts: text can be selected and edited, and publishers take it. No date: same data, same file.
    fonts = rc_context({"pdf.fonttype": 42})
    with atomic_write(path) as stream, fonts, PdfPages(stream, metadata=_ABOUT) as document:
        for page in pages:
            _show_names_as_they_are(page)
            document.savefig(page, dpi=page.dpi)
