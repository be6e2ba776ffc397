"""From the files of detections, and perhaps of lenses, to calibrated cameras."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, take_people
from skelsplat._clocks import in_step, shifted
from skelsplat._frozen import frozen, frozen_finding
from skelsplat._who import GAP, one_after_another
from skelsplat._words import size_text
from skelsplat.exceptions import DatasetError, DegenerateGeometryError, InvalidInputError
from skelsplat.findings import Finding, Subject, collected_warnings, warn
from skelsplat.io.detections import Opened as Detections
from skelsplat.io.detections import camera_called, camera_labels, cameras_called
from skelsplat.io.video import find_videos, open_source
from skelsplat.rig_check import ReadAs, unusual_lenses
from skelsplat.run.adjusted import offset_of
from skelsplat.run.by_everybody import Scene
from skelsplat.run.calibrate_findings import of_calibration, of_clocks, of_skipped
from skelsplat.run.cameras import warn_of_place
from skelsplat.run.image_sizes import in_calibrated_pixels, resizing
from skelsplat.run.job import IncompleteJobError
from skelsplat.run.person import are_people, entry_of, pick_places
from skelsplat.run.read import open_at_rates, open_recording, read_as, read_rig, videos_beside
from skelsplat.run.session import different, padded
from skelsplat.run.solve import Progress, evened, part_of, silent, step_of

Size = tuple[int, int]


@dataclass(frozen=True)
class Recorded:
    """A recording by which cameras were found, and how `refine` reads it with these."""

    path: Path
    frames: int
    offsets: Mapping[str, float]  # by camera, what puts it in step; none if the cameras have clocks
    order: tuple[str, ...] | None  # the label of each placed camera, where the files have others, or no names
    uneven: bool  # cameras have different frames in the files
    several: bool  # people by whom the cameras were found, and whom refine can follow at this frame rate


@dataclass(frozen=True)
class Calibrated:
    """Cameras, and what refines the recordings with them."""

    found: sk.RigCalibration  # clocks are in frames of the files
    focal: bool  # focal lengths were unknown, and were found
    scale: str  # what gave it: "stature", "distance", or "adults" in general
    recordings: tuple[Recorded, ...]
    findings: tuple[Finding, ...]
    layout: sk.Layout
    frames: Index  # (T,) of ``found.people``: numbers in the files; of several recordings, a count in steps
    fps: float | None  # frames per second of the recordings
    paces: Mapping[str, float]  # by camera, its frames in one of the recordings, where it is not one

    @property
    def cameras(self) -> tuple[dict[str, Any], ...]:
        """What was found about each camera, as numbers with units in their names; None where unknown."""
        return tuple(self._numbers(one) for one in self.found.report)

    def to_dict(self) -> dict[str, Any]:
        """Return what was found as JSON values."""
        result = self.found
        return {
            "unit": result.cameras.unit,
            "frames": sum(one.frames for one in self.recordings),
            "scale": {"from": self.scale, "relative_sigma": result.scale_sigma, "stature_m": result.stature},
            "up_sigma_degrees": result.up_sigma,
            "joint_sigma_mm": result.cameras.joint_sigma,
            "cameras": self.cameras,
            "clocks": dict(result.cameras.clocks),
            "findings": [finding.to_dict() for finding in self.findings],
        }

    def in_step(self) -> Iterator[Array]:
        """Yield each person's detections (T, M, N, 3), those of all cameras at one time each."""
        step, report = step_of(self.frames), enumerate(self.found.report)
        clocks = {i: one.clock / step / self.paces.get(one.name, 1.0) for i, one in report}
        for person in self.found.people:
            yield in_step(person, clocks)

    def write_html(self, path: str | Path, facts: Sequence[tuple[str, str]] = ()) -> None:
        """Write a page with the cameras in 3D, and what pairs of them explain, of an unsure rig as well.

        ``facts`` are further names and values for its head.
        """
        from skelsplat.run.calibrate_page import page_of  # matplotlib takes long to load
        from skelsplat.viz.report import write_report

        write_report(Path(path), page_of(self, facts))

    def _numbers(self, one: sk.CalibratedCamera) -> dict[str, Any]:
        placed = one.status == "placed"
        focal = float(self.found.cameras[one.name].K[0, 0]) if placed else math.nan
        numbers = {
            "error_px": one.error,
            "explained": one.explained,
            "degrees_sigma": one.turn_sigma if placed else math.nan,
            "mm_sigma": one.place_sigma if placed else math.nan,
            "focal_px": focal,
            "focal_sigma_px": focal * one.focal_sigma if self.focal else math.nan,
            "clock_frames": one.clock if placed else math.nan,
            "clock_sigma_frames": one.clock_sigma if placed else math.nan,
        }
        known = {name: float(value) if np.isfinite(value) else None for name, value in numbers.items()}
        return {"camera": one.name, "status": one.status, **known}


