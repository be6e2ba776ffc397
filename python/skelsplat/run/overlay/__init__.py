"""A run drawn on the videos that it came from.

>>> from skelsplat.run.overlay import OverlayJob, write_overlay
>>> from skelsplat.viz.overlay import Shown
>>> write_overlay(OverlayJob("out", "videos", "out/overlay", Shown(rejected_below=0.25)))  # doctest: +SKIP
"""

from skelsplat.run.overlay.view import OverlayJob
from skelsplat.run.overlay.write import Written, write_overlay

__all__ = ["OverlayJob", "Written", "write_overlay"]
