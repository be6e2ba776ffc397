"""A run drawn on the videos that it came from."""

from __future__ import annotations

import heapq
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, median
from skelsplat._clocks import Clock
from skelsplat._optional import opencv
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Remedy, Subject, warn
from skelsplat.io._run_files import REPORT, check_people, folders_of_run, mark, run_in
from skelsplat.io.detections import cameras_called
from skelsplat.io.run_folder import RunFolder, read_run
from skelsplat.io.video import FrameSource, Image, PlainFrames, Size, find_videos, open_sink, open_source
from skelsplat.run.folder import output_folder
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.image_sizes import resizing
from skelsplat.run.solve import rig_as_used
from skelsplat.viz import Skeleton, person_colour
from skelsplat.viz import overlay as viz

Progress = Callable[[str, int, int], None]

_STEP = 1e-4  # of the central differences, in parts of the distance to the camera: about a tenth of a pixel
_RELIABLE = "ok"
_MOST_PX = 16_384  # more no encoder takes
_ASSUMED_FPS = 30.0
_SCREEN: Size = (1920, 1080)
_GRID = "grid"


@dataclass(frozen=True)
class OverlayJob:
    """One overlay."""

    run: Path  # the folder of the run
    videos: Path | None  # or images; None for plain frames
    out: Path  # the folder for the results
    shown: viz.Shown  # which layers are drawn
    cameras: tuple[str, ...] = ()  # the cameras to draw; empty for all
    order: str | tuple[str, ...] | None = None  # the video of each camera, or "sorted"; None: by name
    first_frame: int | None = None  # the camera's own number of a video's first frame; None for 0
    frames: FrameRange = field(default_factory=FrameRange)  # the frames to draw
    fps: float | None = None  # frames per second of the output; None for those of the video
    scale: float | None = None  # of the output; None for 1, or with ``grid`` for what fits a screen
    legend: bool = True  # with the legend below the image, and camera and frame in its corner
    png: bool = False  # PNG files instead of videos
    grid: bool = False  # all cameras in one image


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
        width, height = self.size
        return {**asdict(self), "path": str(self.path), "width": width, "height": height}


@dataclass(frozen=True)
class Drawn:
    """A person in one image."""

    name: str  # ``""`` for the only one
    frame: viz.OverlayFrame
    skeleton: Skeleton
    distance: float  # from the camera, in the unit of the run; 0 if unknown


class Scene:
    """A run, or the runs of several people, frame by frame and camera by camera, with the lens of the run."""

    def __init__(self, people: Mapping[str, RunFolder]) -> None:
        """Show people, by the names that are drawn; one with the name ``""`` in the colours of the sides."""
        self.people, run = people, next(iter(people.values()))
        self.rig, self.clocks, self.frame_rate = run.rig, run.clocks, run.poses.frame_rate
        self.frames: Index = np.unique(np.concatenate([one.poses.frames for one in people.values()]))
        self.ends = run.ends if len(people) == 1 else (int(self.frames[0]), int(self.frames[-1]))
        self.cameras = list(rig_as_used(self.rig, undistort=run.undistorted))
        self.colours = {name: person_colour(k) for k, name in enumerate(people) if name}

    @classmethod
    def read(cls, folder: Path, chosen: FrameRange) -> Scene:
        """Read the folder of a run, or that of several people; of a long run the range alone."""
        names = folders_of_run(folder)
        if not names:
            return cls({"": read_run(folder, within=chosen.to_read)})
        check_people(folder / REPORT)
        return cls({name.replace("_", " "): read_run(folder / name) for name in names})

    def frame(self, view: int, number: int) -> list[Drawn] | None:
        """Return who is in the frame `number` of a camera, the farthest first; None if it is in no run."""
        if number not in self.frames:
            return None
        found = []
        for name, run in self.people.items():
            there = np.flatnonzero(run.poses.frames == number)
            if there.size:
                found.append(self._drawn(name, run, view, int(there[0])))
        return sorted(found, key=lambda drawn: -drawn.distance)

    def _drawn(self, name: str, run: RunFolder, view: int, t: int) -> Drawn:
        """Return what a camera sees of a person in a frame of their run."""
        poses, camera, shape = run.poses, self.cameras[view], run.detections.shape[:3]
        joints = shape[2:]
        covariance = _known(poses.error_bar, (shape[0], *joints, 3, 3))[t]
        status = poses.joint_status[t] if len(poses.joint_status) else np.full(joints, _RELIABLE)
        filled = (status == "filled")[:, None, None]  # a place between others has no error bar
        pose, covariances = project_covariances(poses.pose[t], np.where(filled, np.nan, covariance), camera)
        frame = viz.OverlayFrame(
            pose=pose,
            covariances=covariances,
            reliable=status == _RELIABLE,
            detections=run.detections[t, view, :, :2],
            weights=_known(poses.view_weights, shape)[t, view],
            swapped=poses.swapped[t, view] if len(poses.swapped) else np.zeros(joints, dtype=bool),
            before=sk.project(_known(poses.init_pose, (shape[0], *joints, 3))[t], [camera])[0],
        )
        skeleton = Skeleton(tuple(run.layout.limbs), tuple(run.layout.left_right), self.colours.get(name))
        away = np.linalg.norm(poses.pose[t] - camera.centre, axis=1)
        return Drawn(name, frame, skeleton, float(np.nan_to_num(median(away))))


