"""Occlusion-Person as AdaFuse reads it (pickle), and as the SkelSplat authors keep it (npz and JSON)."""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from writers.people import FloatArray, Person, at_centre, image_record, person

LAYOUT = sk.layouts.OCCLUSION_PERSON15


@dataclass(frozen=True)
class Written:
    """Frames in the order of the files: truth (G, 15, 3) mm, detections and visible joints of 8 cameras."""

    truth: FloatArray
    detections: FloatArray
    visible: np.ndarray
    per_scene: int


def write(root: Path, *, layout: str = "adafuse", per_camera: bool = False, per_scene: int = 6) -> Written:
    """Write two scenes, whose cameras differ, and detections of ResNet-50."""
    scenes = [
        person(LAYOUT, synthetic.ring(8, radius_mm=3200.0 + 400.0 * k), per_scene, motion=kind, seed=k)
        for k, kind in enumerate(("walk", "reach"))
    ]
    detections = np.concatenate([scene.detections for scene in scenes])
    visible = np.random.default_rng(0).random(detections.shape[:-1]) < 0.8
    if layout == "adafuse":
        folder, activity = root / "unrealcv" / "annot", "validation"
        folder.mkdir(parents=True)
        save(folder / "unrealcv_validation.pkl", _records(scenes, visible))
    else:
        activity = "validation 1"
        _write_authors(root, activity, scenes)
    target = root / "2d_resnet50" / "S0" / activity
    if per_camera:
        for camera in range(8):
            (target / str(camera)).mkdir(parents=True)
            values = detections[:, camera]
            np.savez(target / str(camera) / "poses.npz", poses2d=values[..., :2], scores=values[..., 2])
    else:
        target.mkdir(parents=True)
        np.savez(target / "poses.npz", poses2d=detections)
    return Written(np.concatenate([scene.truth for scene in scenes]), detections, visible, per_scene)


def pickle_path(root: Path) -> Path:
    """Where `write` puts the pickle."""
    return root / "unrealcv" / "annot" / "unrealcv_validation.pkl"


def load(root: Path) -> Any:
    """Return the records that `write` put there."""
    with pickle_path(root).open("rb") as stream:
        return pickle.load(stream)


def save(path: Path, value: object) -> None:
    """Pickle as Python 2 did."""
    with path.open("wb") as stream:
        pickle.dump(value, stream, protocol=2)


def _records(scenes: list[Person], visible: np.ndarray) -> list[dict[str, Any]]:
    records, row = [], 0
    for k, scene in enumerate(scenes):
        exact = np.moveaxis(np.asarray(sk.project(scene.truth, scene.rig)), 0, 1)
        for t, truth in enumerate(scene.truth):
            for m, camera in enumerate(scene.rig):
                record = image_record(camera, exact[t, m], (k, 1, 1), t, m)
                flags = np.repeat(visible[row, m][:, None], 2, axis=1).astype(np.float64)
                records.append({**record, "joints_gt": truth, "joints_vis_2d": flags})
            row += 1
    return records


def _write_authors(root: Path, activity: str, scenes: list[Person]) -> None:
    cameras: dict[str, object] = {}
    for scene in scenes:
        for _ in range(len(scene.truth)):
            cameras[str(len(cameras))] = [at_centre(camera) for camera in scene.rig]
    (root / "cameras").mkdir(parents=True)
    (root / "cameras" / "cameras.json").write_text(json.dumps(cameras))
    folder = root / "3d_gt" / "S0" / activity
    folder.mkdir(parents=True)
    np.savez(folder / "poses.npz", poses3d=np.concatenate([scene.truth for scene in scenes]))
