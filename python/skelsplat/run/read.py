"""From files to the detections of everybody: read and match."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, Mask
from skelsplat._budget import afford
from skelsplat._clocks import one_rate, rounded
from skelsplat._frozen import frozen, frozen_finding, without_frozen
from skelsplat._words import listed
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError, SkelSplatError
from skelsplat.findings import Finding, Remedy, Subject, collected_warnings, warn
from skelsplat.io import PoseData, read_npz
from skelsplat.io.calibration import find_format, read_calibration
from skelsplat.io.detections import Opened as Detections
from skelsplat.io.detections import View, camera_called, cameras_called, is_among, open_detections
from skelsplat.io.video import FrameSource, find_videos, open_source
from skelsplat.rig_check import ReadAs
from skelsplat.run.image_sizes import in_calibrated_pixels
from skelsplat.run.job import Job
from skelsplat.run.person import Crowd

# Detections of one person from which a recording is long: 29,000 frames of 17 joints in 4 views.
LONG = 2_000_000
OF_CALIBRATION = ("calibration_format", "unit", "camera_type", "subject", "size", "binning")
"""The options of a job that say how its calibration is read."""
_AT_ONCE = 450  # bytes of memory for each of them, with its share of the results, if all are there at once


@dataclass(frozen=True)
class Inputs:
    """What a run starts from."""

    rig: sk.CameraRig
    layout: sk.Layout
    detections: Array  # (T, M, N, 3) one person's detections; NaN where missing
    # (T, M) people are detected in this view and another, but none here matches: the person is missing
    unmatched: Mask
    frames: Index  # (T,) frame numbers of the files
    init_pose: Array | None = None  # (T, N, 3) the start in the rig's unit, or None for triangulation
    note: str = ""  # a sentence about the input
    source: Mapping[str, Any] = field(
        default_factory=dict
    )  # what the report says of files and how they are read
    lacking: frozenset[str] = frozenset()  # joints that the user declared missing from the files
    read_as: ReadAs = field(default_factory=ReadAs)
    sources: tuple[Path, ...] = ()  # the files or folders that hold the cameras' detections
    person: str = "consistent"  # the person to follow, as `Job.person`, or the identity followed
    crowd: Crowd | None = None  # the people that the cameras see; None if they see one
    fps: float | None = None  # frames per second; None if unknown
    fps_source: str = ""  # what states the rate, if the user did not: "files" or "videos"
    # the frames solved over time, if following people over time has done so, and the seconds that took
    solved: sk.SequenceRefinement | None = None
    solved_s: float = float("nan")
    doubts: tuple[Finding, ...] = ()  # about the person, if followed over time
    # if the cameras were adjusted: what became of each, as of `skelsplat.run.cameras.numbers_of`
    adjusted: tuple[dict[str, Any], ...] = ()
    # of a long recording of which one in so many frames is here, that number and all frame numbers
    every: int = 0
    recorded: Index | None = None

    @property
    def in_all(self) -> Index:
        """Frame numbers of the whole recording."""
        return self.frames if self.recorded is None else self.recorded

    @property
    def solved_pose(self) -> Array:
        """The pose (T, N, 3) of a person who was followed over time."""
        if self.solved is None:
            raise TypeError("a person followed over time is needed")
        return np.asarray(self.solved.pose)


@dataclass(frozen=True)
class Opened:
    """The files of a job: cameras read, detections opened."""

    every: sk.CameraRig
    rig: sk.CameraRig  # without those that are left out
    detections: Detections
    unread: tuple[str, ...] = ()  # cameras that are left out and could not be read

    @property
    def size(self) -> int:
        """Number of detections of a person."""
        return len(self.detections.frames) * len(self.rig) * self.detections.skeleton.n_joints

    @property
    def read_as(self) -> ReadAs:
        """How the detections are read, with what was added to the cameras' frame numbers."""
        return read_as(self.detections)

    def nobody(self, job: Job) -> Inputs:
        """Return the inputs of all frames with nobody detected."""
        found, layout = self.detections, self.detections.skeleton
        init, rate, stated = None, found.frame_rate, found.stated
        if job.init is not None:
            init = _read_init(Path(job.init), self.rig, len(found.frames), layout)
            if job.fps is None and stated != "files" and init.frame_rate is not None:
                rate, stated = init.frame_rate, "files"
        shape, read_as = (len(found.frames), len(self.rig)), self.read_as
        given = ("calibration", "detections", "init", "order", "mapping", "sequence", "init_sigma_mm")
        source = {
            **{name: getattr(job, name) for name in (*given, "adjust_cameras", "move")},
            **{name: str(getattr(job, name)) for name in given[:3] if getattr(job, name) is not None},
            "calibration_format": job.calibration_format or find_format(Path(job.calibration)),
            "format": found.format,
            "offsets": dict(read_as.offsets),
            **_rates_in_report(found),
            "without": [*(name for name in self.every.names if name not in self.rig.names), *self.unread],
            "frame_mode": job.frames,
        }
        return Inputs(
            self.rig,
            layout,
            np.broadcast_to(np.nan, (*shape, layout.n_joints, 3)),
            np.zeros(shape, dtype=np.bool_),
            found.frames,
            init_pose=None if init is None else init.pose,
            source=source,
            note=job.note,
            lacking=frozenset(joint for joint, name in job.mapping.items() if name is None),
            read_as=read_as,
            sources=tuple(path for path in found.sources if path is not None),
            fps=rate,
            fps_source=stated,
        )