def _known(values: Array, shape: tuple[int, ...]) -> Array:
    """Return an array of `PoseData`, NaN throughout if it was left out."""
    return values if len(values) else np.full(shape, np.nan)


def project_covariances(points: Array, covariances: Array, camera: sk.Camera) -> tuple[Array, Array]:
    """Project points (N, 3) and their covariances (N, 3, 3) through the lens: (N, 2) and J Σ Jᵀ (N, 2, 2).

    J is the derivative of `skelsplat.project` at the point, by central differences.
    """
    step = _STEP * np.linalg.norm(points - camera.centre, axis=1)  # (N,)
    shifts = np.concatenate([np.eye(3), -np.eye(3)])[:, None] * step[:, None]  # (6, N, 3)
    seen = sk.project(np.concatenate([points[None], points + shifts]), [camera])[0]
    jacobian = (seen[1:4] - seen[4:]) / (2 * step[:, None])  # (3, N, 2)
    return seen[0], np.einsum("anu,nab,bnv->nuv", jacobian, covariances, jacobian)


@dataclass(frozen=True)
class View:
    """A camera that is ready to be drawn."""

    job: OverlayJob
    scene: Scene
    index: int  # which camera of the rig it is
    source: FrameSource  # its frames
    span: tuple[int, int]  # the first and the last frame to draw
    fit: Array  # (2,) scale from the calibrated image to the source's frame
    zoom: float = 1.0  # scale from that to the output

    @property
    def name(self) -> str:
        """Name of the camera."""
        return self.scene.rig.names[self.index]

    @property
    def clock(self) -> Clock:
        """How the source's frames are counted."""
        return self.scene.clocks[self.name]

    def own(self, *numbers: int) -> tuple[int, ...]:
        """Return the source's frames that are nearest to frames of the run."""
        return tuple(self.clock.places(np.array(numbers, dtype=np.int64))[0].tolist())

    @property
    def size(self) -> Size:
        """Width and height of the output."""
        width, height = self.source.size
        return max(1, round(width * self.zoom)), max(1, round(height * self.zoom))

    @property
    def expected(self) -> int:
        """How many frames of the span the source has if its header is right."""
        first, last = self.own(*self.span)
        frames = min(last, self.source.last) - max(first, self.source.first)
        return max(0, math.floor(frames / self.clock.pace) + 1)

    def frames(self) -> Iterator[tuple[int, Image]]:
        """Yield (number, drawn image) of the frames that the source has, in the run's numbers."""
        for own, image in self.source.frames(*self.own(*self.span)):
            for number in self.clock.numbers(np.array([own])).tolist():
                yield number, self._drawn(number, image)

    def label(self, image: Image, number: int, missing: str = "") -> None:
        """Write camera and frame into the corner of an image, and what is missing."""
        viz.draw_label(image, f"{self.name}   frame {number}" + (f"   {missing}" if missing else ""))

    def blank(self, number: int) -> Image:
        """Return what is shown where there is no image."""
        tile = viz.blank_tile(self.size)
        self.label(tile, number, "no image")
        return tile

    def _drawn(self, number: int, image: Image) -> Image:
        if self.size == self.source.size:
            canvas = image.copy()
        else:
            method = opencv().INTER_AREA if self.zoom < 1 else opencv().INTER_LINEAR
            canvas = opencv().resize(image, self.size, interpolation=method)
        # a resize by s maps u to (u + ½)·s − ½ (docs/conventions.md)
        scale = self.fit * (np.array(self.size) / np.array(self.source.size))
        people = self.scene.frame(self.index, number)
        moved = [(one, one.frame.moved(scale, scale / 2 - 0.5)) for one in people or ()]
        for one, frame in moved:
            viz.draw_overlay(canvas, frame, one.skeleton, self.job.shown)
        for one, frame in moved:
            if one.skeleton.own is not None and self.job.legend:
                viz.draw_name(canvas, frame.pose, one.name.removeprefix("person "), one.skeleton.own)
        if self.job.legend:
            self.label(canvas, number, "not in the run" if people is None else "")
        return canvas


