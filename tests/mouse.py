"""A simulated mouse: the layout ``mouse22`` walking about a box, and files as DeepLabCut writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import detection_files
import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import write_calibration

LAYOUT = sk.layouts.get("mouse22")
FPS = 60.0
# joints of one side and of the middle: forwards, to the left and up from the middle of the body, mm
_MIDDLE = {
    "nose": (42, 0, 14),
    "neck": (26, 0, 18),
    "body_middle": (0, 0, 20),
    "tail_root": (-30, 0, 14),
    "tail_middle": (-60, 0, 8),
    "tail_end": (-92, 0, 5),
}
_LEFT = {
    "ear_tip": (30, 9, 25),
    "shoulder": (20, 9, 15),
    "elbow": (17, 12, 8),
    "paw_end": (22, 11, 2),
    "paw": (27, 11, 0),
    "hip": (-22, 9, 14),
    "knee": (-14, 14, 9),
    "foot": (-18, 13, 0),
}
_FORELEG, _HIND_LEG = ("elbow", "paw_end", "paw"), ("knee", "foot")


def motion(steps: int) -> np.ndarray:
    """Return the joints of a mouse on a circle of 120 mm, (T, 22, 3) in mm; legs and tail swing."""
    where = dict(_MIDDLE)
    for joint, (x, y, z) in _LEFT.items():
        where |= {f"left_{joint}": (x, y, z), f"right_{joint}": (x, -y, z)}
    body = np.array([where[joint] for joint in LAYOUT.joints], dtype=float)
    time = np.arange(steps) / FPS
    found = np.repeat(body[None], steps, axis=0)
    swing = 0.6 * np.sin(
        8.0 * time
    )  # of the left foreleg and the right hind leg; the others swing against it
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for top, leg, turn in (("shoulder", _FORELEG, sign), ("hip", _HIND_LEG, -sign)):
            at = [LAYOUT.joints.index(f"{side}_{joint}") for joint in leg]
            hinge = body[LAYOUT.joints.index(f"{side}_{top}")]
            away, cos, sin = body[at] - hinge, np.cos(turn * swing)[:, None], np.sin(turn * swing)[:, None]
            found[:, at, 0] = hinge[0] + cos * away[:, 0] - sin * away[:, 2]
            found[:, at, 2] = hinge[2] + sin * away[:, 0] + cos * away[:, 2]
    for joint, by in (("tail_middle", 8.0), ("tail_end", 20.0)):
        found[:, LAYOUT.joints.index(joint), 1] += by * np.sin(3.0 * time)
    turn = 1.2 * time
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x, y = found[..., 0], found[..., 1] - 120.0
    return np.stack([cos * x - sin * y, sin * x + cos * y, found[..., 2]], axis=-1)


def rig() -> sk.CameraRig:
    """Return four cameras half a metre above and around the box."""
    target = np.zeros(3)
    names = ("camA", "camB", "camC", "camD")
    cameras = []
    for k, name in enumerate(names):
        angle = np.pi * (0.25 + 0.5 * k)
        eye = np.array([450.0 * np.cos(angle), 450.0 * np.sin(angle), 350.0])
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        K = [[1200.0, 0.0, 640.0], [0.0, 1200.0, 512.0], [0.0, 0.0, 1.0]]
        cameras.append(sk.Camera(np.array(K), R, -R @ eye, size=(1280, 1024), name=name))
    return sk.CameraRig(cameras, unit="mm")


def write(folder: Path, steps: int = 60) -> np.ndarray:
    """Write ``rig.toml`` and DeepLabCut's csv in ``dlc``; return the true joints (T, 22, 3)."""
    truth, cameras = motion(steps), rig()
    noise = synthetic.DetectionNoise(sigma_px=1.5)
    seen = synthetic.simulate_detections(truth, cameras, noise=noise, layout=LAYOUT, seed=1)
    write_calibration(folder / "rig.toml", cameras)
    (folder / "dlc").mkdir()
    take = detection_files.Take(seen[:, :, None], list(cameras.names), list(LAYOUT.joints))
    detection_files.deeplabcut_csv(folder / "dlc", take)
    return truth
