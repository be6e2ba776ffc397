"""One camera's video with what the run knows of that camera."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io.video import FrameSource, Image, Size, find_videos, open_source
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.overlay.place import Place, fit_size
from skelsplat.run.overlay.scene import Scene, follow
from skelsplat.viz import Skeleton
from skelsplat.viz.overlay import Shown, draw_label, draw_overlay

Span = tuple[int, int]

# More no encoder takes, and a frame would fill the memory.
_MOST_PX = 16_384


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


@dataclass(frozen=True)
class View:
    """A camera that is ready to be drawn.

    Parameters
    ----------
    scene, skeleton, shown
        What is drawn.
    index, name
        Which camera of the rig it is.
    source, offset
        Its frames, and what is to be added to their numbers to get the run's.
    place, corners
        Where the drawing goes; the upper left corner (T, 2) of the cut-out in each frame of the run.
    labelled
        With the camera's name and the frame's number.
    """

    scene: Scene
    skeleton: Skeleton
    shown: Shown
    index: int
    name: str
    source: FrameSource
    offset: int
    place: Place
    corners: npt.NDArray[np.int64]
    labelled: bool

    def frames(self, span: Span) -> Iterator[tuple[int, Image]]:
        """Yield (number, drawn image) of the frames in ``span`` that the source has, in the run's numbers."""
        first, last = span
        for number, image in self.source.frames(first - self.offset, last - self.offset):
            yield number + self.offset, self._drawn(number + self.offset, image)

    def expected(self, span: Span) -> int:
        """Return how many frames of ``span`` the source has if its header is right."""
        first, last = self.source.first + self.offset, self.source.last + self.offset
        return max(0, min(last, span[1]) - max(first, span[0]) + 1)

    def label(self, number: int) -> str:
        """Return what is written on the frame ``number``."""
        return f"{self.name}   frame {number}"

    def _drawn(self, number: int, image: Image) -> Image:
        numbers = self.scene.run.poses.frames
        left, top = self.corners[min(int(np.searchsorted(numbers, number)), len(numbers) - 1)].tolist()
        canvas = self.place.cut(image, (left, top))
        frame = self.scene.frame(self.index, number)
        if frame is not None:
            draw_overlay(canvas, frame.moved(*self.place.transform((left, top))), self.skeleton, self.shown)
        if self.labelled:
            draw_label(canvas, self.label(number) + ("" if frame is not None else "   not in the run"))
        return canvas


def open_views(job: OverlayJob, scene: Scene, span: Span) -> list[View]:
    """Open every camera's video and see that it fits, before any is drawn.

    Raises
    ------
    DatasetError
        If a video is missing, unreadable, of another size than its camera, or has no frame of the run.
    InvalidInputError
        If there is no camera of a name, the order does not fit, there are images whose numbers `first_frame`
        would change, or the output would be too large.
    """
    rig = scene.run.rig
    paths = find_videos(job.videos, list(rig.names), chosen=job.cameras, order=job.order)
    if job.first_frame is not None and any(path.is_dir() for path in paths.values()):
        expected = "expected videos, got images, whose numbers are those in the names of the files"
        raise InvalidInputError(f"first_frame: {expected}")
    return [
        _open(job, scene, rig.names.index(name), open_source(path, job.first_frame or 0), span)
        for name, path in paths.items()
    ]


def with_zoom(view: View, zoom: float) -> View:
    """Return the same view, drawn ``zoom`` times as large as its cut-out."""
    return replace(view, place=replace(view.place, zoom=zoom))


def _open(job: OverlayJob, scene: Scene, index: int, source: FrameSource, span: Span) -> View:
    run = scene.run
    name, camera = run.rig.names[index], run.rig[index]
    fit = fit_size(source.path, name, source.size, camera.size)
    size: Size = source.size
    corners = np.zeros((len(run.poses.frames), 2), dtype=np.int64)
    if job.crop:
        size, corners = follow((scene.outline(index) + 0.5) * fit - 0.5, source.size)
    layout = run.layout
    view = View(
        scene=scene,
        skeleton=Skeleton(limbs=tuple(layout.limbs), left_right=tuple(layout.left_right)),
        shown=job.shown,
        index=index,
        name=name,
        source=source,
        offset=run.offsets.get(name, 0),
        place=Place(fit, size, job.scale or 1.0),
        corners=corners,
        labelled=job.legend,
    )
    if max(view.place.output) > _MOST_PX:
        width, height = view.place.output
        expected = f"an output of at most {_MOST_PX} px in width and height"
        raise InvalidInputError(f"scale: expected {expected}, got {width}×{height}")
    if not view.expected(span):
        raise _no_frame(view, span)
    if job.first_frame is None and _counted_from_one(view):
        text = (
            f"{source.path}: frames 0 to {source.last}, and the run has 1 to {source.last + 1} of {name}: if "
            "its detector counts from 1, all is drawn one frame late; --first-frame 1 corrects that"
        )
        warnings.warn(text, UserWarning, stacklevel=2)
    return view


def _counted_from_one(view: View) -> bool:
    """Say whether the run's frames are as many as those of a video that begins at 0, but begin at 1."""
    frames = view.scene.run.poses.frames - view.offset
    is_video = not view.source.path.is_dir()
    return is_video and (frames[0], frames[-1]) == (view.source.first + 1, view.source.last + 1)


def _no_frame(view: View, span: Span) -> DatasetError:
    first, last = span[0] - view.offset, span[1] - view.offset
    expected = f"frames from {first} to {last}, which the run has of {view.name}"
    advice = "" if view.source.path.is_dir() else "; --first-frame gives the number of the first one"
    actual = f"{view.source.first} to {view.source.last}{advice}"
    return DatasetError(view.source.path, "frames", expected, actual)
