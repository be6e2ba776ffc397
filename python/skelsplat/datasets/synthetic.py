"""Simulated data sets, read and written; ``docs/synthetic-data.md`` describes the layout."""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from skelsplat import io
from skelsplat._arrays import Array, Index, Mask, largest_slots
from skelsplat._atomic import opening
from skelsplat._fields import Field
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import (
    MissingFileError,
    Survey,
    Value,
    build_camera,
    build_rig,
    load_json,
    load_npz,
)
from skelsplat.datasets._model import Dataset, PeopleTake, Take
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io.calibration._json import to_entry
from skelsplat.layouts import named

if TYPE_CHECKING:
    from skelsplat.synthetic.sets import RecordingSet

FORMAT = "skelsplat-simulated"
FORMAT_VERSION = 1
INDEX = "dataset.json"

Views: TypeAlias = int | Sequence[int | str] | None
"""The first so many cameras, or some of them by place or name, or (None) all."""


def read(root: Path, survey: Survey, *, detector: str = "good", views: Views = None) -> Dataset:
    """Read a simulated data set.

    Parameters
    ----------
    detector : str
        One of the index's detectors: ``"good"``, ``"noisy"``.
    views : int, sequence of int or str, or None
        The first so many cameras, or some by place or name; None is all.
    """
    index = _document(survey.find([root / INDEX], "index of a simulated data set"))
    for key, known in (("format", FORMAT), ("format_version", FORMAT_VERSION)):
        if index[key].value != known:
            raise index[key].error(known, index[key].shown)
    layout = named(index["layout"])
    joints = index["joints"].names()
    if joints != list(layout.joints):
        raise index["joints"].error(f"those of {layout.name}", ", ".join(joints))
    detectors = index["detectors"].names()
    if detector not in detectors:
        raise index["detectors"].error(f"the detector {detector!r}", ", ".join(detectors))
    files = {name: root / "cameras" / f"{name}.json" for name in index["cameras"].names()}
    rigs = {name: _rig(survey.find([path], "cameras")) for name, path in files.items()}
    fps = index["fps"].number() if "fps" in index else None

    def read_entry(entry: Field) -> Take | PeopleTake:
        cameras, key = entry["cameras"].text(), PurePosixPath(entry["key"].text())
        if cameras not in rigs:
            raise entry["cameras"].error(f"one of {', '.join(rigs)}", cameras)
        if key.is_absolute() or ".." in key.parts:
            raise entry["key"].error("a folder beneath takes", key)
        folder, rig, path = root / "takes" / key, rigs[cameras], files[cameras]
        if "people" in entry:
            rate = index["fps"].number()
            take: Take | PeopleTake = _scene(survey, folder, str(key), rig, path, layout, detector, rate)
        else:
            take = _take(survey, folder, entry, rig, path, layout, detector, fps)
        return take.with_views(_places(path, rig.names, views))

    found = list(survey.each(read_entry, index["takes"].entries("a list of takes")))
    scenes = tuple(take for take in found if isinstance(take, PeopleTake))
    takes = [
        one for take in found for one in (take.apart(take.key) if isinstance(take, PeopleTake) else (take,))
    ]
    name, seed = index["name"].text(), index.value.get("parameters", {}).get("seed")
    source = f"simulated poses and detections ({name}, detector {detector!r}, seed {seed}); no image was seen"
    return Dataset(name, layout, tuple(takes), f"simulated-{detector}", source, scenes=scenes)


def _document(path: Path) -> Field:
    return Field(path, "", load_json(path).content)


def _rig(path: Path) -> CameraRig:
    document = _document(path)
    cameras = []
    for entry in document["cameras"].entries("a list of cameras"):
        width, height = entry["size"].numbers((2,))
        camera = build_camera(
            path,
            entry.place,
            K=entry["K"].numbers((3, 3)),
            R=entry["R"].numbers((3, 3)),
            t=entry["t"].numbers((3,)),
            distortion=entry["distortion"].numbers(None),
            size=(int(width), int(height)),
            name=entry["name"].text(),
        )
        cameras.append(camera)
    return build_rig(path, cameras, document["unit"].text())


