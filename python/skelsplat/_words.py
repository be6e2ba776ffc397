"""Words and numbers as sentences and tables show them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells as texts; the first of a row names it.

    Columns are (head, what its numbers are in words); ``total`` is a last row for all. ``marks`` are, of each
    row, the class of its name in the page's style and the address that it links to, or ``""``.
    """

    title: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[str]]
    total: Sequence[str] = ()
    marks: Sequence[tuple[str, str]] = ()
    hint: str = ""


def listed(words: Sequence[str], last: str = "and") -> str:
    """Return "a, b and c"."""
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def number(value: float, digits: int = 1) -> str:
    """Return a number as text, a dash if it is not finite."""
    return f"{value:,.{digits}f}" if math.isfinite(value) else "–"


def decimals(mm: float, least: int = 1, below: float = 1.0) -> int:
    """Return how many decimals a length in mm has: `least`; below `below` two significant digits or more."""
    short = 0 < abs(mm) < below  # not if it is NaN
    return max(least, 1 - math.floor(math.log10(abs(mm)))) if short else least


def length(mm: float, least: int = 1, below: float = 1.0) -> str:
    """Return a length in mm as text: "14.2", "0.0046"."""
    return number(mm, decimals(mm, least, below))


def metric(mm: float) -> str:
    """Return a length in the unit in which it is a small number: "1.3 m", "22 cm"."""
    if mm >= 1000.0:
        return f"{mm / 1000.0:.3g} m" if mm < 1e6 else f"{mm / 1000.0:,.0f} m"
    return f"{mm / 10.0:.3g} cm" if mm >= 10.0 else f"{mm:.3g} mm"


def px(error: float | None, digits: int = 1) -> str:
    """Return an error in pixels as text."""
    return f"{error:.{digits}f} px" if error is not None and error < math.inf else "too large to measure"


def size_text(size: Sequence[int]) -> str:
    """Return the width and height of an image as options take them: "1920x1080"."""
    return "x".join(map(str, size))


def capitalised(text: str) -> str:
    """Return a sentence of a clause."""
    return text[0].upper() + text[1:]


def with_bar(value: float, sigma: float | None, sign: str = "", most: int = 4) -> str:
    """Return a number with its error bar, to one or two of its digits: "143 ± 36"; without one, "143"."""
    if sigma is None or not math.isfinite(sigma):
        return f"{value:{sign},.1f}"
    digits = min(most, max(0, -math.floor(math.log10(sigma / 3)))) if sigma > 0 else 1
    shown = 0.0 if abs(value) < 0.5 * 10**-digits else value  # no −0
    return f"{shown:{sign},.{digits}f} ± {sigma:,.{digits}f}"


def ordinal(number: int) -> str:
    """Return "1st", "2nd", "11th"."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0, "th")
    return f"{number:,}{ending}"


def percent(share: float) -> str:
    """Return a share of 0 to 1 as a percentage without decimals."""
    return f"{100 * share:.0f}%"
