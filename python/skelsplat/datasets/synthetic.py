"""Simulated data sets, read and written; ``docs/synthetic-data.md`` describes the layout."""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from skelsplat import io
from skelsplat._arrays import Array, Index, largest_slots
from skelsplat._atomic import opening
from skelsplat._fields import Field
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import Survey, frames_in, read_cameras
from skelsplat.datasets._model import Dataset, PeopleTake, Take
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._arrays import npz_fields
from skelsplat.io._files import json_document
from skelsplat.layouts import named
from skelsplat.synthetic.sets import Recording, RecordingSet

FORMAT = "skelsplat-simulated"
FORMAT_VERSION = 2
INDEX = "dataset.json"

# What is read of a take of one person, and of one of several: the keys in each file.
_NEEDED = {
    False: {
        "truth": ("poses", "boxes"),
        "detections_simulated_{}": ("detections",),
        "monocular_simulated": ("poses",),
    },
    True: {"truth": ("poses",), "people_simulated_{}": ("people", "owner")},
}


def read(
    root: Path, survey: Survey, *, detector: str = "good", views: int | Sequence[str] | None = None
) -> Dataset:
    """Read a simulated data set as a detector sees it, ``"good"`` or ``"noisy"``.

    `views` are the first so many cameras, or the names of some; None is all.
    """
    path = survey.find([root / INDEX], "index of a simulated data set")
    index = json_document(path, "the index of a simulated data set")
    for key, known in (("format", FORMAT), ("format_version", FORMAT_VERSION)):
        if index[key].value != known:
            raise index[key].error(known, index[key].shown)
    layout, detectors = named(index["layout"]), index["detectors"].names()
    if index["joints"].names() != list(layout.joints):
        raise index["joints"].error(f"those of {layout.name}", ", ".join(index["joints"].names()))
    if detector not in detectors:
        raise index["detectors"].error(" or ".join(detectors), f"{detector!r}")
    files = {name: root / "cameras" / f"{name}.json" for name in index["cameras"].names()}
    rigs = {name: read_cameras(survey.find([path], "cameras"), "json") for name, path in files.items()}
    fps = index["fps"].number() if "fps" in index else None
    takes: list[Take] = []
    scenes: list[PeopleTake] = []
    for entry in index["takes"].entries("a list of takes"):
        recording, own = _recording(survey, root / "takes", entry, detector)
        if recording.rig_name not in rigs:
            raise entry["cameras"].error(f"one of {', '.join(rigs)}", recording.rig_name)
        rig, own["cameras"] = rigs[recording.rig_name], files[recording.rig_name]
        places = range(len(rig)) if views is None else _places(rig, views)
        if "people" in entry:
            scenes.append(_people_take_of(recording, rig, detector, index["fps"].number(), own))
            scenes[-1] = scenes[-1].with_views(places)
            takes += scenes[-1].apart(recording.key)
        else:
            takes.append(take_of(recording, rig, detector, fps, own).with_views(places))
    name, seed = index["name"].text(), index.value.get("parameters", {}).get("seed")
    source = f"simulated poses and detections ({name}, detector {detector!r}, seed {seed}); no image was seen"
    return Dataset(name, layout, tuple(takes), f"simulated-{detector}", source, scenes=tuple(scenes))


def _recording(
    survey: Survey, folder: Path, entry: Field, detector: str
) -> tuple[Recording, dict[str, Path]]:
    """Return a take with one of its detectors, and its files; all have the same frames."""
    key, subject, action, rig_name = (entry[name].text() for name in ("key", "subject", "action", "cameras"))
    needed = {part.format(detector): keys for part, keys in _NEEDED["people" in entry].items()}
    parts = ("truth", "detections", "monocular")
    files = {part: folder / key / f"{stem}.npz" for part, stem in zip(parts, needed, strict=False)}
    survey.find_all((path, part) for part, path in files.items())
    loaded = [npz_fields(path) for path in files.values()]
    frames = frames_in(loaded[0])
    for content in loaded:
        if not np.array_equal(content["frames"].array(), frames):
            raise content["frames"].error(f"those of {files['truth'].name}", "others")
    named_arrays = zip(needed.items(), loaded, strict=True)
    arrays = {stem: {key: content[key].array() for key in keys} for (stem, keys), content in named_arrays}
    return Recording(key, subject, action, rig_name, frames, arrays), files


def take_of(
    recording: Recording,
    rig: CameraRig,
    detector: str,
    fps: float | None = None,
    files: Mapping[str, Path] = MappingProxyType({}),
) -> Take:
    """Return a simulated recording of one person, as one of the detectors sees it."""
    truth = recording.arrays["truth"]
    return Take(
        recording.key,
        recording.subject,
        recording.action,
        rig,
        recording.frames,
        truth["poses"],
        recording.arrays[f"detections_simulated_{detector}"]["detections"],
        monocular=recording.arrays["monocular_simulated"]["poses"],
        boxes=truth["boxes"],
        fps=fps,
        files=files,
    )