def open_files(job: Job) -> Opened:
    """Read the cameras that a job names and open the detections."""
    given = ("without", "fps", "layout", "format", "frames", "offsets", "order", "mapping", "sequence")
    read = {name: getattr(job, name) for name in OF_CALIBRATION}
    options = {name: getattr(job, name) for name in given}
    opened = open_recording(Path(job.calibration), Path(job.detections), read=read, **options)
    _note_sigma(Path(job.calibration), opened.every)
    return opened


def open_recording(
    calibration: Path, detections: Path, *, read: Mapping[str, Any], without: Sequence[str], **given: Any
) -> Opened:
    """Read cameras and open detections, with the arguments of `read_rig` and of `open_detections`.

    The detections are in pixels of the calibration's images (`in_calibrated_pixels`), and in step by its
    clocks, which the cameras no longer have then, and by the frame rates (`open_at_rates`).
    """
    told: list[Finding] = []
    try:
        with collected_warnings() as told:
            every = read_rig(calibration, without=without, **read)
    finally:
        for finding in told:
            warn(finding)
    if len(every) < 2:
        raise DatasetError(calibration, "cameras", "at least two cameras", len(every))
    unread = unread_in(told)
    found = open_at_rates(detections, every, without=without, unread=unread, **given)
    unread += tuple(one for one in without if not is_among(one, (*every.names, *unread)))
    _note_clocks(calibration, every, given.get("offsets") or {})
    every = replace(every, clocks={})
    rig = leave_out(every, without, unread)
    cropped = {name for one in told if one.kind == "crop_applied" for name in one.subject.cameras}
    sizes = {name: every[name].size for name in every.names}
    return Opened(every, rig, in_calibrated_pixels(found, sizes, cropped), unread)


def _note_clocks(path: Path, rig: sk.CameraRig, given: Collection[str]) -> None:
    """Note which clocks of a calibration were taken off, unless their cameras' offsets are given."""
    named = {camera_called(text, rig.names) for text in given}
    taken = {name: rounded(clock) for name, clock in rig.clocks.items() if name not in named}
    if taken:
        each = ", ".join(f"{name} {clock:+g}" for name, clock in taken.items())
        words = f"The clocks of {path.name} were applied to the cameras' frame numbers ({each}). They hold "
        words += "for recordings whose cameras were started together with those; given offsets replace them."
        warn(Finding("clocks_applied", "note", Subject(tuple(taken)), taken, sentence=words))


def _note_sigma(path: Path, rig: sk.CameraRig) -> None:
    """Note that error bars contain how sure the cameras are."""
    if rig.joint_sigma:
        millimetres = rig.joint_sigma * rig.mm_per_unit
        words = (
            f"The cameras of {path.name} were found from people: error bars include ± {millimetres:.1f} mm."
        )
        warn(Finding("cameras_estimated", "note", numbers={"mm": millimetres}, sentence=words))


def read_everybody(opened: Opened, job: Job) -> tuple[Array, Inputs]:
    """Return the detections of everybody (T, M, P, N, 3), and inputs with nobody chosen.

    Where a camera repeats one image, its detections are left out. A long recording is refused if it does not
    fit into memory.
    """
    if opened.size > LONG and job.at_once:
        afford(Path(job.detections), listed(job.at_once), _AT_ONCE * opened.size)
    people, whole = opened.detections.read().people, opened.nobody(job)
    repeated = frozen(people)
    stopped = frozen_finding(whole.rig.names, repeated, whole.frames)
    if stopped is not None:
        warn(stopped)
    return without_frozen(people, repeated), whole