@dataclass(frozen=True)
class _Recording:
    """Detections, and the lenses of their cameras as far as they are known."""

    path: Path
    detections: Detections
    lenses: Sequence[sk.Intrinsics | sk.Camera]
    renamed: bool  # refine does not find these cameras' detections by name alone


@dataclass(frozen=True)
class _Seen:
    """The detections (T, M, P, N, 3) of people in a recording, at even times so many frames apart."""

    recording: _Recording
    people: Array
    frames: Index

    @property
    def step(self) -> int:
        """What the numbers of the frames go up by."""
        return step_of(self.frames)

    @classmethod
    def of(cls, recording: _Recording, person: str | None) -> _Seen:
        """Read them, and warn of videos that stopped."""
        path, names, found = recording.path, recording.detections.camera_names, recording.detections.read()
        seen = _people(found.people, person)
        if not np.isfinite(seen[..., 0]).any():
            raise DatasetError(path, "detections", "a person to find the cameras by", "none")
        stopped = frozen_finding(names, frozen(seen), found.frames)
        if stopped is not None:
            warn(stopped)
        return cls(recording, *evened(seen, found.frames))

    def calibrated(self, people: Array, **asked: Any) -> sk.RigCalibration:
        """Find the cameras by these detections, with lenses, joints and frame rate of the recording."""
        one = self.recording
        fps = one.detections.frame_rate
        rate = None if fps is None else fps / self.step
        try:
            return sk.calibrate_cameras(people, one.lenses, layout=one.detections.skeleton, fps=rate, **asked)
        except DegenerateGeometryError as error:
            expected, _, got = str(error).partition("expected ")[2].partition(", got ")
            raise DatasetError(one.path, "detections", expected, got) from error

    def alone(self, clock: bool, asked: Mapping[str, Any]) -> sk.RigCalibration | None:
        """Find the cameras, and clocks, for these; without ``clock``, None if they are equal or it fails."""
        try:
            found = self.calibrated(self.people, clock=clock, **asked)
        except DatasetError:
            if clock:
                raise
            return None
        if clock and not found.sure and found.doubts[0] in ("movement", "periodic"):
            expected = "movement that tells clocks, or a calibration by the other recordings"
            raise DatasetError(self.recording.path, "clocks", expected, f"doubts ({found.doubts[0]})")
        return found if clock or any(found.clocks.values()) else None

    def skipped(self, found: sk.RigCalibration, people: Array, several: bool) -> Iterator[Finding]:
        """Name cameras that skipped frames in this recording, which may be one of ``several``."""
        one = self.recording
        read, name = one.detections, str(one.path) if several else ""
        scene = Scene(found.cameras, people, self.frames, read.skeleton, read_as(read))
        yield from of_skipped(found, one.lenses, scene, name)

    def in_files(self, found: sk.RigCalibration) -> sk.RigCalibration:
        """Return cameras with clocks in their own frames in the files."""
        return replace(
            found, report=tuple(read_as(self.recording.detections).in_files(found.report, self.step))
        )


