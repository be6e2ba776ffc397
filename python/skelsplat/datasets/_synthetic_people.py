"""Simulated scenes of several people on disk: a folder per scene, as ``docs/synthetic-data.md`` describes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import load_npz, numbers, require
from skelsplat.datasets._people import PeopleTake
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import frame_numbers

if TYPE_CHECKING:
    from skelsplat.synthetic.people_sets import SceneSet


def files_of(folder: Path, detector: str) -> dict[str, Path]:
    """Return the files of a scene that `read_scene` opens."""
    return {"truth": folder / "truth.npz", "detections": folder / f"people_simulated_{detector}.npz"}


def read_scene(
    folder: Path, key: str, rig: CameraRig, cameras: Path, layout: Layout, detector: str, fps: float
) -> PeopleTake:
    """Read a scene; `cameras` is the file of the rig.

    Raises `DatasetError` if a file is missing or malformed.
    """
    files = files_of(folder, detector)
    loaded = {part: load_npz(path) for part, path in files.items()}

    def part(file: str, name: str, shape: tuple[int | str, ...]) -> Array:
        return numbers(files[file], name, require(files[file], "", loaded[file], name), shape)

    frames = frames_of(files, loaded)
    t, m, n = len(frames), len(rig), layout.n_joints
    truth = part("truth", "poses", ("Q", t, n, 3))
    people = part("detections", "people", (t, m, "P", n, 3))
    owner = part("detections", "owner", (t, m, people.shape[2]))
    if not (np.isfinite(owner) & (owner == np.rint(owner))).all():
        raise DatasetError(files["detections"], "owner", "whole numbers", "others")
    return PeopleTake(
        key=key,
        rig=rig,
        frames=frames,
        people=people,
        truth=truth,
        names=tuple(f"person{q}" for q in range(len(truth))),
        slots=_slots(people, owner, len(truth)),
        fps=fps,
        files={**files, "cameras": cameras},
    )


def frames_of(files: Mapping[str, Path], loaded: Mapping[str, dict[str, Any]]) -> Index:
    """Return the frame numbers of the truth; those of the other files have to be the same."""
    frames = frame_numbers(files["truth"], require(files["truth"], "", loaded["truth"], "frames"))
    for name, arrays in loaded.items():
        other = np.asarray(require(files[name], "", arrays, "frames"))
        if not np.array_equal(other, frames):
            expected = f"those of {files['truth'].name} ({len(frames)} from {frames[:1]} to {frames[-1:]})"
            actual = f"{other.size} from {other.ravel()[:1]} to {other.ravel()[-1:]}"
            raise DatasetError(files[name], "frames", expected, actual)
    return frames


def _slots(people: Array, owner: Array, n_people: int) -> Index:
    """Place in P of each person, (Q, T, M); −1 = none. Of two parts of a person the larger."""
    joints = np.isfinite(people[..., 0]).sum(axis=-1)
    own = (owner == np.arange(n_people)[:, None, None, None]) & (joints > 0)
    place: Index = np.where(own, joints, 0).argmax(axis=-1)
    return np.where(own.any(axis=-1), place, -1)


def write_scenes(takes: Path, data: SceneSet, *, openpose: bool) -> None:
    """Write the scenes to folders beneath `takes`."""
    for key, seen in data.scenes.items():
        folder = takes / key
        folder.mkdir(parents=True)
        for detector, scene in seen.items():
            files = files_of(folder, detector)
            frames = np.arange(len(scene.people))
            whose = {"owner": scene.owner, "joint_owner": scene.joint_owner}
            owners: dict[str, Any] = {name: array.astype(np.int16) for name, array in whose.items()}
            np.savez(files["detections"], frames=frames, people=scene.people, **owners)
            if openpose:
                there = np.asarray(np.isfinite(scene.people[..., 0]).any(axis=-1))
                write_openpose(folder, detector, scene.cameras.names, frames, scene.people, there)
        own: dict[str, Any] = {"poses": scene.truth, "visible": scene.visible}
        np.savez(files["truth"], frames=frames, **own)


def write_openpose(
    take: Path, detector: str, cameras: Sequence[str], frames: Index, people: Array, there: Mask
) -> None:
    """Write ``openpose_simulated_DETECTOR/CAMERA/FRAME_keypoints.json``; missing joints are 0, 0, 0.

    Of people (T, M, P, N, 3) those who are ``there`` (T, M, P).
    """
    values = np.nan_to_num(people).round(3)
    for view, camera in enumerate(cameras):
        target = take / f"openpose_simulated_{detector}" / camera
        target.mkdir(parents=True)
        for t, frame in enumerate(frames.tolist()):
            rows = [row.ravel().tolist() for row in values[t, view, there[t, view]]]
            found = [{"person_id": [-1], "pose_keypoints_2d": row} for row in rows]
            text = json.dumps({"version": 1.3, "people": found})
            (target / f"{frame:012d}_keypoints.json").write_text(text, encoding="utf-8")


def index_of(data: SceneSet) -> dict[str, Any]:
    """Return what the index says of the set beside its format."""
    first = data.first
    takes: list[Mapping[str, Any]] = [
        {
            "key": key,
            "subject": key,
            "action": "people",
            "cameras": data.rig_name,
            "frames": len(first.people),
            "people": len(first.truth),
        }
        for key in data.scenes
    ]
    return {
        "unit": first.cameras.unit,
        "layout": first.layout.name,
        "joints": list(first.layout.joints),
        "detectors": sorted(data.parameters["detectors"]),
        "cameras": [data.rig_name],
        "fps": first.fps,
        "takes": takes,
        "parameters": data.parameters,
    }