def _loaded(survey: Survey, files: Mapping[str, Path]) -> tuple[Index, dict[str, Value]]:
    """Return the frame numbers and the content of a take's files; all have the same frames."""
    lost: list[MissingFileError] = []
    for part, path in files.items():
        if not path.exists():
            lost.append(survey.lacks([path], part))
    if lost:
        raise lost[0]
    loaded = {part: load_npz(survey.found(path)) for part, path in files.items()}
    frames = loaded["truth"]["frames"].frames()
    for content in loaded.values():
        other = np.asarray(content["frames"].content)
        if not np.array_equal(other, frames):
            expected = f"those of {files['truth'].name} ({len(frames)} from {frames[:1]} to {frames[-1:]})"
            actual = f"{other.size} from {other.ravel()[:1]} to {other.ravel()[-1:]}"
            raise content["frames"].error(expected, actual)
    return frames, loaded


def _take(
    survey: Survey,
    folder: Path,
    entry: Field,
    rig: CameraRig,
    cameras: Path,
    layout: Layout,
    detector: str,
    fps: float | None,
) -> Take:
    key, subject, action = (entry[name].text() for name in ("key", "subject", "action"))
    files = {
        "truth": folder / "truth.npz",
        "detections": folder / f"detections_simulated_{detector}.npz",
        "monocular": folder / "monocular_simulated.npz",
    }
    frames, loaded = _loaded(survey, files)
    truth, detections = loaded["truth"], loaded["detections"]["detections"]
    t, m, n = len(frames), len(rig), layout.n_joints
    shapes = [np.shape(one.content) for one in (truth["boxes"], detections)]
    views = {shape[1] if len(shape) > 1 else None for shape in shapes}
    if len(views) == 1 and views.isdisjoint({m, None}):  # boxes and detections agree with each other
        raise DatasetError(cameras, "cameras", f"{views.pop()} cameras, one per view of the takes", m)
    return Take(
        key=key,
        subject=subject,
        action=action,
        rig=rig,
        frames=frames,
        truth=truth["poses"].numbers(t, n, 3),
        detections=detections.numbers(t, m, n, 3),
        monocular=loaded["monocular"]["poses"].numbers(t, m, n, 3),
        boxes=truth["boxes"].numbers(t, m, 4),
        visible=truth["visible"].numbers(t, m, n).astype(bool) if "visible" in truth else None,
        fps=fps,
        files={**files, "cameras": cameras},
    )


def _scene(
    survey: Survey,
    folder: Path,
    key: str,
    rig: CameraRig,
    cameras: Path,
    layout: Layout,
    detector: str,
    fps: float,
) -> PeopleTake:
    files = {"truth": folder / "truth.npz", "detections": folder / f"people_simulated_{detector}.npz"}
    frames, loaded = _loaded(survey, files)
    t, m, n = len(frames), len(rig), layout.n_joints
    truth = loaded["truth"]["poses"].numbers("Q", t, n, 3)
    people = loaded["detections"]["people"].numbers(t, m, "P", n, 3)
    whose = loaded["detections"]["owner"]
    owner = whose.numbers(t, m, people.shape[2])
    if not (np.isfinite(owner) & (owner == np.rint(owner))).all():
        raise whose.error("whole numbers", "others")
    return PeopleTake(
        key=key,
        rig=rig,
        frames=frames,
        people=people,
        truth=truth,
        names=tuple(f"person{q}" for q in range(len(truth))),
        slots=largest_slots(people, owner, len(truth)),
        fps=fps,
        files={**files, "cameras": cameras},
    )


def _places(path: Path, names: Sequence[str], views: Views) -> list[int]:
    """Return the places of the chosen cameras among `names`, which `path` lists, in the order chosen."""
    if views is None:
        return list(range(len(names)))
    if isinstance(views, int):
        views = list(range(views))
    chosen = [_place(path, names, view) for view in views]
    if not chosen or len(set(chosen)) < len(chosen):
        raise InvalidInputError(f"views: expected at least one camera and none twice, got {list(views)}")
    return chosen


def _place(path: Path, names: Sequence[str], view: int | str) -> int:
    there = f"{len(names)} ({', '.join(names)})"
    if isinstance(view, str):
        if view not in names:
            raise DatasetError(path, "cameras", f"camera {view!r}", there)
        return names.index(view)
    if not 0 <= view < len(names):
        raise DatasetError(path, "cameras", f"at least {view + 1} cameras", there)
    return view


