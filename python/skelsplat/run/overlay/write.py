"""The order of an overlay: open everything, draw frame by frame, write, say what was left out."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Remedy, Subject, warn
from skelsplat.io.video import Image, Size, open_sink
from skelsplat.run.folder import output_folder
from skelsplat.run.overlay.scene import Scene
from skelsplat.run.overlay.view import OverlayJob, Span, View, open_views
from skelsplat.viz.overlay import Tiling, blank_tile, draw_label, legend_strip, tiling

_ASSUMED_FPS = 30.0
_SCREEN: Size = (1920, 1080)
_GRID = "grid"


@dataclass(frozen=True)
class Written:
    """A result."""

    path: Path  # a video or a folder of PNG files
    size: Size  # (width, height)
    frames: int  # number of frames written
    fps: float | None  # frames per second; None for PNG files
    cameras: dict[str, int]  # by camera, the number of frames that its video had

    def to_dict(self) -> dict[str, Any]:
        """Return it as values of JSON."""
        return {
            "path": str(self.path),
            "width": self.size[0],
            "height": self.size[1],
            "frames": self.frames,
            "fps": self.fps,
            "cameras": self.cameras,
        }


def write_overlay(job: OverlayJob, progress: Callable[[str, int, int], None] | None = None) -> list[Written]:
    """Draw a run on its videos and write the results; what is left out is a warning.

    Parameters
    ----------
    job : OverlayJob
    progress : callable, optional
        Called with a result's name, the number of its frames that are done, and of all its frames.

    Raises
    ------
    SkelSplatError
        If an input is missing, malformed or does not fit, or a result cannot be written.
    """
    scene = Scene.read(job.run, job.frames)
    span = job.frames.within(scene.frames)
    views = open_views(job, scene, span)
    groups = [views] if job.grid else [[view] for view in views]
    names = [_GRID] if job.grid else _file_names([view.name for view in views])
    targets = [job.out / (name if job.png else f"{name}.mp4") for name in names]
    read = {view.source.path.resolve() for view in views} if job.videos is not None else set()
    for target in targets:
        if target.resolve() in read:
            expected = "a folder in which no result replaces a video that is read"
            raise DatasetError(target, "--output", expected, "one of the videos")
    written = []
    with output_folder(job.out):
        for group, target in zip(groups, targets, strict=True):
            written.append(_write(job, group, span, target, progress))
    for view in views:
        count = sum(one.cameras.get(view.name, 0) for one in written)
        _warn_of_missing(view, span, count)
    return written


def _file_names(cameras: Sequence[str]) -> list[str]:
    """Return the cameras' names without what a file's name must not hold; those then alike get a number."""
    names = [re.sub(r'^\.+|[/\\:*?"<>|\x00-\x1f]', "_", camera) for camera in cameras]
    folded = [name.casefold() for name in names]  # some file systems do not tell a from A
    return [f"{name}_{k}" if folded.count(folded[k]) > 1 else name for k, name in enumerate(names)]


def _write(
    job: OverlayJob,
    views: list[View],
    span: Span,
    target: Path,
    progress: Callable[[str, int, int], None] | None,
) -> Written:
    """Draw the cameras of one result and write it."""
    if job.grid and job.scale is None:
        views = _fitted(views)
    tiles = tiling([view.place.output for view in views])
    counts = dict.fromkeys((view.name for view in views), 0)
    people = list(views[0].scene.colours.items())
    legend = legend_strip(tiles.size[0], tiles.cell, job.shown, people) if job.legend else None
    rate, total = _rate(job, views), max(view.expected(span) for view in views)
    with open_sink(target, None if job.png else rate) as sink:
        for number, images in _together(views, span):
            whole = _joined(views, tiles, images, number)
            whole = whole if legend is None else np.concatenate([whole, legend])
            sink.write(number, whole)
            for view, image in zip(views, images, strict=True):
                counts[view.name] += image is not None
            if progress is not None:
                progress(target.stem, sink.count, total)
    if not sink.count:
        raise DatasetError(views[0].source.path, "frames", "one of the run that can be decoded", "none")
    return Written(target, sink.size, sink.count, None if job.png else rate, counts)


def _fitted(views: list[View]) -> list[View]:
    """Return the views in the size in which all of them fit a screen; never enlarged."""
    width, height = tiling([view.place.output for view in views]).size
    zoom = min(1.0, _SCREEN[0] / width, _SCREEN[1] / height)
    return [replace(view, place=replace(view.place, zoom=zoom)) for view in views]


def _together(views: Sequence[View], span: Span) -> Iterator[tuple[int, list[Image | None]]]:
    """Yield (number, one image or None per view), for every frame of ``span`` that a view has."""
    streams = [view.frames(span) for view in views]
    heads = [next(stream, None) for stream in streams]
    while numbers := [head[0] for head in heads if head is not None]:
        number = min(numbers)
        here = [head is not None and head[0] == number for head in heads]
        yield number, [head[1] if now and head else None for head, now in zip(heads, here, strict=True)]
        ready = zip(streams, heads, here, strict=True)
        heads = [next(stream, None) if now else head for stream, head, now in ready]


def _joined(views: Sequence[View], tiles: Tiling, images: Sequence[Image | None], number: int) -> Image:
    if len(images) == 1 and images[0] is not None:
        return images[0]
    return tiles.join(
        [
            _no_image(view, number) if image is None else image
            for view, image in zip(views, images, strict=True)
        ]
    )


def _no_image(view: View, number: int) -> Image:
    tile = blank_tile(view.place.output)
    draw_label(tile, f"{view.label(number)}   no image")
    return tile


def _rate(job: OverlayJob, views: Sequence[View]) -> float:
    """Return the frame rate asked for, that of the video, of the run, or an assumed one with a warning."""
    known = [job.fps, *(view.source.rate for view in views), views[0].scene.frame_rate]
    found = next((rate for rate in known if rate is not None), None)
    if found is None and not job.png:
        sentence = "Neither the images nor the run state the frame rate: assuming "
        sentence += f"{_ASSUMED_FPS:g} frames per second."
        remedy, numbers = (Remedy("fps", None),), {"fps": _ASSUMED_FPS}
        warn(Finding("times_assumed", "note", numbers=numbers, remedy=remedy, sentence=sentence))
    return _ASSUMED_FPS if found is None else found


def _warn_of_missing(view: View, span: Span, count: int) -> None:
    asked = span[1] - span[0] + 1
    if count < asked:
        subject = Subject(cameras=(view.name,), files=(str(view.source.path),))
        numbers = {"first": span[0], "last": span[1], "missing": asked - count, "drawn": count}
        sentence = f"{view.source.path}: {asked - count} of the frames {span[0]} to {span[1]} of the run "
        sentence += f"cannot be read or are not in it; {count} were drawn."
        warn(Finding("video_frames_missing", "warning", subject, numbers, sentence=sentence))