def calibrate_cameras(
    detections: Path | Sequence[Path],
    intrinsics: Path | None = None,
    *,
    read: Mapping[str, Any] | None = None,
    videos: Path | None = None,
    person: str | None = None,
    stature: float | None = None,
    distance: tuple[str, str, float] | None = None,
    same_focal: bool = False,
    clock: bool = False,
    progress: Progress = silent,
    **given: Any,
) -> Calibrated:
    """Read a recording, or several of the same cameras and person, and find the cameras.

    As `skelsplat.calibrate_cameras`; what several recordings say adds up, with clocks of their own.
    ``intrinsics`` is a calibration file whose places are ignored, read with the arguments ``read`` of
    `skelsplat.run.read.read_rig`. Without it, image sizes are those that the detections or the cameras'
    videos state, or the ``size`` of ``read``, and focal lengths are found. ``person`` is a place in each
    file, or ``"largest"`` in each image; without it, all people count. ``progress`` is called with (steps
    done, steps known). ``given`` are arguments of `skelsplat.io.read_detections`, and ``fps``. A
    `DatasetError` or an `InvalidInputError` if files are malformed, or do not fit each other or the options.
    """
    if person not in (None, "largest") and entry_of(person) is None:
        raise InvalidInputError(f"person: expected largest or an entry such as entry:0, got {person!r}")
    with collected_warnings() as warnings:
        read = {name: value for name, value in (read or {}).items() if value is not None}
        _check_lenses(intrinsics, read, videos, same_focal)
        recordings = _opened(different(detections), intrinsics, read, videos, given)
        first = recordings[0]
        if distance is not None:
            *ends, metres = distance
            a, b = (camera_called(end, first.detections.camera_names, "distance") for end in ends)
            distance = (a, b, metres)
        seen = [_Seen.of(recording, person) for recording in recordings]
        asked = {"stature": stature, "distance": distance, "same_focal": same_focal}
        result, offsets, told = _calibrated(seen, clock, asked, progress)
    times, layout = _times(seen), first.detections.skeleton
    if not math.isfinite(result.scale_sigma):
        expected = f"that of two cameras, as {layout.name} lacks people's proportions"
        raise InvalidInputError(f"distance: expected {expected}, got none")
    # places of lenses are ignored
    kept = [one for k, one in enumerate(warnings) if one.kind != "unit_wrong" and one not in warnings[:k]]
    return Calibrated(
        result,
        focal=not isinstance(first.lenses[0], sk.Camera),
        scale="distance" if distance is not None else "adults" if stature is None else "stature",
        recordings=tuple(map(partial(_recorded, result, times), seen, offsets)),
        findings=(*kept, *told, *of_calibration(result, times, clock, same_focal, told, layout)),
        layout=layout,
        frames=seen[0].frames if len(seen) == 1 else seen[0].step * np.arange(len(result.people[0])),
        fps=first.detections.frame_rate,
        paces=first.detections.paces,
    )


def _check_lenses(
    intrinsics: Path | None, read: Mapping[str, Any], videos: Path | None, same_focal: bool
) -> None:
    """Refuse what has no effect with, or without, a file of lenses."""
    if intrinsics is None:
        for option in (name for name in read if name != "size"):
            raise IncompleteJobError(option, "intrinsics")
    elif same_focal:
        raise InvalidInputError("same_focal: expected none with intrinsics=, which state focal lengths")
    elif videos is not None:
        raise InvalidInputError("videos: expected none with intrinsics=, which state the image sizes")


def _opened(
    paths: Sequence[Path], intrinsics: Path | None, read: dict[str, Any], videos: Path | None, given: Any
) -> list[_Recording]:
    """Open recordings of the same cameras and joints; the lenses may be unknown."""
    if intrinsics is not None:
        recordings = [_with_lenses(path, intrinsics, read, **given) for path in paths]
    else:
        recordings = [_named(path, videos, read.get("size"), **given) for path in paths]
    first = recordings[0]
    a = first.detections
    for path, b in zip(paths, (one.detections for one in recordings), strict=True):
        joints = tuple(a.skeleton.joints), tuple(b.skeleton.joints)
        for what, known, found in (("cameras", a.camera_names, b.camera_names), ("joints", *joints)):
            if known != found:
                expected = f"those of {paths[0]}, {', '.join(known)}"
                raise DatasetError(path, what, expected, ", ".join(found))
    if intrinsics is not None:  # they are in pixels of its images
        return recordings
    return [first, *(_in_pixels_of(first, one) for one in recordings[1:])]