def write_simulated(
    root: Path, data: RecordingSet[Any], *, openpose: bool = False, force: bool = False
) -> None:
    """Write a simulated data set to the folder `root`, whole or not at all.

    Parameters
    ----------
    root : Path
        Must not exist, or be empty.
    data : RecordingSet
        As `skelsplat.synthetic.simulate_set` or `simulate_people_set` makes it.
    openpose : bool
        Write the detections as OpenPose JSON too, one file per frame and camera.
    force : bool
        Replace a simulated data set that is there. Anything else is never replaced.

    Raises
    ------
    DatasetError
        If there is something at `root`, or it cannot be written.
    """
    _check_free(root, force=force)
    temporary = root.with_name(f".{root.name}.{secrets.token_hex(6)}.tmp")
    try:
        with opening(root, "a folder that can be written", "output"):
            temporary.mkdir(parents=True)
            _write_parts(temporary, data, openpose=openpose)
            # The index comes last: without it a folder is no data set.
            text = json.dumps(_index_of(data), indent=1, ensure_ascii=False)
            (temporary / INDEX).write_text(text + "\n", encoding="utf-8")
            _move(temporary, root)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_parts(folder: Path, data: RecordingSet[Any], *, openpose: bool) -> None:
    """Write cameras and takes."""
    (folder / "cameras").mkdir()
    for name, rig in data.rigs.items():
        io.write_calibration(folder / "cameras" / f"{name}.toml", rig)
        entries = [{"name": camera.name, **to_entry(camera)} for camera in rig]
        cameras = [{**entry, "distortion": entry["distortion"] or []} for entry in entries]
        document = {"unit": rig.unit, "cameras": cameras}
        text = json.dumps(document, indent=1) + "\n"
        (folder / "cameras" / f"{name}.json").write_text(text, encoding="utf-8")
    for recording in data.recordings:
        take = folder / "takes" / recording.key
        take.mkdir(parents=True)
        for stem, arrays in recording.parts().items():
            np.savez(take / f"{stem}.npz", frames=recording.frames, **arrays)
        for detector, people in recording.people().items() if openpose else ():
            _write_openpose(take, detector, data.rigs[recording.rig_name].names, recording.frames, people)


def _write_openpose(
    take: Path, detector: str, cameras: Sequence[str], frames: Index, people: tuple[Array, Mask]
) -> None:
    """Write ``openpose_simulated_DETECTOR/CAMERA/FRAME_keypoints.json``; missing joints are 0, 0, 0.

    Of people (T, M, P, N, 3) those who are there (T, M, P).
    """
    values, there = np.nan_to_num(people[0]).round(3), people[1]
    for view, camera in enumerate(cameras):
        target = take / f"openpose_simulated_{detector}" / camera
        target.mkdir(parents=True)
        for t, frame in enumerate(frames.tolist()):
            rows = [row.ravel().tolist() for row in values[t, view, there[t, view]]]
            found = [{"person_id": [-1], "pose_keypoints_2d": row} for row in rows]
            text = json.dumps({"version": 1.3, "people": found})
            (target / f"{frame:012d}_keypoints.json").write_text(text, encoding="utf-8")


def _index_of(data: RecordingSet[Any]) -> dict[str, Any]:
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
                **recording.about,
            }
            for recording in data.recordings
        ],
        "parameters": data.parameters,
    }


def _check_free(root: Path, *, force: bool) -> None:
    if not root.exists():
        return
    if not root.is_dir():
        raise DatasetError(root, "output", "a folder", "a file")
    if not any(root.iterdir()):
        return
    if not force:
        raise DatasetError(
            root, "output", "no folder or an empty one (force replaces a simulated set)", "files in it"
        )
    try:
        known = load_json(root / INDEX)["format"].content == FORMAT
    except DatasetError:
        known = False
    if not known:
        raise DatasetError(root, "output", "a simulated data set to replace", "files of something else")


def _move(temporary: Path, root: Path) -> None:
    """Put the finished folder in its place; an older one is out of the way before, and removed after."""
    if not root.exists():
        temporary.replace(root)
        return
    old = root.with_name(f".{root.name}.{secrets.token_hex(6)}.old")
    root.replace(old)
    temporary.replace(root)
    shutil.rmtree(old)
