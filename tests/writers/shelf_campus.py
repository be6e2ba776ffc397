"""Shelf and Campus: VoxelPose's calibration, ``actorsGT.mat``, and detections per actor."""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import savemat

import skelsplat as sk
from skelsplat import synthetic
from writers.people import FloatArray, at_centre, person

LAYOUT = sk.layouts.SHELF14
SIZES = {"shelf": (1032, 776), "campus": (360, 288)}
N_CAMERAS = {"shelf": 5, "campus": 3}
N_ACTORS = {"shelf": 4, "campus": 3}
LENS = (-0.05, 0.02, 0.0003, -0.0001, 0.0)


@dataclass(frozen=True)
class Written:
    """Truth (T, 14, 3) mm and detections (T, M, 14, 3) of each actor; actor k is absent before frame k."""

    truth: list[FloatArray]
    detections: list[FloatArray]


def rig_of(name: str) -> sk.CameraRig:
    """Return cameras round the scene with its image size."""
    width, height = SIZES[name]
    ring = synthetic.ring(N_CAMERAS[name], radius_mm=5000.0)
    factor = width / ring[0].size[0]
    K = np.array([[640 * factor, 0, width / 2], [0, 640 * factor, height / 2], [0, 0, 1.0]])
    return sk.CameraRig(
        [
            sk.Camera(K, c.R, c.t, distortion=LENS, size=(width, height), name=str(k))
            for k, c in enumerate(ring)
        ]
    )


def write(root: Path, name: str, *, n_frames: int = 6, coco: bool = False, nested: bool = False) -> Written:
    """Write people apart from each other; `coco`: COCO-17 detections; `nested`: cells of actors in a cell."""
    _write_cameras(root, name)
    rig, layouts = rig_of(name), (LAYOUT, sk.layouts.COCO17 if coco else LAYOUT)
    people, seen = (
        [
            person(layout, rig, n_frames, motion="turn", seed=k, at=(1200.0 * (k % 2), 1200.0 * (k // 2)))
            for k in range(N_ACTORS[name])
        ]
        for layout in layouts
    )
    write_actors(root / "actorsGT.mat", [who.truth / 1000.0 for who in people], nested=nested)
    _write_people(root, np.stack([who.detections for who in seen], axis=2), np.arange(n_frames))
    return Written(
        [who.truth[k:] for k, who in enumerate(people)], [p.detections[k:] for k, p in enumerate(people)]
    )


def _write_cameras(root: Path, name: str) -> None:
    root.mkdir(parents=True, exist_ok=True)
    calibration = {str(k): at_centre(camera) for k, camera in enumerate(rig_of(name))}
    (root / f"calibration_{name}.json").write_text(json.dumps(calibration))


def _write_people(root: Path, people: FloatArray, frames: np.ndarray) -> None:
    folder = root / "2d_hrnet" / "S0"
    folder.mkdir(parents=True)
    np.savez(folder / "people.npz", people=people, frames=frames)


FIRST = {"shelf": 300, "campus": 350}


def write_everybody(
    root: Path, name: str, *, form: str = "npz", n_frames: int = 60, seed: int = 0
) -> synthetic.Scene:
    """Write people who meet, from the first frame that counts; nothing says who is who.

    `form` "npz" has the 14 joints, "pickle" is that of VoxelPose with 17. Returns the scene in 14 joints.
    """
    _write_cameras(root, name)
    rig, first = rig_of(name), FIRST[name]
    own, coco = (
        synthetic.simulate_scene(N_ACTORS[name], rig, n_frames=n_frames, fps=25.0, layout=layout, seed=seed)
        for layout in (LAYOUT, "coco17")
    )
    unlabelled = np.full((first, *own.truth.shape[2:]), np.nan)
    truth = [np.concatenate([unlabelled, poses / 1000.0]) for poses in own.truth]
    write_actors(root / "actorsGT.mat", truth)
    if form == "npz":
        _write_people(root, own.people, first + np.arange(n_frames))
        return own
    found = {}
    for view in range(len(rig)):
        for frame, people in enumerate(np.nan_to_num(coco.people[:, view])):
            entries = [{"pred": pose.tolist()} for pose in people if pose[:, 2].any()]
            found[f"{view}_{first + frame}"] = entries
    (root / f"pred_{name}_maskrcnn_hrnet_coco.pkl").write_bytes(pickle.dumps(found))
    return own


def write_actors(path: Path, truth: list[FloatArray], *, nested: bool = False) -> None:
    """Write cells of actors, of frames, of joints in metres; actor k is not labelled before frame k."""
    actors = np.empty((1, len(truth)), dtype=object)
    for k, poses in enumerate(truth):
        cell = np.empty((len(poses), 1), dtype=object)
        for t, pose in enumerate(poses):
            cell[t, 0] = pose if t >= k and np.isfinite(pose).all() else np.zeros((1, 1))
        actors[0, k] = cell
    if nested:
        outer = np.empty((1, 1), dtype=object)
        outer[0, 0] = actors
        actors = outer
    savemat(path, {"actor3D": actors})