def _in_pixels_of(first: _Recording, one: _Recording) -> _Recording:
    """Return a recording in pixels of the first one's images, of which its own have to be copies."""
    sizes = dict(zip(first.detections.camera_names, (lens.size for lens in first.lenses), strict=True))
    for (name, whole), lens in zip(sizes.items(), one.lenses, strict=True):
        factors = resizing(lens.size, whole)
        stated = name in one.detections.sizes  # refine resizes as well
        if factors is None or not (stated or (factors == 1.0).all()):
            expected = f"{size_text(whole)} for {name}, as in {first.path}"
            raise DatasetError(one.path, "image size", expected, size_text(lens.size))
    return replace(one, detections=in_calibrated_pixels(one.detections, sizes), lenses=first.lenses)


def _calibrated(
    seen: Sequence[_Seen], clock: bool, asked: Mapping[str, Any], progress: Progress
) -> tuple[sk.RigCalibration, list[dict[str, float]], list[Finding]]:
    """Return the cameras, with clocks that are those of all recordings, or what puts each in step.

    Of several recordings each has its own clocks, which are found in it alone, before all are taken together.
    """
    several, parts, offsets, told = len(seen) > 1, list[Array](), list[Mapping[str, float]](), list[Finding]()
    for k, one in enumerate(seen):
        own, part = read_as(one.recording.detections), part_of(progress, k, len(seen) + 1)
        alone = one.alone(clock, {**asked, "progress": part}) if several else None
        parts.append(one.people if alone is None else _in_step(one.people, alone))
        offsets.append(own.offsets if alone is None else _offsets(one.in_files(alone), own))
        if alone is not None:
            told += of_clocks(one.in_files(alone), str(one.recording.path))
    together = one_after_another([padded(part, max(one.shape[2] for one in parts)) for part in parts])
    done = len(seen) if several else 0
    asked = {**asked, "progress": part_of(progress, done, done + 1)}
    found = seen[0].calibrated(together, clock=clock and not several, **asked)
    for one, people in zip(seen, parts, strict=True):
        told += one.skipped(found, people, several)
    found = seen[0].in_files(found)
    each = [_offsets(found, ReadAs(offsets=own)) for own in offsets]
    shared = all(one == each[0] for one in each)
    clocks = {name: -offset for name, offset in each[0].items()} if shared else {}
    found = replace(found, cameras=replace(found.cameras, clocks=clocks))
    return found, [{}] * len(each) if shared else each, told


def _times(seen: Sequence[_Seen]) -> list[tuple[int, str]]:
    """Return number and recording of every frame of all recordings, `one_after_another`."""
    frames = [(one, [*one.frames, *[one.frames[-1]] * GAP]) for one in seen]
    return [(int(t), str(one.recording.path)) for one, numbers in frames for t in numbers][:-GAP]


def _in_step(people: Array, found: sk.RigCalibration) -> Array:
    """Return detections (T, M, P, N, 3) at one time each, without cameras whose clocks were not found."""
    out = np.full(people.shape, np.nan)
    for i, one in enumerate(found.report):
        if one.status == "placed":
            out[:, i] = shifted(people[:, i], one.clock)
    return out


def _offsets(found: sk.RigCalibration, read_as: ReadAs) -> dict[str, float]:
    """Return by placed camera what puts it in step, with what was added to its frame numbers before."""
    return {one.name: offset_of(one, read_as) for one in found.report if one.status == "placed"}


def _recorded(
    found: sk.RigCalibration, times: list[tuple[int, str]], seen: _Seen, offsets: Mapping[str, float]
) -> Recorded:
    """Return how `refine` reads a recording with the cameras that were found by these frames."""
    one, placed = seen.recording, found.cameras.names
    own = [name == str(one.path) for _, name in times]
    people = sum(bool(np.isfinite(person[own]).any()) for person in found.people)
    opened, other = one.detections, one.renamed or len(placed) < len(one.detections.camera_names)
    return Recorded(
        one.path,
        len(opened.frames),
        offsets={name: number for name, number in offsets.items() if number and name in placed},
        order=tuple(opened.matched[name] for name in placed) if other else None,
        uneven=opened.uneven,
        several=people > 1 and opened.frame_rate is not None,
    )


