"""Simulated data sets, read and written; ``docs/synthetic-data.md`` describes the layout."""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from skelsplat import io
from skelsplat._arrays import Array
from skelsplat._atomic import opening
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import Survey, load_json, load_npz, numbers, require
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets._people import PeopleTake
from skelsplat.datasets._rig import build_camera, build_rig
from skelsplat.datasets._synthetic_people import (
    files_of,
    frames_of,
    index_of,
    read_scene,
    write_openpose,
    write_scenes,
)
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._fields import Field
from skelsplat.io.calibration._json import to_entry

if TYPE_CHECKING:
    from skelsplat.synthetic.people_sets import SceneSet
    from skelsplat.synthetic.sets import Recording, RecordingSet

FORMAT, FORMAT_VERSION = "skelsplat-simulated", 1
INDEX = "dataset.json"

Views: TypeAlias = int | Sequence[int | str] | None
"""The first so many cameras, or some of them by place or name, or (None) all."""

DESCRIPTION = "Simulated data sets that `skelsplat synth` writes."


def read(root: Path, *, detector: str = "good", views: Views = None) -> Dataset:
    """Read a simulated data set.

    Parameters
    ----------
    root : Path
    detector : str
        One of the index's detectors: ``"good"``, ``"noisy"``.
    views : int, sequence of int or str, or None
        The first so many cameras, or some by place or name; None is all.

    Raises
    ------
    DatasetError
        If a file is missing or malformed; names the file and the field.
    """
    index = _index(root)
    layout = _layout(index)
    known = index["detectors"].names()
    if detector not in known:
        raise index["detectors"].error(f"the detector {detector!r}", ", ".join(known))
    rigs = {name: _rig(root / "cameras" / f"{name}.json") for name in index["cameras"].names()}
    entries = index["takes"].entries("a list of takes")
    fps = index["fps"].number() if "fps" in index else None
    takes: list[Take] = []
    scenes: list[PeopleTake] = []
    for entry in entries:
        (rig, path), folder = _named_rig(root, entry, rigs), _folder(root, entry)
        if "people" in entry:
            rate = index["fps"].number()
            scene = read_scene(folder, entry["key"].text(), rig, path, layout, detector, rate)
            scenes.append(scene.with_views(_places(path, rig.names, views)))
            takes += scenes[-1].apart(scene.key)
        else:
            take = replace(_take(folder, entry, rig, path, layout, detector), fps=fps)
            takes.append(take.with_views(_places(path, rig.names, views)))
    name, seed = index["name"].text(), index.value.get("parameters", {}).get("seed")
    source = f"simulated poses and detections ({name}, detector {detector!r}, seed {seed}); no image was seen"
    return Dataset(
        name, layout, tuple(takes), detector=f"simulated-{detector}", source=source, scenes=tuple(scenes)
    )


def survey(root: Path, options: Mapping[str, Any]) -> Survey:
    """Say which files are there, with the options of `read`."""
    found = Survey()
    found.look([root / INDEX], "index of a simulated data set")
    if found.missing:
        return found
    index = _index(root)
    for name in index["cameras"].names():
        found.look([root / "cameras" / f"{name}.json"], "cameras")
    for entry in index["takes"].entries("a list of takes"):
        folder = _folder(root, entry)
        if "people" in entry:
            for part, path in files_of(folder, options["detector"]).items():
                found.look([path], part)
            continue
        for stem in ("truth", f"detections_simulated_{options['detector']}", "monocular_simulated"):
            found.look([folder / f"{stem}.npz"], stem.replace("_", " "))
    return found


def _index(root: Path) -> Field:
    index = Field(root / INDEX, "", load_json(root / INDEX))
    for key, known in (("format", FORMAT), ("format_version", FORMAT_VERSION)):
        if index[key].value != known:
            raise index[key].error(known, index[key].shown)
    return index


def _layout(index: Field) -> Layout:
    layout = index["layout"].layout()
    joints = index["joints"].names()
    if joints != list(layout.joints):
        raise index["joints"].error(f"those of {layout.name}", ", ".join(joints))
    return layout


def _rig(path: Path) -> CameraRig:
    document = Field(path, "", load_json(path))
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


def _folder(root: Path, entry: Field) -> Path:
    key = PurePosixPath(entry["key"].text())
    if key.is_absolute() or ".." in key.parts:
        raise entry["key"].error("a folder beneath takes", key)
    return root / "takes" / key


def _named_rig(root: Path, entry: Field, rigs: Mapping[str, CameraRig]) -> tuple[CameraRig, Path]:
    """Return the cameras of a take and their file."""
    cameras = entry["cameras"].text()
    if cameras not in rigs:
        raise entry["cameras"].error(f"one of {', '.join(rigs)}", cameras)
    return rigs[cameras], root / "cameras" / f"{cameras}.json"


