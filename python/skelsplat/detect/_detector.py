"""What a detector is to `skelsplat.detect.detect`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Protocol

from skelsplat._arrays import Array
from skelsplat.io.video import Image

# an image (H, W, 3), blue first, to the people in it (P, N, 3): x and y in pixels, confidence
Find = Callable[[Image], Array]


class Detector(Protocol):
    """Finds people in the images of one camera."""

    @property
    def layout(self) -> str:
        """Name of the built-in layout of its N joints."""
        ...

    @property
    def settings(self) -> Mapping[str, str]:
        """Everything that its detections depend on; detections of different settings are never mixed."""
        ...

    @property
    def follows(self) -> bool:
        """Whether an image's detections depend on the images before it.

        If so, a camera that was interrupted is detected again from its first frame.
        """
        ...

    def open(self) -> AbstractContextManager[Find]:
        """Begin a camera: give a function from an image (H, W, 3), blue first, to its people (P, N, 3).

        A person's N joints are x and y in pixels and a confidence in [0, 1], 0 for one that was not detected.
        """
        ...
