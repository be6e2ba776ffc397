"""From the videos of all cameras to folders of OpenPose files, which can be interrupted and gone on with."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write, opening
from skelsplat.detect._detector import Detector
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import FRAME_LIMIT, listed
from skelsplat.io.detections._record import (
    Record,
    Video,
    camera_folder,
    read_record,
    record_path,
    write_record,
)
from skelsplat.io.video import FrameSource, open_source, videos_of

Progress = Callable[[str, int, int], None]
_DIGITS = 12
_SHOWN = 4
_DECIMALS = 4


@dataclass(frozen=True)
class Detected:
    """What was written for one camera.

    Attributes
    ----------
    camera : str
        Its name: that of the video's file.
    video, folder : Path
    size : tuple of int
        Width and height of the frames, upright.
    rotation : int
        Degrees by which the frames are turned to be upright, as the video's metadata say.
    frame_rate : float or None
        What the video states.
    frames, new : int
        Frames in the folder within the range that was asked for, and how many of them this call has detected.
    empty : int
        How many of the new ones are without a person.
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

    The files are ``CAMERA_json/CAMERA_000000000000.json``, one per frame, each whole or not there. Frames
    that are there are not detected again, so a call that was interrupted is repeated to continue. A detector
    that follows people starts an unfinished camera again, so that the result is the same as without the
    interruption. ``detect.json`` next to the folders states detector, layout and frame rates, for
    `skelsplat.io.read_detections`.

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

    Returns
    -------
    list of Detected
        One per camera.

    Raises
    ------
    InvalidInputError
        If `output` holds detections of another detector, of other videos, or of another program.
    DatasetError
        If a video is missing or cannot be read.
    MissingPackageError
        If the detector's package is not installed.
    """
    sources = {camera: open_source(path) for camera, path in videos_of(videos).items()}
    folder = Path(output)
    span = (0 if first is None else first, FRAME_LIMIT if last is None else last)
    cameras = [_Camera(camera, source, folder, span) for camera, source in sources.items()]
    for one in cameras:
        one.check()
    book = _Book.opened(folder, detector, sources, overwrite=overwrite)
    written = [_camera(one, detector, book, progress or _silent) for one in cameras]
    _compare(written)
    return written


def _silent(_camera: str, _done: int, _total: int) -> None:
    pass


@dataclass
class _Book:
    """The record of the folder, kept on disk."""

    folder: Path
    record: Record

    @classmethod
    def opened(
        cls, folder: Path, detector: Detector, sources: Mapping[str, FrameSource], *, overwrite: bool
    ) -> _Book:
        """Return the record of a folder into which this may be written, with all cameras in it."""
        joints = tuple(sk.layouts.get(detector.layout).joints)
        wanted = Record(dict(detector.settings), detector.layout, joints)
        before = read_record(folder) if folder.is_dir() else None
        known = {} if before is None else before.videos
        kept = {camera: one for camera, one in known.items() if not (overwrite and camera in sources)}
        if before is not None and kept:
            _check_same(folder, before, wanted)
        for camera, source in sources.items():
            video = Video(source.path.name, source.size, source.rate)
            _check_foreign(camera_folder(folder, camera), camera if camera in known else None)
            _check_video(camera, kept.get(camera, video), video)
            kept.setdefault(camera, video)
        if overwrite:
            _clear(folder, sources)
        with opening(folder, "a folder that can be written", "output"):
            folder.mkdir(parents=True, exist_ok=True)
        book = cls(folder, replace(wanted, videos=kept))
        write_record(folder, book.record)
        return book

    def finished(self, camera: str, count: int) -> None:
        """Note how many frames a video has."""
        video = replace(self.record.videos[camera], count=count)
        self.record = replace(self.record, videos={**self.record.videos, camera: video})
        write_record(self.folder, self.record)


def _check_same(folder: Path, there: Record, wanted: Record) -> None:
    """Raise unless detections of both may lie in one folder."""
    if (dict(there.detector), there.layout) != (dict(wanted.detector), wanted.layout):
        before, now = (", ".join(one.detector.values()) for one in (there, wanted))
        expected = f"a folder of the same detector, or --overwrite for all cameras of {record_path(folder)}"
        raise InvalidInputError(f"output: expected {expected} ({before}), got {now}")


def _check_video(camera: str, there: Video, video: Video) -> None:
    """Raise unless a camera's detections were made from this video."""
    if (there.name, there.size) != (video.name, video.size):
        before, now = (f"{one.name} of {one.size[0]}×{one.size[1]}" for one in (there, video))
        raise InvalidInputError(f"output: expected {before} for {camera} again, or --overwrite, got {now}")


