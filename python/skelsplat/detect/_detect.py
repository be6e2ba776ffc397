"""From the videos of all cameras to folders of OpenPose files, which can be interrupted and gone on with."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._fields import FRAME_LIMIT
from skelsplat.detect._results import Results
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io.detections._record import Record
from skelsplat.io.video import FrameSource, Image, open_source, videos_of

Progress = Callable[[str, int, int], None]
Span = tuple[int, int]
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
        Degrees by which the frames are turned to be upright, according to the video's metadata.
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
    # first: the extra of a missing detector has all that is needed
    record = Record(dict(detector.settings), detector.layout, tuple(sk.layouts.get(detector.layout).joints))
    sources = {camera: open_source(path) for camera, path in videos_of(videos).items()}
    span = (0 if first is None else first, FRAME_LIMIT if last is None else last)
    for source in sources.values():
        if not _wanted(source, span):
            expected = f"some of the frames {source.first} to {source.last} of {source.path}"
            got = f"{span[0]}-{'' if last is None else last}"
            raise InvalidInputError(f"range: expected {expected}, got {got}")
    results = Results.opened(Path(output), record, sources, overwrite=overwrite)
    written = []
    for camera, source in sources.items():
        tell = functools.partial(progress or (lambda *_: None), camera)
        written.append(_camera(camera, source, span, detector, results, tell))
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
    results: Results,
    tell: Callable[[int, int], None],
) -> Detected:
    """Detect what is missing of a camera."""
    done, wanted = results.done(camera, span), _wanted(source, span)
    total = max(wanted, len(done))
    tell(len(done), total)
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
    of_video = (source.path, results.folder_of(camera), source.size, source.rotation, source.rate)
    return Detected(camera, *of_video, len(done), new, empty)


def _compare(written: Sequence[Detected]) -> None:
    """Warn of cameras without anybody, and of videos that differ in length or rate."""
    for one in written:
        if one.rotation:
            sentence = (
                f"{one.video}: frames are turned by {one.rotation}° as the video's metadata say; the "
                "calibration must be of frames turned in the same way."
            )
            about = Subject(files=(str(one.video),))
            warn(Finding("video_turned", "note", about, {"degrees": one.rotation}, sentence=sentence))
        if one.new and one.empty == one.new:
            sentence = f"{one.camera}: no person detected in any frame ({one.new} in all)."
            about = Subject(cameras=(one.camera,))
            warn(Finding("nobody_detected", "warning", about, {"frames": one.new}, sentence=sentence))
    if each := _different(written, [one.frames for one in written]):
        sentence = (
            f"The videos have different numbers of frames ({each}): if they begin at the same instant, "
            "refine only the frames that all of them have."
        )
        warn(Finding("videos_differ_in_length", numbers={"each": each}, sentence=sentence))
    if each := _different(written, [round(one.frame_rate or 0.0, 2) for one in written]):
        sentence = (
            f"The videos have different frame rates ({each}): frames of the same number, which are compared, "
            "are then not of the same instant."
        )
        warn(Finding("frame_rates_differ", numbers={"each": each}, sentence=sentence))


def _different(written: Sequence[Detected], values: Sequence[float]) -> str:
    """Return every camera's value if they differ, else nothing."""
    if len(set(values)) < 2:
        return ""
    return ", ".join(f"{one.camera} {value:g}" for one, value in zip(written, values, strict=True))