def read_rig(path: Path, *, calibration_format: str | None = None, **given: Any) -> sk.CameraRig:
    """Read a calibration; an error of the format calls it ``calibration_format``."""
    try:
        return read_calibration(path, format=calibration_format, **given)
    except InvalidInputError as error:
        if error.argument == "format":
            raise error.of_argument("calibration_format") from error
        raise


def unread_in(told: Iterable[Finding]) -> tuple[str, ...]:
    """Return the cameras that a calibration was read without, as the findings of reading it tell."""
    return tuple(name for one in told if one.numbers.get("unread") for name in one.subject.cameras)


def leave_out(rig: sk.CameraRig, without: Sequence[str], unread: Sequence[str] = ()) -> sk.CameraRig:
    """Return the rig without these cameras; in names, case and separators may differ.

    Those that are ``unread`` may be named, too.
    """
    left_out = cameras_called(without, (*rig.names, *unread), "without")
    kept = [camera for name, camera in zip(rig.names, rig, strict=True) if name not in left_out]
    if len(kept) < 2:
        expected = f"two cameras or more to be left of {', '.join(rig.names)}"
        raise InvalidInputError(f"without: expected {expected}, got {len(kept)}")
    return rig.of(kept) if without else rig


def read_as(found: Detections) -> ReadAs:
    """Return how detections are read."""
    return ReadAs(found.labels, found.offsets, found.uneven, found.paces)


def open_at_rates(path: Path, cameras: sk.CameraRig | Sequence[str], **given: Any) -> Detections:
    """Open detections, at rates of videos beside them if nothing else is known; tell of those that differ."""
    found = open_detections(path, cameras, rates_of=partial(_rates_of_videos, path), **given)
    _tell_of_rates(found)
    return found


def _tell_of_rates(found: Detections) -> None:
    """Tell of rates that differ as files or videos state them, or as files do, if one was given for all."""
    stated = found.stated
    files = {name: view.rate for name, view in found.views.items() if view.rate}
    rates = found.rates if stated else files
    each = ", ".join(f"{name} {round(one, 3):g}" for name, one in rates.items())
    numbers: dict[str, Any] = {"stated_by": stated or "files", "each": each}
    if stated and found.paces:
        words = f"The {stated} state different frame rates ({each}): detections are compared at the instants "
        words += (
            f"of the slowest, {found.frame_rate:g} per second. If the rates are wrong, state the right ones."
        )
        remedy = (Remedy("fps", None),)
        warn(Finding("frame_rates_differ", "note", numbers=numbers, remedy=remedy, sentence=words))
    elif not stated and not found.paces and files and one_rate([*files.values()]) is None:
        words = f"The files state different frame rates ({each}), and one was given for all."
        warn(Finding("frame_rates_differ", "warning", numbers=numbers, sentence=words))


def _rates_in_report(found: Detections) -> dict[str, Any]:
    """Return what the report says of cameras whose rates differ, from which `RunFolder` makes clocks."""
    if not found.paces:
        return {}
    first = max(clock.first for clock in found.clocks.values())
    return {"frame_rates_hz": dict(found.rates), "counted_from": first}


def videos_beside(detections: Path, names: Sequence[str]) -> Iterator[dict[str, FrameSource]]:
    """Yield the videos of all cameras, those with the detections and those in ``videos`` next to them."""
    for folder in (detections, detections.parent / "videos"):
        with suppress(SkelSplatError):
            yield {name: open_source(path) for name, path in find_videos(folder, names).items()}


def _rates_of_videos(detections: Path, views: Mapping[str, View]) -> dict[str, float]:
    """Return the rates of the cameras' videos."""
    for videos in videos_beside(detections, [*views]):
        # detectors count from 0 or 1
        fits = ((views[name].frames <= video.last + 1).all() for name, video in videos.items())
        if all(fits) and all(video.rate for video in videos.values()):
            return {name: video.rate or 0.0 for name, video in videos.items()}
    return {}


def _read_init(path: Path, rig: sk.CameraRig, steps: int, layout: sk.Layout) -> PoseData:
    """Read an initial pose of so many frames, in the rig's unit."""
    data = read_npz(path)
    expected = (steps, layout.n_joints, 3)
    if data.pose.shape != expected:
        raise DatasetError(path, "pose", f"shape {expected} like the detections", data.pose.shape)
    if data.joint_names != tuple(layout.joints):
        raise DatasetError(path, "joint_names", f"the joints of {layout.name}", ", ".join(data.joint_names))
    return replace(data, pose=data.pose * (MM_PER_UNIT[data.unit] / rig.mm_per_unit))
