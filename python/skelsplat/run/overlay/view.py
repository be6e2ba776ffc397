"""One camera's video with what the run knows of that camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._opencv import opencv
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Remedy, Subject, warn
from skelsplat.io.detections import cameras_called
from skelsplat.io.video import FrameSource, Image, PlainFrames, Size, find_videos, open_source
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.image_sizes import resizing
from skelsplat.run.overlay.scene import Scene, follow
from skelsplat.viz.overlay import Shown, draw_label, draw_name, draw_overlay

Span = tuple[int, int]

# More no encoder takes, and a frame would fill the memory.
_MOST_PX = 16_384


@dataclass(frozen=True)
class OverlayJob:
    """One overlay."""

    # the folder of the run, the videos or images (None: plain frames), the folder for the results
    run: Path
    videos: Path | None
    out: Path
    shown: Shown  # which layers are drawn
    cameras: tuple[str, ...] = ()  # the cameras to draw; empty for all
    # the video of each camera, or ``"sorted"``; None to match by name
    order: str | tuple[str, ...] | None = None
    first_frame: int | None = None  # the camera's own number of a video's first frame; None for 0
    frames: FrameRange = field(default_factory=FrameRange)  # the frames to draw
    fps: float | None = None  # frames per second of the output; None for those of the video
    scale: float | None = None  # of the output; None for 1, or with ``grid`` for what fits a screen
    legend: bool = True  # with the legend below the image, and camera and frame in its corner
    crop: bool = False  # cut out the person
    # PNG files instead of videos; all cameras in one image
    png: bool = False
    grid: bool = False


@dataclass(frozen=True)
class Place:
    """From a video's frame to what is drawn on."""

    fit: Array  # (2,) scale from the calibrated image to the frame
    size: Size  # (width, height) of what is cut out of the frame
    zoom: float = 1.0  # scale from that to the output

    @property
    def output(self) -> Size:
        """Width and height of the output."""
        return max(1, round(self.size[0] * self.zoom)), max(1, round(self.size[1] * self.zoom))

    def cut(self, image: Image, corner: tuple[int, int]) -> Image:
        """Return the part of ``image`` with this upper left corner (x, y) in the size of the output."""
        (left, top), (width, height) = corner, self.size
        part = image[top : top + height, left : left + width]
        if self.output == self.size:
            return part.copy()
        method = opencv().INTER_AREA if self.zoom < 1 else opencv().INTER_LINEAR
        resized: Image = opencv().resize(part, self.output, interpolation=method)
        return resized

    def transform(self, corner: tuple[int, int]) -> tuple[Array, Array]:
        """Return scale and shift, (2,) each, from the calibrated image's pixels to those of the output.

        A resize by s maps u to (u + ½)·s − ½ (docs/conventions.md).
        """
        zoom = np.array(self.output) / np.array(self.size)
        scale: Array = self.fit * zoom
        return scale, scale / 2 - 0.5 - np.array(corner) * zoom


@dataclass(frozen=True)
class View:
    """A camera that is ready to be drawn."""

    # what is drawn
    job: OverlayJob
    scene: Scene
    index: int  # which camera of the rig it is
    source: FrameSource  # its frames
    # where the drawing goes; the upper left corner (T, 2) of the cut-out in each frame of the run
    place: Place
    corners: Index

    @property
    def name(self) -> str:
        """Name of the camera."""
        return self.scene.rig.names[self.index]

    @property
    def offset(self) -> int:
        """What is to be added to the source's frame numbers to get the run's."""
        return self.scene.offsets.get(self.name, 0)

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
        numbers = self.scene.frames
        left, top = self.corners[min(int(np.searchsorted(numbers, number)), len(numbers) - 1)].tolist()
        canvas = self.place.cut(image, (left, top))
        people = self.scene.frame(self.index, number)
        moved = [one.frame.moved(*self.place.transform((left, top))) for one in people or ()]
        for one, frame in zip(people or (), moved, strict=True):
            draw_overlay(canvas, frame, one.skeleton, self.job.shown)
        for one, frame in zip(people or (), moved, strict=True):
            if one.skeleton.own is not None and self.job.legend:
                draw_name(canvas, frame.pose, one.name.removeprefix("person "), one.skeleton.own)
        if self.job.legend:
            draw_label(canvas, self.label(number) + ("" if people is not None else "   not in the run"))
        return canvas


