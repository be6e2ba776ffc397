"""``detect.json``, which ``skelsplat detect`` writes next to its OpenPose files: detector, layout, videos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from skelsplat import _json
from skelsplat._atomic import atomic_write_text
from skelsplat._fields import Field
from skelsplat.io._files import json_document
from skelsplat.io.detections._format import View

_NAME = "detect.json"
_SUFFIX = "_json"
# of a video in the file: its key → the attribute of `Video`
_KEYS = {"video": "name", "size": "size", "frame_rate": "rate", "bytes": "length", "frames": "count"}


@dataclass(frozen=True)
class Video:
    """What the detections of a camera were made from."""

    name: str  # of the file or of the folder of images
    size: tuple[int, int]  # width and height, upright
    rate: float | None = None  # frames per second
    length: int | None = None  # of the file, bytes
    count: int | None = None  # of its frames, once the last has been reached


@dataclass(frozen=True)
class Record:
    """What a folder of detections states about itself."""

    detector: Mapping[str, str]  # backend, model and their versions: the same in the whole folder
    layout: str
    joints: tuple[str, ...] = ()
    videos: Mapping[str, Video] = field(default_factory=dict)  # by camera


def camera_folder(folder: Path, camera: str) -> Path:
    """Return the folder of a camera's files, named as OpenPose's and Pose2Sim's are."""
    return folder / f"{camera}{_SUFFIX}"


def read_record(folder: Path) -> Record | None:
    """Return the record in a folder; None if there is none."""
    path = folder / _NAME
    if not path.is_file():
        return None
    document = json_document(path, "what skelsplat detect wrote")
    if "detector" not in document:
        return None  # another program's
    detector, videos = document["detector"].table(), document["videos"].table()
    return Record(
        {key: detector[key].text() for key in detector.value},
        document["layout"].text(),
        tuple(document["joints"].names()),
        {camera: _video(videos[camera]) for camera in videos.value},
    )


def _video(entry: Field) -> Video:
    rate = None if entry["frame_rate"].value is None else entry["frame_rate"].number()
    counts = (None if entry[key].value is None else entry[key].index() for key in ("bytes", "frames"))
    return Video(entry["video"].text(), entry["size"].size(), rate, *counts)


def write_record(folder: Path, record: Record) -> None:
    """Write the record into a folder that is there."""
    videos = {
        camera: {key: getattr(video, name) for key, name in _KEYS.items()}
        for camera, video in record.videos.items()
    }
    document = {"detector": dict(record.detector), "layout": record.layout, "joints": record.joints}
    atomic_write_text(folder / _NAME, _json.to_text({**document, "videos": videos}))


def with_record(view: View) -> View:
    """Return the view of a camera's folder with the joints, rate and size that the record there states."""
    place = view.path if view.path.name not in ("", "..") else view.path.absolute()
    record = read_record(place.parent)
    if record is None:
        return view
    video = record.videos.get(view.path.name.removesuffix(_SUFFIX))
    view = replace(view, joints=record.joints or None, own_order=True)
    return view if video is None else replace(view, rate=video.rate, size=video.size)
