"""Phrases that several modules of sentences use."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skelsplat.findings import Remedy


def listed(words: Sequence[str], last: str = "and") -> str:
    """Return "a, b and c"."""
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def number(value: float, digits: int = 1) -> str:
    """Return a number as text, a dash if it is not finite."""
    return f"{value:,.{digits}f}" if math.isfinite(value) else "–"


def percent(share: float) -> str:
    """Return a share of 0 to 1 as a percentage without decimals."""
    return f"{100 * share:.0f}%"


def options(remedies: Iterable[Remedy]) -> str:
    """Return remedies as they are pasted into a shell."""
    return " ".join(remedy.text for remedy in remedies)
