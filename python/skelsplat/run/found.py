"""What the folder of a recording holds, what is missing, and what helps."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._words import listed, metric, size_text
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError, SkelSplatError
from skelsplat.findings import collected_warnings
from skelsplat.io._run_files import REPORT, is_run
from skelsplat.io.calibration import find_format as calibration_format
from skelsplat.io.calibration import read_calibration
from skelsplat.io.detections import is_among, open_detections, sights
from skelsplat.io.detections._record import read_record
from skelsplat.io.detections._registry import recognised
from skelsplat.io.video import FrameSource, open_source, videos_of
from skelsplat.run.contents import contents, folders_of_one_video
from skelsplat.run.job import rates_in
from skelsplat.run.read import OF_CALIBRATION, read_rig

_LOOKED_AT = 200  # files of a folder
_SAMPLED = 12  # frames in which people are counted
_CALIBRATIONS = (".toml", ".json", ".xml", ".txt", ".xcp", ".yml", ".yaml", ".npz", ".pickle", ".pkl", ".h5")
_OF_DETECTIONS = ("layout", "offsets", "fps", "order", "without", "mapping")
_PER_SECOND = {rate: f"{rate} per second" for rate in ("25", "30", "50", "60", "100")}
_NO_RATE = (
    "The frame rate is not known; without it, frames are solved one by one. Choose it, or type it at --fps:"
)
_NO_NAMES = "The keypoints do not name their cameras."
_SIZES = [(640, 480), (1280, 720), (720, 1280), (1920, 1080), (1080, 1920), (3840, 2160), (2160, 3840)]
_NO_SIZE = (
    "The size of the images is not known, and finding the cameras needs it. Choose one that holds the "
    "keypoints, or type another at --size in “More settings”:"
)
_ASKED = ("size", "unit", "", "order", "without", "layout", "fps")  # in this order, by setting
_ABOVE = 3  # folders above a recording in which its calibration may be


@dataclass(frozen=True)
class Camera:
    """What is known of one camera; None where nothing says it."""

    name: str
    frames: int | None = None
    fps: float | None = None
    size: tuple[int, int] | None = None
    people: int | None = None
    reach: tuple[float, float] = (0.0, 0.0)  # px, how far right and down keypoints are, but for 1 % of them

    @property
    def image(self) -> str | None:
        """Its size in words."""
        return None if self.size is None else f"{self.size[0]}×{self.size[1]}"


@dataclass(frozen=True)
class Lack:
    """Something that is missing or wrong, in words, and what helps: a command, or values of a setting."""

    text: str
    command: str = ""
    setting: str = ""
    values: Mapping[str, str] = field(default_factory=dict)  # by value, in words
    value: str = ""  # the one that was given
    optional: bool = False  # poses can be found without


@dataclass(frozen=True)
class Found:
    """What a folder holds; paths are relative to it."""

    folder: Path
    cameras: tuple[Camera, ...] = ()
    calibration: str = ""
    calibrations: tuple[str, ...] = ()  # all that may be meant
    detections: str = ""
    keypoints: tuple[str, ...] = ()  # likewise
    videos: str = ""
    layout: str = ""
    unit: str = ""
    lacks: tuple[Lack, ...] = ()
    chosen: tuple[Lack, ...] = ()  # what files do not state and was given, with what else it may be
    fps: str = ""  # as it was given
    names: tuple[str, ...] = ()  # of the cameras: the calibration's if there is one
    inside: tuple[str, ...] = ()  # folders with a recording each, if it is a folder of several

    @property
    def empty(self) -> bool:
        """Whether there is nothing of a recording."""
        return not (self.calibrations or self.keypoints or self.videos)

    @property
    def ready(self) -> bool:
        """Whether nothing is missing for poses."""
        missing = any(not lack.optional for lack in self.lacks)
        return bool(self.calibration and self.detections) and not missing

    @property
    def asked(self) -> list[Lack]:
        """What is missing and what was given instead; one that is answered keeps its place."""
        return sorted([*self.lacks, *self.chosen], key=lambda lack: _ASKED.index(lack.setting))

    @property
    def facts(self) -> dict[str, str]:
        """What was found, in a few words each."""
        frames = sorted({one.frames for one in self.cameras if one.frames})
        people = [one.people for one in self.cameras if one.people is not None]
        named = {
            "cameras": str(len(self.cameras) or ""),
            "frames": " to ".join(map(str, dict.fromkeys([*frames[:1], *frames[-1:]]))),
            "frames per second": self.fps or _rates(one.fps for one in self.cameras),
            "people at once": f"up to {max(people)}" if people else "",
            "joints": self.layout,
            "unit of the calibration": self.unit,
        }
        return {name: text or "–" for name, text in named.items()}

    @property
    def files(self) -> dict[str, str]:
        """Where it is."""
        named = {"Calibration": self.calibration, "Keypoints": self.detections, "Videos": self.videos}
        return {name: "this folder" if text == "." else text or "none" for name, text in named.items()}


def lack_of_several(found: Iterable[Found]) -> Lack | None:
    """Return the first thing that one of several recordings lacks, or that all can do without."""
    more = ", or refine them again without it"
    lacks = [
        replace(lack, text=f"{one.folder.name}: {lack.text[:-1]}{more * lack.optional}{lack.text[-1]}")
        for one in found
        for lack in (*one.lacks, *[Lack("It holds no recording.")] * one.empty)
        if lack.setting or not lack.optional
    ]
    return min(lacks, key=lambda lack: lack.optional, default=None)


def _rates(fps: Iterable[float | None]) -> str:
    """Return different frame rates in words."""
    return " and ".join(sorted({f"{one:.5g}" for one in fps if one}))


def output_of(folder: Path) -> str:
    """Return the folder for the results of a recording: where an earlier run wrote, else ``out``."""
    return "." if is_run(folder) else "out"


def look(folder: Path, given: Mapping[str, Any], top: Path | None = None) -> Found:
    """Return what a folder holds.

    ``given`` has fields of `skelsplat.run.Job` by which files are read. Its ``calibration`` and
    ``detections`` choose among several, by their paths from the folder; ``size`` is that of all images where
    files do not state it. A calibration may also be in folders above, up to ``top``.
    """
    with collected_warnings():
        return _look(folder, given, top or folder)


def _look(folder: Path, given: Mapping[str, Any], top: Path) -> Found:
    keypoints, videos, inside = contents(folder)
    if inside:
        return Found(folder, inside=inside)
    beside = [folder, *(folder / name for name in keypoints), *((folder / name).parent for name in keypoints)]
    calibrations, broken = _calibrations(folder, [*beside, *_of_cameras(folder)])
    for above in [one for one in folder.parents if one.is_relative_to(top)][:_ABOVE]:
        if not calibrations and not broken:
            calibrations, broken = _calibrations(folder, [above, *_of_cameras(above)])
    calibration = _chosen(calibrations, given.get("calibration"))
    detections = _chosen(keypoints, given.get("detections"))
    rig, lack = _rig(folder, calibration, given)
    cameras, layout, more = _sight(folder, detections, rig, given)
    sources = _sources(folder / videos) if videos else {}
    if sources:
        cameras = cameras or tuple(Camera(name) for name in sources)
        cameras = tuple(_with_source(one, sources.get(one.name)) for one in cameras)
    stated = calibration or given.get("size") or all(one.size for one in cameras)
    unknown = detections and not stated
    lacks = [Lack(_NO_SIZE, setting="size", values=_sizes(cameras))] if unknown else []
    if videos and detections:
        lacks += _unfinished(folder / detections, cameras)
    apart = folders_of_one_video(folder) if not detections and not videos else []
    lacks += [*broken, *lack, *more, *_missing(folder, calibration, detections, videos, bool(broken), apart)]
    if not given.get("fps") and detections and not any(one.fps for one in cameras):
        lacks.append(Lack(_NO_RATE, setting="fps", values=_PER_SECOND, optional=True))
    files = (calibration, calibrations, detections, keypoints, videos)
    unit, names = ("", [one.name for one in cameras]) if rig is None else (rig.unit, rig.names)
    chosen = tuple(_otherwise(folder, calibration, cameras, layout, given))
    rates = _rates(rates_in(given.get("fps")))
    return Found(folder, cameras, *files, layout, unit, tuple(lacks), chosen, rates, tuple(names))


def _otherwise(
    folder: Path, calibration: str, cameras: Sequence[Camera], layout: str, given: Mapping[str, Any]
) -> Iterator[Lack]:
    """Yield what was given because files do not state it, with what else it may be."""
    known: dict[str, tuple[str, Mapping[str, str]]] = {}
    if given.get("unit") and calibration and _rig(folder, calibration, {**given, "unit": None})[1]:
        known["unit"] = given["unit"], dict(_units(folder / calibration))
    if given.get("layout") == layout and layout:
        known["layout"] = layout, {name: name for name in _layouts(sk.layouts.get(layout).n_joints)}
    if given.get("size") and not calibration:
        known["size"] = size_text(given["size"]), _sizes(cameras)
    if given.get("fps") and not any(one.fps for one in cameras):
        known["fps"] = _rates(rates_in(given["fps"])), _PER_SECOND
    for setting, (value, values) in known.items():
        text = f"--{setting} {value}: chosen, since no file states it." + " If it is wrong:" * (
            len(values) > 1
        )
        yield Lack(text, setting=setting, values=values, value=value, optional=True)


def _layouts(joints: int) -> list[str]:
    return [name for name in sk.layouts.names if sk.layouts.get(name).n_joints == joints]


def _missing(
    folder: Path, calibration: str, detections: str, videos: str, broken: bool, apart: Sequence[str]
) -> Iterator[Lack]:
    if not detections and videos:
        yield Lack("There are videos, and no keypoints yet: a detector finds the people in them.", "detect")
    elif apart:
        yield Lack(
            f"There is one video in each of {', '.join(apart)}. Put the videos of all cameras into one "
            "folder, each named after its camera."
        )
    elif not detections and any(any(folder.glob(f"{name}people_simulated_*")) for name in ("", "takes/*/")):
        yield Lack(
            "The keypoints are in the simulation's own format. Simulate again with skelsplat synth people "
            "--openpose, which also writes OpenPose files."
        )
    elif not detections:
        yield Lack(
            "There are no videos and no keypoints here. Put one video per camera, or what a detector of "
            "keypoints has written, into this folder, or choose another."
        )
    elif not calibration:
        also = " that can be read" if broken else ""
        yield Lack(
            f"There is no calibration{also}. The cameras can be found from the people in the recording; it "
            "takes somebody who walks about for ten seconds. Or bring the calibration file.",
            "calibrate",
        )


def _unfinished(detections: Path, cameras: Iterable[Camera]) -> Iterator[Lack]:
    """Yield that detections end earlier in some cameras than in others, if `skelsplat detect` was stopped."""
    with suppress(DatasetError):
        record = read_record(detections)
        videos = {} if record is None else record.videos
        frames = {one.name: one.frames or 0 for one in cameras}
        most = max(frames.values(), default=0)
        part = {
            name: frames.get(name, 0)
            for name, video in videos.items()
            if video.count is None and frames.get(name, 0) < most
        }
        if part:
            found = ", ".join(f"{name} {count or 'none'}" for name, count in part.items())
            words = f"People were found in a part of the frames only ({found} of {most})."
            yield Lack(words, "detect", optional=True)


def _chosen(names: tuple[str, ...], wanted: str | None) -> str:
    return wanted if wanted in names else next(iter(names), "")


def _of_cameras(folder: Path) -> list[Path]:
    """Return the folders in one that are called after calibrations or cameras, as Pose2Sim and synth do."""
    inside = [one for one in folder.iterdir() if one.is_dir()]
    return [one for one in inside if any(word in one.name.lower() for word in ("calib", "cameras"))]


def _calibrations(folder: Path, places: Iterable[Path]) -> tuple[tuple[str, ...], list[Lack]]:
    """Return the calibrations in some folders, and what is wrong with files that look like one."""
    found: list[str] = []
    lacks: list[Lack] = []
    for place in (one for one in dict.fromkeys(places) if one.is_dir() and not is_run(one)):
        files = [
            one for one in sorted(place.iterdir()) if one.suffix.lower() in _CALIBRATIONS and one.is_file()
        ]
        for path in files[:_LOOKED_AT]:
            name = Path(os.path.relpath(path, folder)).as_posix()
            try:
                if path.name != REPORT and not recognised(path) and calibration_format(path):
                    found.append(name)
            except (SkelSplatError, OSError) as error:
                if "calib" in name.lower():
                    lacks.append(Lack(_line(error, folder)))
    return tuple(dict.fromkeys(found)), lacks


def _line(error: Exception, folder: Path) -> str:
    """Return an error in one line, with paths from the folder of the recording."""
    return str(error).replace(f"{folder}/", "")


def _rig(folder: Path, calibration: str, given: Mapping[str, Any]) -> tuple[sk.CameraRig | None, list[Lack]]:
    """Return the cameras of a calibration, or what is missing to read it."""
    if not calibration:
        return None, []
    options = {name: given[name] for name in (*OF_CALIBRATION, "without") if given.get(name)}
    try:
        return read_rig(folder / calibration, **options), []
    except (SkelSplatError, OSError) as error:
        if isinstance(error, InvalidInputError) and error.argument == "unit" and not given.get("unit"):
            words = f"{calibration} does not state its unit of length. Choose the one that fits your room:"
            return None, [Lack(words, setting="unit", values=dict(_units(folder / calibration)))]
        return None, [Lack(_line(error, folder))]


def _units(calibration: Path) -> Iterator[tuple[str, str]]:
    """Yield each unit, and how far apart cameras are in it."""
    for unit, per in MM_PER_UNIT.items():
        centres = np.array([camera.centre for camera in read_calibration(calibration, unit=unit)])
        apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1).max() * per
        yield unit, f"{unit}: cameras are up to {metric(apart)} apart"


def _sight(
    folder: Path, detections: str, rig: sk.CameraRig | None, given: Mapping[str, Any]
) -> tuple[tuple[Camera, ...], str, list[Lack]]:
    """Return the cameras as detections show them, the layout, and what is missing to read them."""
    known = () if rig is None else zip(rig.names, rig, strict=True)
    cameras = tuple(Camera(name, size=camera.size) for name, camera in known)
    if not detections:
        return cameras, "", []
    try:
        named = {name: given[name] for name in ("format", "sequence") if given.get(name)}
        views = sights(folder / detections, **named)
        cameras = tuple(
            Camera(name, len(view.frames), view.rate, view.size, *_seen(view)) for name, view in views.items()
        )
        names = list(views) if rig is None else rig
        options = {name: given[name] for name in _OF_DETECTIONS if given.get(name)}
        opened = open_detections(folder / detections, names, frames="union", **named, **options)
    except (SkelSplatError, OSError) as error:
        if isinstance(error, InvalidInputError) and error.argument == "layout" and cameras:
            everybody = (one for view in views.values() for people in _sampled(view) for one in people)
            joints = len(next(everybody, ()))
            fitting = _layouts(joints)
            words = f"The keypoints have {joints} joints per person, and do not say which. Choose the layout:"
            if fitting:
                return cameras, "", [Lack(words, setting="layout", values={name: name for name in fitting})]
        if isinstance(error, DatasetError) and error.field == "cameras" and not given.get("order"):
            values = {"sorted": "Take them in the order of the calibration"}
            return cameras, "", [Lack(_NO_NAMES, setting="order", values=values)]
        return cameras, "", [_blind(folder, detections, rig, cameras, given) or Lack(_line(error, folder))]
    return cameras, opened.skeleton.name, []


def _blind(
    folder: Path, detections: str, rig: sk.CameraRig | None, seen: Sequence[Camera], given: Mapping[str, Any]
) -> Lack | None:
    """Return that some cameras have no detections, if these are read without them."""
    names, before = [one.name for one in seen], given.get("without", ())
    blind = [name for name in (() if rig is None else rig.names) if not is_among(name, [*names, *before])]
    without = [*before, *blind]
    if not blind or any(
        not lack.setting for lack in _sight(folder, detections, rig, {**given, "without": without})[2]
    ):
        return None
    values = {",".join(without): f"Without {', '.join(blind)}"}
    return Lack(f"There are no keypoints of {listed(blind)}.", setting="without", values=values)


def _sampled(view: Any) -> Iterator[list[Any]]:
    """Yield the people in some frames of a view, evenly chosen."""
    places = np.unique(np.linspace(0, len(view.frames) - 1, _SAMPLED).astype(np.int64))
    for people in view.people(places if len(view.frames) else places[:0]):
        yield [one for one in people if len(one)]


def _seen(view: Any) -> tuple[int | None, tuple[float, float]]:
    """Return how many people some frames have at once, at most, and how far right and down they are."""
    sampled = [*_sampled(view)]
    joints = np.concatenate([[(0.0, 0.0, 1.0)], *(person for people in sampled for person in people)])
    right, down = np.nanquantile(joints[joints[:, 2] > 0, :2], 0.99, axis=0)
    return max(map(len, sampled), default=None), (float(right), float(down))


def _sizes(cameras: Sequence[Camera]) -> dict[str, str]:
    """Return the usual sizes of images in which the keypoints are, the smallest first."""
    right, down = np.max([one.reach for one in cameras], axis=0)
    return {f"{w}x{h}": f"{w}×{h}" for w, h in _SIZES if right <= w and down <= h}


def _sources(videos: Path) -> dict[str, FrameSource]:
    """Return the videos by camera; none if they cannot be read."""
    with suppress(SkelSplatError, OSError):
        return {name: open_source(path) for name, path in videos_of(videos).items()}
    return {}


def _with_source(one: Camera, source: FrameSource | None) -> Camera:
    """Return a camera with what its video says."""
    if source is None:
        return one
    frames = source.last - source.first + 1 if one.frames is None else one.frames
    return Camera(one.name, frames, one.fps or source.rate, one.size or source.size, one.people)
