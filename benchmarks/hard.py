"""Scenes that hurt: noise that lasts, detectors that follow, people who stand still or repeat themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import recordings
from scenarios import FloatArray, Scene

import skelsplat as sk
from skelsplat import layouts, synthetic
from skelsplat.synthetic.skeleton import ANKLE_HEIGHT_MM, forward_kinematics

FPS, FRAMES = 30.0, 300
BODY = layouts.H36M17
ANKLES, WRIST, WRISTS = [3, 6], 13, [13, 16]


@dataclass(frozen=True)
class Drawn:
    """How many recordings a case has, and their seed."""

    takes: int
    seed: int

    def scenes(self, condition: str = "good") -> list[Scene]:
        """Return recordings of ten seconds."""
        every = recordings.motions()
        long = [name for name in sorted(every) if len(every[name]) >= FRAMES]
        names = recordings.sample(long, self.takes, self.seed)
        given = {"names": names, "seed": self.seed, "most_frames": FRAMES, "confidence": False}
        return [take.scene for take in recordings.takes(condition, **given)]

    def rng(self, *key: int) -> np.random.Generator:
        """Return the random numbers of a part of a case."""
        return np.random.default_rng([self.seed, *key])


def seen(poses: FloatArray, rig: Sequence[sk.Camera], seed: int, factor: float = 1.0) -> FloatArray:
    """Return the detections of poses (T, 17, 3) mm by a detector with errors that last."""
    noise = synthetic.DetectionNoise.recording(FPS).scaled(factor)
    found = synthetic.simulate_detections(poses, rig, noise=noise, layout=BODY, seed=seed)
    found[..., 2] = np.where(np.isfinite(found[..., 0]), 1.0, 0.0)
    return found


def moved(scene: Scene, by: FloatArray, joints: Sequence[int] | slice = slice(None)) -> Scene:
    """Return the scene with pixels added to the detections of some joints."""
    detections = scene.detections.copy()
    detections[:, :, joints, :2] += by
    return replace(scene, detections=detections)


def exchanged(scene: Scene, frames: slice, views: Sequence[int], joints: Sequence[int]) -> Scene:
    """Return the scene with left and right exchanged."""
    detections = scene.detections.copy()
    mirrored = layouts.mirror_images(17, BODY.left_right)[list(joints)]
    for view in views:
        detections[frames, view, joints] = scene.detections[frames, view][:, mirrored]
    return replace(scene, detections=detections)


def exercise(name: str, hz: float, rng: np.random.Generator) -> FloatArray:
    """Return ten seconds of one exercise on the spot, each repetition as the last, (T, 17, 3) mm."""
    phase = 2 * np.pi * hz * np.arange(FRAMES) / FPS + rng.uniform(0, 2 * np.pi)
    bent, angles = 0.5 - 0.5 * np.cos(phase), {"lean": 5.0}
    for side, shift in (("l", 0.0), ("r", np.pi)):
        hip, knee, elbow = {
            "standing": (3.0, 6.0, 20.0),
            "sitting": (85.0, 85.0, 60.0),
            "squats": (85 * bent, 95 * bent, 20.0),
            "curls": (3.0, 6.0, 20 + 110 * bent),
            "cycling": (60 + 25 * np.cos(phase + shift), 70 + 35 * np.cos(phase + shift + 1.0), 20.0),
        }[name]
        angles |= {f"hip_flexion_{side}": hip, f"knee_flexion_{side}": knee, f"elbow_flexion_{side}": elbow}
    pose = forward_kinematics(angles, rng.uniform(0, 360), n_frames=FRAMES)
    lowest = pose[:, ANKLES, 2].min(axis=1)
    floor = np.full(FRAMES, lowest.min()) if name == "cycling" else lowest
    pose[..., 2] += (ANKLE_HEIGHT_MM - floor)[:, None]
    return pose


def still(name: str, rng: np.random.Generator) -> FloatArray:
    """Return a person who stands or sits and sways by a few millimetres, (T, 17, 3) mm."""
    body = exercise(name, 0.0, rng)
    hz, phase = rng.uniform(0.15, 0.6, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    when = np.arange(FRAMES)[:, None, None] / FPS
    sway = 3.0 * np.sin(2 * np.pi * hz * when + phase).sum(axis=1) * [1.0, 1.0, 0.1]
    return body + sway[:, None] * body[..., 2:] / 1000.0
