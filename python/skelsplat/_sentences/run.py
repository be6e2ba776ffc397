"""What runs find: cameras, joints and people to look at, and frames that stand out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from skelsplat._optional import pip_line

if TYPE_CHECKING:
    from skelsplat.findings import Finding

SENTENCES: Mapping[str, str | Callable[[Finding], str]] = {
    "no_pictures": f"report.html and figures need skelsplat[viz]: {pip_line('viz')}",
}