def _people_take_of(
    recording: Recording, rig: CameraRig, detector: str, fps: float, files: Mapping[str, Path]
) -> PeopleTake:
    """Return a simulated recording of several people; of two parts of a person the larger is the person's."""
    truth, seen = recording.arrays["truth"]["poses"], recording.arrays[f"people_simulated_{detector}"]
    people, owner = seen["people"], seen["owner"]
    if people.ndim != 5 or people.shape[:3] != owner.shape:
        raise DatasetError(files["detections"], "people", f"shape {(*owner.shape, 'N', 3)}", people.shape)
    return PeopleTake(
        recording.key,
        rig,
        recording.frames,
        people,
        truth,
        tuple(f"person{q}" for q in range(len(truth))),
        largest_slots(people, owner, len(truth)),
        fps,
        files=files,
    )


def _places(rig: CameraRig, views: int | Sequence[str]) -> list[int]:
    """Return the places of the chosen cameras, in the order chosen."""
    count, chosen = (views, rig.names[:views]) if isinstance(views, int) else (len(views), views)
    places = [rig.names.index(name) for name in chosen if name in rig.names]
    if not places or len(set(places)) != count:
        raise InvalidInputError(f"views: expected different cameras of {', '.join(rig.names)}, got {views!r}")
    return places


def write_simulated(root: Path, data: RecordingSet, *, openpose: bool = False) -> None:
    """Write a simulated data set, whole or not at all, to a folder that must not exist or be empty.

    With `openpose` the detections are written as OpenPose JSON too, one file per frame and camera.
    """
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise DatasetError(root, "output", "no folder or an empty one", "something in this place")
    temporary = root.with_name(f".{root.name}.{secrets.token_hex(6)}.tmp")
    try:
        with opening(root, "a folder that can be written", "output"):
            (temporary / "cameras").mkdir(parents=True)
            for name, rig in data.rigs.items():
                for ending in ("toml", "json"):
                    io.write_calibration(temporary / "cameras" / f"{name}.{ending}", rig)
            for recording in data.recordings:
                _write_take(temporary / "takes" / recording.key, recording, data, openpose=openpose)
            # The index comes last: without it a folder is no data set.
            text = json.dumps(_index_of(data), indent=1, ensure_ascii=False)
            (temporary / INDEX).write_text(text + "\n", encoding="utf-8")
            temporary.replace(root)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_take(folder: Path, recording: Recording, data: RecordingSet, *, openpose: bool) -> None:
    folder.mkdir(parents=True)
    for stem, arrays in recording.arrays.items():
        np.savez(folder / f"{stem}.npz", allow_pickle=False, frames=recording.frames, **arrays)
        kind, _, detector = stem.partition("_simulated_")
        if openpose and detector:
            people = arrays["people"] if kind == "people" else arrays["detections"][:, :, None]
            cameras = data.rigs[recording.rig_name].names
            _write_openpose(folder / f"openpose_simulated_{detector}", cameras, recording.frames, people)


def _write_openpose(folder: Path, cameras: Sequence[str], frames: Index, people: Array) -> None:
    """Write ``CAMERA/FRAME_keypoints.json`` of people (T, M, P, N, 3); missing joints are 0, 0, 0."""
    there = np.asarray(np.isfinite(people[..., 0]).any(axis=-1))
    values = np.nan_to_num(people).round(3)
    for view, camera in enumerate(cameras):
        (folder / camera).mkdir(parents=True)
        for t, frame in enumerate(frames.tolist()):
            rows = [row.ravel().tolist() for row in values[t, view, there[t, view]]]
            found = [{"person_id": [-1], "pose_keypoints_2d": row} for row in rows]
            text = json.dumps({"version": 1.3, "people": found})
            (folder / camera / f"{frame:012d}_keypoints.json").write_text(text, encoding="utf-8")


def _index_of(data: RecordingSet) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "name": data.name,
        "simulated": True,
        "unit": next(iter(data.rigs.values())).unit,
        "layout": data.layout.name,
        "joints": list(data.layout.joints),
        "detectors": sorted(data.parameters["detectors"]),
        "cameras": list(data.rigs),
        **({} if data.fps is None else {"fps": data.fps}),
        "takes": [
            {
                "key": recording.key,
                "subject": recording.subject,
                "action": recording.action,
                "cameras": recording.rig_name,
                "frames": len(recording.frames),
                **({} if recording.people is None else {"people": recording.people}),
            }
            for recording in data.recordings
        ],
        "parameters": data.parameters,
    }
