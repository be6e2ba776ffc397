"""Recordings in which noise, bones or sides are not what a solver over time expects."""

from __future__ import annotations

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from skelsplat._arrays import Array
from skelsplat.synthetic import DetectionNoise

RIG, FPS, BODY = synthetic.human36m_like(), 25.0, sk.layouts.H36M17
WRISTS = [j for j, name in enumerate(BODY.joints) if "wrist" in name]


def moving(frames: int = 150, motion: str = "walk", seed: int = 0) -> Array:
    """Return somebody who moves, (T, 17, 3) mm."""
    return np.asarray(synthetic.motion(motion, frames, fps=FPS, seed=seed))


def seen(truth: Array, factor: float = 1.0, *, hidden: int = 0, seed: int = 0) -> Array:
    """Return detections (T, M, 17, 3) of a detector whose errors last, all of confidence 1."""
    noise = DetectionNoise.recording_occluded(hidden, frame_rate=FPS).scaled(factor)
    out = synthetic.simulate_detections(truth, RIG, noise=noise, layout=BODY, seed=seed)
    out[..., 2] = np.where(np.isfinite(out[..., 0]), 1.0, 0.0)
    return np.asarray(out)


def unequal(detections: Array) -> Array:
    """Return detections of which one camera's confidences are ten times the others'."""
    out = detections.copy()
    out[:, 1:, :, 2] *= 0.1
    return out


def shaken(detections: Array, px: float, joints: list[int], first: int = 0) -> Array:
    """Return detections with white noise added to some joints from a frame on."""
    out = detections.copy()
    part = out[first:, :, joints, :2]
    out[first:, :, joints, :2] = part + np.random.default_rng(1).normal(0, px, part.shape)
    return out


def exchanged(detections: Array, frames: slice) -> Array:
    """Return detections with left and right exchanged in all views of some frames."""
    out = detections.copy()
    for a, b in BODY.left_right:
        out[frames, :, a], out[frames, :, b] = detections[frames, :, b], detections[frames, :, a]
    return out


def elsewhere(detections: Array, truth: Array, frames: slice) -> Array:
    """Return detections of which three views take a wrist for an object 2 m above it in some frames."""
    out = detections.copy()
    away = np.moveaxis(np.asarray(sk.project(truth + np.array([0.0, 0.0, 2000.0]), RIG)), 0, 1)
    out[frames, :3, WRISTS[0], :2] = away[frames, :3, WRISTS[0]]
    return out


def two_people(first_m: float, then_m: float, frames: int = 150) -> Array:
    """Return a person of one stature and then one of another who goes on in their place."""
    truth = moving(2 * frames)
    place = truth[:, :1] * [1.0, 1.0, 0.0]
    size = np.where(np.arange(2 * frames) < frames, first_m, then_m) / 1.7
    return np.asarray(place + (truth - place) * size[:, None, None])


def resized(factor: float) -> sk.CameraRig:
    """Return the cameras of a world so many times as large, which has the same images."""
    cameras = [sk.Camera(K=c.K, R=c.R, t=factor * np.asarray(c.t), size=c.size) for c in RIG]
    return sk.CameraRig(cameras)
