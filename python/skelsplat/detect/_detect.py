"""From the videos of all cameras to folders of OpenPose files, which can be interrupted and gone on with."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write, opening
from skelsplat._fields import FRAME_LIMIT
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import listed
from skelsplat.io.detections._record import Record, Video, camera_folder, read_record, write_record
from skelsplat.io.video import FrameSource, Image, open_source, videos_of

Progress = Callable[[str, int, int], None]
Span = tuple[int, int]
_DIGITS, _DECIMALS = 12, 4  # of a frame's number and of a pixel
_SHOWN = 4  # names in a message
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
        """Whether detections depend on earlier images; an interrupted camera is then detected anew."""
        ...

    def open(self) -> AbstractContextManager[Find]:
        """Begin a camera; a confidence in [0, 1] is 0 for a joint that was not detected."""
        ...


@dataclass(frozen=True)
class Detected:
    """What was written for one camera.

    ``camera`` is the name of the video's file, ``size`` the width and height of its frames, turned upright by
    ``rotation`` degrees. Of the ``frames`` in the folder within the range that was asked for, this call has
    detected ``new``, ``empty`` of which are without a person.
    """

    camera: str
    video: Path
    folder: Path
    size: tuple[int, int]
    rotation: int
    frame_rate: float | None
    frames: int
    new: int
    empty: int

    def to_dict(self) -> dict[str, Any]:
        """Return it as values of JSON."""
        paths = {"video": str(self.video), "folder": str(self.folder)}
        return {**vars(self), **paths, "size": list(self.size)}


def detect(
    videos: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    detector: Detector,
    *,
    first: int | None = None,
    last: int | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> list[Detected]:
    """Detect people in the videos of all cameras and write OpenPose JSON.

    The files are ``CAMERA_json/CAMERA_000000000000.json``, one per frame. Frames that are there are not
    detected again, so a call that was interrupted is repeated to continue. ``detect.json`` beside the folders
    states detector, layout and frame rates, for `skelsplat.io.read_detections`.

    Parameters
    ----------
    videos : path or sequence of paths
        A folder with one video, or one folder of images, per camera; or these themselves. The name of a file
        or folder is that of its camera.
    output : path
        Folder for the results; made if missing.
    detector : Detector
        Such as `MediaPipe()` or `RTMLib()`.
    first, last : int, optional
        Frames to detect, both included; a video's count from 0.
    overwrite : bool
        Replace what `detect` has written there before, whatever the detector was.
    progress : callable, optional
        Called with camera, frames done and frames in all.

    Raises
    ------
    InvalidInputError
        If `output` holds detections of another detector, of other videos, or of another program.
    DatasetError, MissingPackageError
        If a video cannot be read, or the detector's package is not installed.
    """
    # first: the extra of a missing detector has all that is needed
    record = Record(dict(detector.settings), detector.layout, tuple(sk.layouts.get(detector.layout).joints))
    sources = {camera: open_source(path) for camera, path in videos_of(videos).items()}
    span = (0 if first is None else first, FRAME_LIMIT if last is None else last)
    for source in sources.values():
        if not _wanted(source, span):
            expected = f"some of the frames {source.first} to {source.last} of {source.path}"
            got = f"{span[0]}-{'' if last is None else last}"
            raise InvalidInputError(f"range: expected {expected}, got {got}")
    results = _Results.opened(Path(output), record, sources, overwrite=overwrite)
    tell = {camera: functools.partial(progress or (lambda *_: None), camera) for camera in sources}
    for camera, source in sources.items():  # all before the first, so that what is left to do is known
        done, wanted = len(results.done(camera, span)), _wanted(source, span)
        tell[camera](done, max(wanted, done))
    written = [
        _camera(camera, source, span, detector, results, tell[camera]) for camera, source in sources.items()
    ]
    _compare(written)
    return written


def _wanted(source: FrameSource, span: Span) -> int:
    """Return how many frames of a span there are, as far as a video's header knows."""
    first, last = span
    if source.images:
        return sum(first <= number <= last for number in source.images)
    return max(0, min(last, source.last) - first + 1)


def _camera(
    camera: str,
    source: FrameSource,
    span: Span,
    detector: Detector,
    results: _Results,
    tell: Callable[[int, int], None],
) -> Detected:
    """Detect what is missing of a camera."""
    done, wanted = results.done(camera, span), _wanted(source, span)
    total = max(wanted, len(done))
    new = empty = 0
    if not results.complete(camera, span, len(done), len(source.images) and wanted):
        again = detector.follows  # from its first frame, as without the interruption
        number = span[1]
        with detector.open() as find:
            for number, image in source.frames(*span):
                if number in done and not again:
                    continue
                people = find(image)
                results.write(camera, number, people)
                done.add(number)
                new, empty = new + 1, empty + (len(people) == 0)
                tell(new if again else len(done), max(total, len(done)))
        if number < span[1]:
            results.finished(camera, number + 1)
    of_video = (source.path, camera_folder(results.folder, camera), source.size, source.rotation, source.rate)
    return Detected(camera, *of_video, len(done), new, empty)