def open_views(job: OverlayJob, scene: Scene, span: Span) -> list[View]:
    """Open every camera's video and see that it fits, before any is drawn."""
    rig = scene.rig
    if job.videos is None:
        return _plain_views(job, scene, span)
    paths = find_videos(job.videos, list(rig.names), chosen=job.cameras, order=job.order)
    if job.first_frame is not None and any(path.is_dir() for path in paths.values()):
        expected = "expected videos, got images, whose numbers are those in the names of the files"
        raise InvalidInputError(f"first_frame: {expected}")
    return [
        _open(job, scene, rig.names.index(name), open_source(path, job.first_frame or 0), span)
        for name, path in paths.items()
    ]


def _plain_views(job: OverlayJob, scene: Scene, span: Span) -> list[View]:
    """Return views on plain frames of the cameras' sizes, one for each frame of the run."""
    for name, given in (("order", job.order), ("first_frame", job.first_frame)):
        if given is not None:
            raise InvalidInputError(f"{name}: expected videos or images with it, got none")
    chosen = cameras_called(job.cameras, list(scene.rig.names), "cameras") or scene.rig.names
    views = []
    for index, name in enumerate(scene.rig.names):
        if name in chosen:
            size = scene.rig[index].size
            source = PlainFrames.of(job.run, size, scene.frames - scene.offsets.get(name, 0))
            views.append(_open(job, scene, index, source, span))
    return views


def _open(job: OverlayJob, scene: Scene, index: int, source: FrameSource, span: Span) -> View:
    name, camera = scene.rig.names[index], scene.rig[index]
    fit = _fit_size(source.path, name, source.size, camera.size)
    size: Size = source.size
    corners = np.zeros((len(scene.frames), 2), dtype=np.int64)
    if job.crop:
        size, corners = follow((scene.outline(index) + 0.5) * fit - 0.5, source.size)
    scale = job.scale or 1.0
    width, height = size[0] * scale, size[1] * scale
    if max(width, height) > _MOST_PX:
        expected = f"an output of at most {_MOST_PX} px in width and height"
        raise InvalidInputError(f"scale: expected {expected}, got {width:.6g}×{height:.6g}")
    view = View(job, scene, index, source, Place(fit, size, scale), corners)
    if not view.expected(span):
        raise _no_frame(view, span)
    if job.first_frame is None and _counted_from_one(view):
        subject = Subject(cameras=(name,), files=(str(source.path),))
        numbers = {"last": source.last, "last_of_run": source.last + 1}
        warn(
            Finding(
                "video_one_frame_late",
                "warning",
                subject,
                numbers,
                (Remedy("first_frame", 1),),
                sentence=f"{source.path}: frames 0 to {source.last}, and the run has 1 to {source.last + 1} "
                f"of {name}: if its detector counts from 1, all is drawn one frame late.",
            )
        )
    return view


def _fit_size(path: Path, name: str, size: Size, expected: Size) -> Array:
    """Return the scale (2,) from the camera's image to a video's frames; warn if that is doubtful."""
    fit, (width, height), (wide, high) = resizing(expected, size), size, expected
    if fit is None and size == (high, wide):
        wanted = f"{wide}×{high} like the camera {name}"
        advice = "is the video turned (a phone's metadata), or the calibration that of turned images?"
        raise DatasetError(path, "size", wanted, f"{width}×{height}, width and height exchanged; {advice}")
    if fit is None:
        wanted = f"{wide}×{high} like the camera {name}, or a copy of it in another size"
        raise DatasetError(path, "size", wanted, f"{width}×{height}")
    if size != expected and (fit == 1.0).all():
        numbers = {"size": [width, height], "size_of_camera": [wide, high]}
        sentence = f"{path}: {width}×{height}, but the camera {name} has {wide}×{high}: drawn without "
        sentence += "scaling."
        subject = Subject(cameras=(name,), files=(str(path),))
        warn(Finding("video_padded", "note", subject, numbers, sentence=sentence))
    return fit


def _counted_from_one(view: View) -> bool:
    """Say whether the run's frames are as many as those of a video that begins at 0, but begin at 1."""
    first, last = (end - view.offset for end in view.scene.ends)
    is_video = not view.source.path.is_dir()
    return is_video and (first, last) == (view.source.first + 1, view.source.last + 1)


def _no_frame(view: View, span: Span) -> DatasetError:
    first, last = span[0] - view.offset, span[1] - view.offset
    expected = f"frames from {first} to {last}, which the run has of {view.name}"
    advice = "" if view.source.path.is_dir() else "; --first-frame gives the number of the first one"
    actual = f"{view.source.first} to {view.source.last}{advice}"
    return DatasetError(view.source.path, "frames", expected, actual)
