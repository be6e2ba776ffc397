"""What runs find in videos and files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skelsplat.findings import Finding

_MOST_NAMES = 6  # that a sentence lists


def _layout_of_file(finding: Finding) -> str:
    """Return what the skeleton of a file has, and which pairs its names state."""
    pairs, (file,) = finding.numbers["pairs"], finding.subject.files
    count = f"{len(pairs)} left–right pair{'' if len(pairs) == 1 else 's'} by name"
    limbs = f"{finding.numbers['limbs']} limbs" if finding.numbers["limbs"] else "no limbs"
    shown = f" ({', '.join(pairs[:_MOST_NAMES])}{', …' if len(pairs) > _MOST_NAMES else ''})" if pairs else ""
    return f"The layout is that of {file}: {finding.numbers['joints']} joints, {limbs}, {count}{shown}."


SENTENCES: Mapping[str, str | Callable[[Finding], str]] = {
    "layout_of_file": _layout_of_file,
}
