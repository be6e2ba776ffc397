"""A hypothesis about one camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skelsplat.rig_check._scene import Scene

_ORDER = ("offset", "images", "resized", "turned", "moved")


@dataclass(frozen=True)
class Cause:
    """A hypothesis about one camera, and the scene in which it is set right."""

    kind: str
    view: int
    scene: Scene
    words: str = ""
    factor: float = 1.0

    @property
    def rank(self) -> int:
        """Simpler causes first."""
        return _ORDER.index(self.kind)