def open_views(job: OverlayJob, scene: Scene) -> list[View]:
    """Open every camera's video and see that it fits, before any is drawn."""
    names, span = scene.rig.names, job.frames.within(scene.frames)
    if job.videos is None:
        for name, given in (("order", job.order), ("first_frame", job.first_frame)):
            if given is not None:
                raise InvalidInputError(f"{name}: expected videos or images with it, got none")
        chosen = cameras_called(job.cameras, list(names), "cameras") or names
        sources: dict[str, FrameSource] = {
            name: PlainFrames.of(job.run, camera.size, scene.clocks[name].places(scene.frames)[0])
            for name, camera in zip(names, scene.rig, strict=True)
            if name in chosen
        }
    else:
        paths = find_videos(job.videos, list(names), cameras=job.cameras, order=job.order)
        if job.first_frame is not None and any(path.is_dir() for path in paths.values()):
            expected = "expected videos, got images, whose numbers are those in the names of the files"
            raise InvalidInputError(f"first_frame: {expected}")
        sources = {name: open_source(path, job.first_frame or 0) for name, path in paths.items()}
    views = []
    for name, source in sources.items():
        view = View(job, scene, names.index(name), source, span, np.ones(2), job.scale or 1.0)
        views.append(replace(view, fit=_checked(view)))
    return views


def _checked(view: View) -> Array:
    """Return the scale (2,) from a camera's image to a video's frames; warn of what is doubtful."""
    path, name, source, span = view.source.path, view.name, view.source, view.span
    (width, height), (wide, high) = size, whole = source.size, view.scene.rig[view.index].size
    fit = resizing(whole, size)
    if fit is None:
        got = f"{width}×{height}"
        if size == whole[::-1]:
            got += ", width and height exchanged: is the video turned (a phone's metadata)?"
        wanted = f"{wide}×{high} like the camera {name}, or a copy of it in another size"
        raise DatasetError(path, "size", wanted, got)
    subject = Subject(cameras=(name,), files=(str(path),))
    if size != whole and (fit == 1.0).all():
        sizes = {"size": [width, height], "size_of_camera": [wide, high]}
        sentence = f"{path}: {width}×{height}, but camera {name} has {wide}×{high}: drawn without scaling."
        warn(Finding("image_sizes_differ", "note", subject, sizes, sentence=sentence))
    if max(view.size) > _MOST_PX:
        expected = f"an output of at most {_MOST_PX} px in width and height"
        raise InvalidInputError(f"scale: expected {expected}, got {view.size[0]}×{view.size[1]}")
    if not view.expected:
        first, last = view.own(*span)
        advice = "" if path.is_dir() else "; --first-frame gives the number of the first one"
        expected = f"frames from {first} to {last}, which the run has of {name}"
        raise DatasetError(path, "frames", expected, f"{source.first} to {source.last}{advice}")
    own = view.own(*view.scene.ends)
    if view.job.first_frame is None and not path.is_dir() and own == (source.first + 1, source.last + 1):
        numbers = {"last": source.last, "last_of_run": source.last + 1}
        sentence = f"{path}: frames 0 to {source.last}, and the run has 1 to {source.last + 1} of {name}: if "
        sentence += "its detector counts from 1, all is drawn one frame late."
        remedy = (Remedy("first_frame", 1),)
        warn(Finding("video_one_frame_late", "warning", subject, numbers, remedy, sentence=sentence))
    return fit


