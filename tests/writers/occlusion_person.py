"""Occlusion-Person as the SkelSplat authors keep it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from writers.people import FloatArray, at_centre, person

LAYOUT = sk.layouts.OCCLUSION_PERSON15
ACTIVITY = "validation 1"


@dataclass(frozen=True)
class Written:
    """Frames in the order of the files: truth (G, 15, 3) mm, and detections of 8 cameras."""

    truth: FloatArray
    detections: FloatArray
    per_scene: int


def write(root: Path, *, per_camera: bool = False, per_scene: int = 6) -> Written:
    """Write two scenes, whose cameras differ, and detections of ResNet-50."""
    scenes = [
        person(LAYOUT, synthetic.ring(8, radius_mm=3200.0 + 400.0 * k), per_scene, motion=kind, seed=k)
        for k, kind in enumerate(("walk", "reach"))
    ]
    cameras = [[at_centre(camera) for camera in scene.rig] for scene in scenes for _ in scene.truth]
    (root / "cameras").mkdir(parents=True)
    (root / "cameras" / "cameras.json").write_text(json.dumps(dict(enumerate(cameras))))
    truth = np.concatenate([scene.truth for scene in scenes])
    detections = np.concatenate([scene.detections for scene in scenes])
    folder, target = root / "3d_gt" / "S0" / ACTIVITY, root / "2d_resnet50" / "S0" / ACTIVITY
    folder.mkdir(parents=True)
    np.savez(folder / "poses.npz", poses3d=truth)
    for camera in range(8) if per_camera else ():
        (target / str(camera)).mkdir(parents=True)
        values = detections[:, camera]
        np.savez(target / str(camera) / "poses.npz", poses2d=values[..., :2], scores=values[..., 2])
    if not per_camera:
        target.mkdir(parents=True)
        np.savez(target / "poses.npz", poses2d=detections)
    return Written(truth, detections, per_scene)