def _with_lenses(
    detections: Path, intrinsics: Path, read: dict[str, Any], *, without: Sequence[str] = (), **given: Any
) -> _Recording:
    """Open a recording of cameras whose lenses are known."""
    try:
        read_rig(intrinsics, **read)
    except InvalidInputError as error:
        if error.argument != "unit":
            raise
        read["unit"] = "mm"  # of places, which are ignored
    opened = open_recording(intrinsics, detections, read=read, without=without, **given)
    for finding in unusual_lenses(opened.rig):
        warn(finding)
    if opened.rig.joint_sigma:
        words = f"The cameras of {intrinsics.name} were found from people. Their lenses are taken as exact, "
        words += (
            "so error bars are too small if these were estimated too. Leave the file out to find them again."
        )
        warn(Finding("cameras_estimated", "note", Subject(files=(str(intrinsics),)), sentence=words))
    renamed = bool(without or given.get("order"))
    return _Recording(detections, opened.detections, tuple(opened.rig), renamed)


def _named(
    detections: Path,
    videos: Path | None,
    size: Size | None,
    *,
    without: Sequence[str] = (),
    order: str | Sequence[str] | None = None,
    **given: Any,
) -> _Recording:
    """Open a recording whose cameras have the names that the detections have."""
    if order is not None:
        raise InvalidInputError("order: expected none without intrinsics=, which has the cameras' names")
    labels = camera_labels(detections, format=given.get("format"), sequence=given.get("sequence"))
    left_out = cameras_called(without, list(labels), "without")
    if len(labels) - len(left_out) < 2:
        raise DatasetError(detections, "cameras", "at least two cameras", len(labels) - len(left_out))
    kept = {name: label for name, label in labels.items() if name not in left_out}
    opened = open_at_rates(detections, list(kept), order=list(kept.values()), **given)
    sizes = _sizes(opened, detections, videos, size)
    lenses = tuple(sk.Intrinsics(size=sizes[name], name=name) for name in kept)
    unnamed = all(label.isdecimal() for label in labels.values())
    return _Recording(detections, opened, lenses, bool(left_out) or unnamed)


def _sizes(opened: Detections, detections: Path, videos: Path | None, size: Size | None) -> dict[str, Size]:
    """Return the size of each camera's images."""
    names, stated = opened.camera_names, dict(opened.sizes)
    if videos is not None:
        stated |= {name: open_source(path).size for name, path in find_videos(videos, names).items()}
    elif len(stated) < len(names) and size is None:
        beside = next(videos_beside(detections, names), {})
        stated = {**{name: video.size for name, video in beside.items()}, **stated}
    other = [name for name, known in stated.items() if size not in (None, known)]
    if other:
        expected = f"none or {size_text(stated[other[0]])}, which the files state for {other[0]}"
        raise InvalidInputError(f"size: expected {expected}, got {size_text(size or ())}")
    missing = [name for name in names if name not in stated]
    if missing and size is None:
        expected = f"the width and height of the images of {', '.join(missing)}, because neither the "
        expected += "detections nor videos beside them state it"
        raise InvalidInputError(f"size: expected {expected}, got none")
    return {**dict.fromkeys(missing, size or (0, 0)), **stated}


def _people(people: Array, person: str | None) -> Array:
    """Return the detections of people (T, M, P, N, 3) who count: everybody, or one of them."""
    there = are_people(people)
    if person is None and (there.sum(axis=2) > 1).any():
        return np.where(there[..., None, None], people, np.nan)
    index = np.where(there.any(axis=2), there.argmax(axis=2), -1)
    if person is not None:
        warn_of_place(people, person)
        index = pick_places(people, person, np.empty((1, 0, 0), dtype=np.int64))[0]
    return take_people(people, index)[:, :, None]