def _take(folder: Path, entry: Field, rig: CameraRig, cameras: Path, layout: Layout, detector: str) -> Take:
    key, subject, action = (entry[name].text() for name in ("key", "subject", "action"))
    files = {
        "truth": folder / "truth.npz",
        "detections": folder / f"detections_simulated_{detector}.npz",
        "monocular": folder / "monocular_simulated.npz",
        "cameras": cameras,
    }
    loaded = {part: load_npz(path) for part, path in files.items() if part != "cameras"}
    frames = frames_of(files, loaded)
    t, m, n = len(frames), len(rig), layout.n_joints

    def part(name: str, key: str, shape: tuple[int, ...]) -> Array:
        return numbers(files[name], key, require(files[name], "", loaded[name], key), shape)

    per_view = (loaded["truth"].get("boxes"), loaded["detections"].get("detections"))
    shapes = [np.asarray(array).shape for array in per_view]
    views = {shape[1] if len(shape) > 1 else None for shape in shapes}
    if len(views) == 1 and views.isdisjoint({m, None}):  # boxes and detections agree with each other
        expected = f"{views.pop()} cameras, one per view of the takes"
        raise DatasetError(files["cameras"], "cameras", expected, m)
    visible = loaded["truth"].get("visible")
    if visible is not None:
        visible = numbers(files["truth"], "visible", visible, (t, m, n)).astype(bool)
    return Take(
        key=key,
        subject=subject,
        action=action,
        rig=rig,
        frames=frames,
        truth=part("truth", "poses", (t, n, 3)),
        detections=part("detections", "detections", (t, m, n, 3)),
        monocular=part("monocular", "poses", (t, m, n, 3)),
        boxes=part("truth", "boxes", (t, m, 4)),
        visible=visible,
        files=files,
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
    root: Path, data: RecordingSet | SceneSet, *, openpose: bool = False, force: bool = False
) -> None:
    """Write a simulated data set to the folder `root`, whole or not at all.

    Parameters
    ----------
    root : Path
        Must not exist, or be empty.
    data : RecordingSet or SceneSet
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
            own = _write_parts(temporary, data, openpose=openpose)
            # The index comes last: without it a folder is no data set.
            about = {"format": FORMAT, "format_version": FORMAT_VERSION, "name": data.name, "simulated": True}
            text = json.dumps({**about, **own}, indent=1, ensure_ascii=False)
            (temporary / INDEX).write_text(text + "\n", encoding="utf-8")
            _move(temporary, root)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_parts(folder: Path, data: RecordingSet | SceneSet, *, openpose: bool) -> dict[str, Any]:
    """Write cameras and takes; return what the index says of them."""
    from skelsplat.synthetic.people_sets import SceneSet  # loads the simulation, which reading does without

    if isinstance(data, SceneSet):
        _write_rigs(folder / "cameras", {data.rig_name: data.first.cameras})
        write_scenes(folder / "takes", data, openpose=openpose)
        return index_of(data)
    _write_rigs(folder / "cameras", data.rigs)
    for recording in data.recordings:
        take = folder / "takes" / recording.key
        _write_take(take, recording)
        for name, detections in recording.detections.items() if openpose else ():
            names, there = (
                data.rigs[recording.rig_name].names,
                np.ones((*detections.shape[:2], 1), dtype=bool),
            )
            write_openpose(take, name, names, recording.frames, detections[:, :, None], there)
    return _index_of(data)


def _check_free(root: Path, *, force: bool) -> None:
    if not root.exists():
        return
    if not root.is_dir():
        raise DatasetError(root, "output", "a folder", "a file")
    if not any(root.iterdir()):
        return
    if not force:
        raise DatasetError(root, "output", "no folder or an empty one (--force replaces)", "files in it")
    try:
        known = load_json(root / INDEX)["format"] == FORMAT
    except (DatasetError, KeyError, TypeError):
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


def _index_of(data: RecordingSet) -> dict[str, Any]:
    detectors = sorted({name for recording in data.recordings for name in recording.detections})
    return {
        "unit": next(iter(data.rigs.values())).unit,
        "layout": data.layout.name,
        "joints": list(data.layout.joints),
        "detectors": detectors,
        "cameras": list(data.rigs),
        "takes": [
            {
                "key": recording.key,
                "subject": recording.subject,
                "action": recording.action,
                "cameras": recording.rig_name,
                "frames": len(recording.frames),
            }
            for recording in data.recordings
        ],
        "parameters": data.parameters,
    }


def _write_rigs(folder: Path, rigs: Mapping[str, CameraRig]) -> None:
    folder.mkdir()
    for name, rig in rigs.items():
        io.write_calibration(folder / f"{name}.toml", rig)
        entries = [{"name": camera.name, **to_entry(camera)} for camera in rig]
        cameras = [{**entry, "distortion": entry["distortion"] or []} for entry in entries]
        document = {"unit": rig.unit, "cameras": cameras}
        (folder / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _write_take(folder: Path, recording: Recording) -> None:
    folder.mkdir(parents=True)
    truth: dict[str, Any] = {"poses": recording.truth, "boxes": recording.boxes}
    if recording.visible is not None:
        truth["visible"] = recording.visible
    parts: dict[str, dict[str, Any]] = {"truth": truth, "monocular_simulated": {"poses": recording.monocular}}
    for name, detections in recording.detections.items():
        parts[f"detections_simulated_{name}"] = {"detections": detections}
    for stem, arrays in parts.items():
        np.savez(folder / f"{stem}.npz", frames=recording.frames, **arrays)