def _compare(written: Sequence[Detected]) -> None:
    """Warn of cameras without anybody, and of videos that differ in length or rate."""
    for one in written:
        if one.rotation:
            sentence = f"{one.video}: frames are turned by {one.rotation}° as the video's metadata say; the "
            sentence += "calibration must be of frames turned in the same way."
            about = Subject(files=(str(one.video),))
            warn(Finding("video_turned", "note", about, {"degrees": one.rotation}, sentence=sentence))
        if one.new and one.empty == one.new:
            sentence = f"{one.camera}: no person detected in any frame ({one.new} in all)."
            about = Subject(cameras=(one.camera,))
            warn(Finding("no_detections", "warning", about, {"frames": one.new}, sentence=sentence))
    if each := _different(written, [one.frames for one in written]):
        sentence = f"The videos have different numbers of frames ({each}): if they begin at the same "
        sentence += "instant, refine only the frames that all of them have."
        warn(Finding("videos_differ_in_length", numbers={"each": each}, sentence=sentence))
    if each := _different(written, [round(one.frame_rate or 0.0, 2) for one in written]):
        sentence = f"The videos have different frame rates ({each}): refine goes by the slowest."
        warn(Finding("frame_rates_differ", "note", numbers={"each": each}, sentence=sentence))


def _different(written: Sequence[Detected], values: Sequence[float]) -> str:
    """Return every camera's value if they differ, else nothing."""
    if len(set(values)) < 2:
        return ""
    return ", ".join(f"{one.camera} {value:g}" for one, value in zip(written, values, strict=True))


@dataclass
class _Results:
    """A folder that one detector writes into, and the record there."""

    folder: Path
    record: Record

    @classmethod
    def opened(
        cls, folder: Path, wanted: Record, sources: Mapping[str, FrameSource], *, overwrite: bool
    ) -> _Results:
        """Open a folder for a detector and these cameras, or raise if something in it would be mixed or lost.

        With `overwrite`, what `detect` has written for them is removed.
        """
        before = read_record(folder) if folder.is_dir() else None
        known = before.videos if before is not None else {}
        ours = {camera: _files(folder, camera) if camera in known else {} for camera in {*known, *sources}}
        gone = sources if overwrite else {}
        kept = {camera: video for camera, video in known.items() if ours[camera] and camera not in gone}
        if (
            before is not None
            and kept
            and (before.detector, before.layout) != (wanted.detector, wanted.layout)
        ):
            there, now = (", ".join(one.detector.values()) for one in (before, wanted))
            raise _refused(f"a folder of {there} again ({folder}), or overwrite for all its cameras", now)
        for camera, source in sources.items():
            own = camera_folder(folder, camera)
            foreign = sorted(path.name for path in {*own.glob("*.json")} - {*ours[camera].values()})
            if foreign:
                raise _refused(f"no files of another program in {own}", listed(foreign, _SHOWN))
            length = None if source.images else source.path.stat().st_size
            video = Video(source.path.name, source.size, source.rate, length)
            there, now = (
                f"{one.name}, {one.size[0]}×{one.size[1]}, {one.length} bytes"
                for one in (kept.setdefault(camera, video), video)
            )
            if there != now:
                raise _refused(f"{there} for {camera} again, or overwrite", now)
        for path in (path for camera in gone for path in ours[camera].values()):
            path.unlink()
        for place in (folder, *(camera_folder(folder, camera) for camera in sources)):
            with opening(place, "a folder that can be written", "output"):
                place.mkdir(parents=True, exist_ok=True)
        results = cls(folder, replace(wanted, videos=kept))
        write_record(folder, results.record)
        return results

    def done(self, camera: str, span: Span) -> set[int]:
        """Return the frames from `span` that are there; an empty file, left by a power failure, is not."""
        files = _files(self.folder, camera).items()
        return {number for number, path in files if span[0] <= number <= span[1] and path.stat().st_size}

    def complete(self, camera: str, span: Span, done: int, images: int) -> bool:
        """Say whether `done` frames are all of the span; of `images` images, if there are any."""
        count = self.record.videos[camera].count
        last = span[1] if count is None else min(span[1], count - 1)
        return done >= (images or last - span[0] + 1)

    def finished(self, camera: str, count: int) -> None:
        """Note how many frames a video has."""
        video = replace(self.record.videos[camera], count=count)
        self.record = replace(self.record, videos={**self.record.videos, camera: video})
        write_record(self.folder, self.record)

    def write(self, camera: str, number: int, people: Array) -> None:
        """Write the people of a frame (P, N, 3) as OpenPose does, zeros for a joint that is missing."""
        joints = np.where(np.isfinite(people).all(axis=-1, keepdims=True), people, 0.0)
        rows = [person.ravel().tolist() for person in np.round(joints, _DECIMALS)]
        found = [{"person_id": [-1], "pose_keypoints_2d": row} for row in rows]
        text = json.dumps({"version": 1.3, "people": found}, separators=(",", ":"))
        path = camera_folder(self.folder, camera) / f"{camera}_{number:0{_DIGITS}d}.json"
        with atomic_write(path, durable=False) as stream:
            stream.write(text.encode())


def _files(folder: Path, camera: str) -> dict[int, Path]:
    """Return the files of a camera that have `detect`'s names, by frame."""
    found = {}
    for path in camera_folder(folder, camera).glob(f"*_{'[0-9]' * _DIGITS}.json"):
        name, _, number = path.stem.rpartition("_")
        if name == camera:
            found[int(number)] = path
    return found


def _refused(expected: str, actual: str) -> InvalidInputError:
    return InvalidInputError(f"output: expected {expected}, got {actual}")
