"""What ``skelsplat overlay`` is asked to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skelsplat.cli._frame_range import FrameRange

if TYPE_CHECKING:
    from pathlib import Path

    from skelsplat.viz.overlay import Shown


@dataclass(frozen=True)
class OverlayJob:
    """One overlay.

    Parameters
    ----------
    run, videos, out
        The folder of the run, the videos or images, the folder for the results.
    shown
        Which layers are drawn.
    cameras
        The cameras to draw; empty for all.
    order
        The video of each camera, or ``"sorted"``; None to match by name.
    first_frame
        The camera's own number of a video's first frame; None for 0.
    frames
        The frames to draw.
    fps
        Frames per second of the output; None for those of the video.
    scale
        Of the output; None for 1, or with ``grid`` for what fits a screen.
    legend
        With the legend below the image, and camera and frame in its corner.
    crop
        Cut out the person.
    png, grid
        PNG files instead of videos; all cameras in one image.
    """

    run: Path
    videos: Path
    out: Path
    shown: Shown
    cameras: tuple[str, ...] = ()
    order: str | tuple[str, ...] | None = None
    first_frame: int | None = None
    frames: FrameRange = field(default_factory=FrameRange)
    fps: float | None = None
    scale: float | None = None
    legend: bool = True
    crop: bool = False
    png: bool = False
    grid: bool = False
