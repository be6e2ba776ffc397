"""The folder of results: of which videos and detector its files are, and which frames are there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write, opening
from skelsplat.exceptions import InvalidInputError
from skelsplat.io._files import listed
from skelsplat.io.detections._record import Record, Video, camera_folder, read_record, write_record
from skelsplat.io.video import FrameSource

_DIGITS = 12
_SHOWN = 4
_DECIMALS = 4


@dataclass
class Results:
    """A folder that one detector writes into, and the record there."""

    folder: Path
    record: Record

    @classmethod
    def opened(
        cls, folder: Path, wanted: Record, sources: Mapping[str, FrameSource], *, overwrite: bool
    ) -> Results:
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

    def folder_of(self, camera: str) -> Path:
        """Return the folder of a camera."""
        return camera_folder(self.folder, camera)

    def done(self, camera: str, span: tuple[int, int]) -> set[int]:
        """Return the frames from `span` that are there; an empty file, left by a power failure, is not."""
        files = _files(self.folder, camera).items()
        return {number for number, path in files if span[0] <= number <= span[1] and path.stat().st_size}

    def complete(self, camera: str, span: tuple[int, int], done: int, images: int) -> bool:
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
        path = self.folder_of(camera) / f"{camera}_{number:0{_DIGITS}d}.json"
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
