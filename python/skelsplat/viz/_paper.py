"""Pages at the size in which they are printed: figures for a paper, as PNG and PDF."""

from __future__ import annotations

import io
import textwrap
from typing import TYPE_CHECKING

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from skelsplat.viz import _style

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

FORMATS = ("png", "pdf")
WIDTH_IN = 7.1  # 180 mm, two columns of a journal
HEIGHT_IN = 9.4  # what a page of A4 or letter leaves beside a caption
DPI = 300
TITLE_PT, LABEL_PT, SMALL_PT = 9.0, 8.0, 7.0

_NOTE_LETTERS = 138  # of SMALL_PT across a page
_NOTE_IN = 0.135  # height of a line of SMALL_PT
_EDGE_IN = 0.08


def new_page(height_in: float) -> Figure:
    """Return an empty figure of the width of a page, on an Agg canvas."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def tidy(axes: Axes) -> None:
    """Take the box off an axes and set lines and texts to the sizes of print."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for spine in axes.spines.values():
        spine.set_linewidth(0.6)
    axes.tick_params(which="major", labelsize=SMALL_PT, width=0.6, length=2.5, pad=2)
    axes.xaxis.label.set_fontsize(LABEL_PT)
    axes.yaxis.label.set_fontsize(LABEL_PT)


def heading(figure: Figure, title: str) -> None:
    """Write a title into the upper left corner of a page."""
    text(figure, _EDGE_IN, figure.get_figheight() - _EDGE_IN, title, size=TITLE_PT, va="top")


def text(
    figure: Figure, left_in: float, bottom_in: float, words: str, *, size: float = SMALL_PT, **style: object
) -> None:
    """Write words at a place in inches from the lower left corner."""
    place = (left_in / figure.get_figwidth(), bottom_in / figure.get_figheight())
    figure.text(*place, words, fontsize=size, **style)  # type: ignore[arg-type]


def note_lines(notes: Sequence[str]) -> list[str]:
    """Return notes as lines that fit across a page; every note begins a line."""
    return [line for note in notes for line in textwrap.wrap(note, _NOTE_LETTERS)]


def notes_height(lines: Sequence[str]) -> float:
    """Return the height in inches of what `draw_notes` draws."""
    return _EDGE_IN + _NOTE_IN * len(lines)


def draw_notes(figure: Figure, lines: Sequence[str]) -> None:
    """Write lines at the lower edge of a page."""
    for k, line in enumerate(reversed(lines)):
        text(figure, _EDGE_IN, _EDGE_IN + k * _NOTE_IN, line, va="bottom", color="0.25")


def legend(figure: Figure, top_in: float, entries: Sequence[Artist]) -> None:
    """Draw a legend in one line whose upper edge is ``top_in`` above the lower edge of the page."""
    place = (_EDGE_IN / figure.get_figwidth(), top_in / figure.get_figheight())
    figure.legend(
        handles=list(entries),
        loc="upper left",
        bbox_to_anchor=place,
        ncols=max(len(entries), 1),
        frameon=False,
        fontsize=SMALL_PT,
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.5,
        handletextpad=0.5,
        columnspacing=1.3,
    )


def write_pages(pages: Sequence[Figure], stem: Path, formats: Sequence[str]) -> list[Path]:
    """Write pages as ``stem.png``, ``stem_2.png`` … and as one ``stem.pdf``; each file whole or not at all.

    Pages of an earlier, longer series of PNG files are removed.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    written = []
    for kind in formats:
        if kind == "pdf":
            written.append(_style.write_whole(stem.with_name(f"{stem.name}.pdf"), _pdf(pages)))
            continue
        for number, page in enumerate(pages, 1):
            written.append(_style.write_whole(_numbered(stem, number), _png(page)))
        number = len(pages) + 1
        while _numbered(stem, number).is_file():
            _numbered(stem, number).unlink()
            number += 1
    return written


def _numbered(stem: Path, number: int) -> Path:
    return stem.with_name(f"{stem.name}.png" if number == 1 else f"{stem.name}_{number}.png")


def _png(page: Figure) -> bytes:
    buffer = io.BytesIO()
    page.savefig(buffer, format="png", dpi=DPI, metadata={"Software": "skelsplat"})
    return buffer.getvalue()


def _pdf(pages: Sequence[Figure]) -> bytes:
    buffer = io.BytesIO()
    # Type 42 fonts: text can be selected and edited, and publishers take it. No date: same data, same file.
    with rc_context({"pdf.fonttype": 42}), PdfPages(buffer, metadata=_ABOUT) as document:
        for page in pages:
            document.savefig(page, dpi=DPI)
    return buffer.getvalue()


_ABOUT: dict[str, str | None] = {"Creator": "skelsplat", "CreationDate": None}
