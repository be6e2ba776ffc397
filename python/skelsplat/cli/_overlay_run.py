"""The order of an overlay: open everything, draw frame by frame, write, say what was left out."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.cli._overlay_scene import Scene
from skelsplat.cli._overlay_view import View, open_views, with_zoom
from skelsplat.cli._progress import bar_of
from skelsplat.exceptions import DatasetError
from skelsplat.io import read_run
from skelsplat.io.video import Image, Mp4Sink, PngSink, Size
from skelsplat.run.folder import output_folder
from skelsplat.viz.overlay import Tiling, blank_tile, draw_label, legend_strip, tiling

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from skelsplat.cli._overlay_job import OverlayJob
    from skelsplat.cli._overlay_view import Span

_ASSUMED_FPS = 30.0
_SCREEN: Size = (1920, 1080)
GRID = "grid"


@dataclass
class Written:
    """A result.

    Parameters
    ----------
    path
        A video or a folder of PNG files.
    size : (width, height)
    frames
        Number of frames written.
    fps
        Frames per second; None for PNG files.
    cameras
        By camera, the number of frames that its video had.
    """

    path: Path
    size: Size
    frames: int
    fps: float | None
    cameras: dict[str, int]


def draw(job: OverlayJob, *, shown: bool) -> list[Written]:
    """Do one overlay, under a progress bar if ``shown``; what is left out is a warning.

    Raises
    ------
    SkelSplatError
        If an input is missing, malformed or does not fit, or a result cannot be written.
    """
    scene = Scene(read_run(job.run))
    span = job.frames.within(scene.run.poses.frames)
    views = open_views(job, scene, span)
    groups = [views] if job.grid else [[view] for view in views]
    names = [GRID] if job.grid else _file_names([view.name for view in views])
    targets = [job.out / (name if job.png else f"{name}.mp4") for name in names]
    for target in targets:
        _check_apart(target, views)
    written = []
    with output_folder(job.out), bar_of("frames", shown=shown) as bar:
        for group, target in zip(groups, targets, strict=True):
            task = bar.add_task(target.stem, total=max(view.expected(span) for view in group))
            written.append(_write(job, group, span, target, partial(bar.advance, task)))
    for view in views:
        count = sum(one.cameras.get(view.name, 0) for one in written)
        _warn_of_missing(view, span, count)
    return written


def _file_names(cameras: Sequence[str]) -> list[str]:
    """Return the cameras' names without what a file's name must not hold; those then alike get a number."""
    names = [re.sub(r'^\.+|[/\\:*?"<>|\x00-\x1f]', "_", camera) for camera in cameras]
    folded = [name.casefold() for name in names]  # some file systems do not tell a from A
    return [f"{name}_{k}" if folded.count(folded[k]) > 1 else name for k, name in enumerate(names)]


def _check_apart(target: Path, views: Sequence[View]) -> None:
    for view in views:
        if target.resolve() == view.source.path.resolve():
            expected = "a folder in which no result replaces a video that is read"
            raise DatasetError(target, "--output", expected, "one of the videos")


def _write(
    job: OverlayJob, views: list[View], span: Span, target: Path, advance: Callable[[], None]
) -> Written:
    """Draw the cameras of one result and write it."""
    if job.grid and job.scale is None:
        views = _fitted(views)
    tiles = tiling([view.place.output for view in views])
    counts = dict.fromkeys((view.name for view in views), 0)
    legend = legend_strip(tiles.size[0], tiles.cell, job.shown) if job.legend else None
    rate = _rate(job, views)
    with PngSink(target) if job.png else Mp4Sink(target, rate) as sink:
        for number, images in _together(views, span):
            whole = _joined(views, tiles, images, number)
            whole = whole if legend is None else np.concatenate([whole, legend])
            sink.write(number, whole)
            for view, image in zip(views, images, strict=True):
                counts[view.name] += image is not None
            advance()
    if not sink.count:
        raise DatasetError(views[0].source.path, "frames", "one of the run that can be decoded", "none")
    return Written(target, sink.size, sink.count, None if job.png else rate, counts)


def _fitted(views: list[View]) -> list[View]:
    """Return the views in the size in which all of them fit a screen; never enlarged."""
    width, height = tiling([view.place.output for view in views]).size
    zoom = min(1.0, _SCREEN[0] / width, _SCREEN[1] / height)
    return [with_zoom(view, zoom) for view in views]


def _together(views: Sequence[View], span: Span) -> Iterator[tuple[int, list[Image | None]]]:
    """Yield (number, one image or None per view), for every frame of ``span`` that a view has."""
    streams = [view.frames(span) for view in views]
    heads = [next(stream, None) for stream in streams]
    while numbers := [head[0] for head in heads if head is not None]:
        number = min(numbers)
        here = [head is not None and head[0] == number for head in heads]
        yield number, [head[1] if now and head else None for head, now in zip(heads, here, strict=True)]
        heads = [
            next(stream, None) if now else head
            for stream, head, now in zip(streams, heads, here, strict=True)
        ]


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
    known = [job.fps, *(view.source.rate for view in views), views[0].scene.run.poses.frame_rate]
    found = next((rate for rate in known if rate is not None), None)
    if found is None and not job.png:
        text = f"--fps: not given, and neither images nor run say it; {_ASSUMED_FPS:g} per second assumed"
        warnings.warn(text, UserWarning, stacklevel=2)
    return _ASSUMED_FPS if found is None else found


def _warn_of_missing(view: View, span: Span, count: int) -> None:
    asked = span[1] - span[0] + 1
    if count < asked:
        text = (
            f"{view.source.path}: {asked - count} of the frames {span[0]} to {span[1]} of the run cannot be "
            f"read or are not in it; {count} were drawn"
        )
        warnings.warn(text, UserWarning, stacklevel=2)


def summary(job: OverlayJob, written: Sequence[Written], remarks: Sequence[str]) -> dict[str, Any]:
    """Return what was done as JSON values."""
    return {
        "run": str(job.run),
        "videos": str(job.videos),
        "files": [
            {
                "path": str(one.path),
                "width": one.size[0],
                "height": one.size[1],
                "frames": one.frames,
                "fps": one.fps,
                "cameras": one.cameras,
            }
            for one in written
        ],
        "warnings": list(remarks),
    }