def write_overlay(job: OverlayJob, progress: Progress | None = None) -> list[Written]:
    """Draw a run on its videos; ``progress`` gets a result's name, frames done, and all frames."""
    views = open_views(job, Scene.read(job.run, job.frames))
    if job.grid:
        groups = {_GRID: views if job.scale else _fitted(views)}
    else:
        groups = {re.sub(r'^\.+|[/\\:*?"<>|\x00-\x1f]', "_", view.name): [view] for view in views}
    targets = {job.out / (name if job.png else f"{name}.mp4"): group for name, group in groups.items()}
    read = {view.source.path.resolve() for view in views} if job.videos is not None else set()
    if any(target.resolve() in read for target in targets):
        expected = "a folder in which no result replaces a video that is read"
        raise DatasetError(job.out, "--output", expected, "that of the videos")
    with output_folder(job.out):
        tell = progress or (lambda *_: None)
        for target, group in targets.items():  # all before the first, so that what is left to do is known
            tell(target.stem, 0, max(view.expected for view in group))
        written = [_write(job, group, target, progress) for target, group in targets.items()]
    for view in views:
        _warn_of_missing(view, sum(one.cameras.get(view.name, 0) for one in written))
    return written


def _fitted(views: list[View]) -> list[View]:
    """Return the views in the size in which all of them fit a screen; never enlarged."""
    width, height = viz.tiling([view.size for view in views]).size
    zoom = min(1.0, _SCREEN[0] / width, _SCREEN[1] / height)
    return [replace(view, zoom=zoom) for view in views]


def _write(job: OverlayJob, views: list[View], target: Path, progress: Progress | None) -> Written:
    """Draw the cameras of one result and write it."""
    tiles = viz.tiling([view.size for view in views])
    counts = dict.fromkeys((view.name for view in views), 0)
    people = list(views[0].scene.colours.items())
    legend = viz.legend_strip(tiles.size[0], tiles.cell, job.shown, people) if job.legend else None
    rate, total = None if job.png else _rate(job, views), max(view.expected for view in views)
    with open_sink(target, rate, mark(run_in(job.run))) as sink:
        for number, images in _together(views):
            each = [images[k] if k in images else view.blank(number) for k, view in enumerate(views)]
            whole = tiles.join(each)
            sink.write(number, whole if legend is None else np.concatenate([whole, legend]))
            for k in images:
                counts[views[k].name] += 1
            if progress is not None:
                progress(target.stem, sink.count, total)
    if not sink.count:
        raise DatasetError(views[0].source.path, "frames", "one of the run that can be decoded", "none")
    return Written(target, sink.size, sink.count, rate, counts)


def _together(views: Sequence[View]) -> Iterator[tuple[int, dict[int, Image]]]:
    """Yield (number, images by the place of their view) of every frame that a view has."""

    def stream(k: int) -> Iterator[tuple[int, int, Image]]:
        return ((number, k, image) for number, image in views[k].frames())

    whole = heapq.merge(*map(stream, range(len(views))), key=itemgetter(0))
    for number, together in groupby(whole, key=itemgetter(0)):
        yield number, {k: image for _, k, image in together}


def _rate(job: OverlayJob, views: Sequence[View]) -> float:
    """Return the frame rate asked for, that of the video, of the run, or an assumed one with a warning."""
    every = (view.source.rate for view in views if view.clock.pace == 1.0)  # of others, not all are drawn
    known = [job.fps, *every, views[0].scene.frame_rate]
    found = next((rate for rate in known if rate is not None), None)
    if found is not None:
        return found
    sentence = f"Neither the images nor the run state the frame rate: assuming {_ASSUMED_FPS:g} frames per "
    sentence += "second."
    remedy, numbers = (Remedy("fps", None),), {"fps": _ASSUMED_FPS}
    warn(Finding("times_assumed", "note", numbers=numbers, remedy=remedy, sentence=sentence))
    return _ASSUMED_FPS


def _warn_of_missing(view: View, count: int) -> None:
    first, last = view.span
    missing = last - first + 1 - count
    if missing > 0:
        subject = Subject(cameras=(view.name,), files=(str(view.source.path),))
        numbers = {"first": first, "last": last, "missing": missing, "drawn": count}
        sentence = f"{view.source.path}: {missing} of the frames {first} to {last} of the run cannot be read "
        sentence += f"or are not in it; {count} were drawn."
        warn(Finding("video_frames_missing", "warning", subject, numbers, sentence=sentence))