def _check_foreign(folder: Path, camera: str | None) -> None:
    """Raise if there are JSON files in a camera's folder that are not `detect`'s; without a camera, any."""
    ours = () if camera is None else _numbered(folder, camera).values()
    foreign = sorted(path.name for path in {*folder.glob("*.json")} - {*ours}) if folder.is_dir() else []
    if foreign:
        expected = "a folder without JSON files of another program; choose another one"
        raise InvalidInputError(f"output: expected {expected}, got {folder} with {listed(foreign, _SHOWN)}")


def _clear(folder: Path, cameras: Collection[str]) -> None:
    """Remove the files that `detect` has written for these cameras."""
    for camera in cameras:
        for path in _numbered(camera_folder(folder, camera), camera).values():
            path.unlink()


def _numbered(folder: Path, camera: str) -> dict[int, Path]:
    """Return the files of a camera by frame."""
    files = {}
    for path in folder.glob(f"*_{'[0-9]' * _DIGITS}.json") if folder.is_dir() else ():
        name, _, number = path.stem.rpartition("_")
        if name == camera:
            files[int(number)] = path
    return files


@dataclass(frozen=True)
class _Camera:
    """One camera and the frames that are wanted of it."""

    name: str
    source: FrameSource
    output: Path
    span: tuple[int, int]

    @property
    def folder(self) -> Path:
        return camera_folder(self.output, self.name)

    def check(self) -> None:
        """Raise if none of its frames is wanted."""
        if not self.total():
            first, last = self.span
            expected = f"some of the frames {self.source.first} to {self.source.last} of {self.source.path}"
            raise InvalidInputError(f"range: expected {expected}, got {first}-{last}")

    def done(self) -> set[int]:
        """Return the wanted frames that are there."""
        first, last = self.span
        files = _numbered(self.folder, self.name)
        # a power failure can leave an empty file
        return {n for n, path in files.items() if first <= n <= last and path.stat().st_size}

    def missing(self, done: Collection[int], count: int | None) -> bool:
        """Say whether a wanted frame is not there, or may not be."""
        first, last = self.span
        if self.source.images:
            return any(first <= number <= last and number not in done for number in self.source.images)
        end = last if count is None else min(last, count - 1)
        return len(done) < end - first + 1

    def total(self) -> int:
        """Return how many frames are wanted, as far as the video's header knows."""
        first, last = self.span
        if self.source.images:
            return sum(first <= number <= last for number in self.source.images)
        return max(0, min(last, self.source.last) - first + 1)


def _camera(camera: _Camera, detector: Detector, book: _Book, progress: Progress) -> Detected:
    """Detect what is missing of a camera."""
    done, total = camera.done(), camera.total()
    before = len(done)
    progress(camera.name, before, max(total, before))
    new = empty = 0
    if camera.missing(done, book.record.videos[camera.name].count):
        again = detector.follows  # from its first frame, as without the interruption
        with opening(camera.folder, "a folder that can be written", "output"):
            camera.folder.mkdir(exist_ok=True)
        number = -1
        with detector.open() as find:
            for number, image in camera.source.frames(*camera.span):
                if number in done and not again:
                    continue
                people = find(image)
                _write(camera.folder / f"{camera.name}_{number:0{_DIGITS}d}.json", people)
                done.add(number)
                new, empty = new + 1, empty + (len(people) == 0)
                progress(camera.name, new if again else len(done), max(total, len(done)))
        if number >= 0 and not camera.source.images and number < camera.span[1]:
            book.finished(camera.name, number + 1)
    source = camera.source
    of_video = (source.path, camera.folder, source.size, source.rotation, source.rate)
    return Detected(camera.name, *of_video, len(done), new, empty)


def _write(path: Path, people: Array) -> None:
    """Write the people of a frame (P, N, 3) as OpenPose does."""
    found = [
        {
            "person_id": [-1],
            "pose_keypoints_2d": [round(value, _DECIMALS) for value in person.ravel().tolist()],
        }
        for person in np.where(np.isfinite(people).all(axis=-1, keepdims=True), people, 0.0)
    ]
    with atomic_write(path, durable=False) as stream:
        stream.write(json.dumps({"version": 1.3, "people": found}, separators=(",", ":")).encode())


def _compare(written: Sequence[Detected]) -> None:
    """Warn of cameras without anybody, and of videos that differ in length or rate."""
    for one in written:
        if one.rotation:
            warn(Finding("video_turned", "note", Subject(files=(str(one.video),)), {"degrees": one.rotation}))
        if one.new and one.empty == one.new:
            warn(Finding("nobody_detected", "warning", Subject(cameras=(one.camera,)), {"frames": one.new}))
    for kind, values in (
        ("videos_differ_in_length", [one.frames for one in written]),
        ("videos_differ_in_rate", [round(one.frame_rate or 0.0, 2) for one in written]),
    ):
        if len(set(values)) > 1:
            each = ", ".join(f"{one.camera} {value:g}" for one, value in zip(written, values, strict=True))
            warn(Finding(kind, "warning", numbers={"each": each}))
