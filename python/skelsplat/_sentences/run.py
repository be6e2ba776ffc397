"""What runs find: cameras, joints and people to look at, and frames that stand out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skelsplat.findings import Finding

SENTENCES: Mapping[str, str | Callable[[Finding], str]] = {}
