"""Tiny simulated recordings in each of the layouts of Human3.6M.

Every writer takes a `Recording` as it is: a test that wants a faulty data set changes the recording (or the
files) first.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat import synthetic

CAMERAS = ("54138969", "55011271", "58860488", "60457274")
FRAMES = 6
NOISE_PX = 1.5

# (action as the original files spell it, number of its take, motion)
TAKES = (
    ("Directions", 0, "reach"),
    ("Directions", 1, "walk"),
    ("Greeting", 1, "wave"),
    ("TakingPhoto", 1, "turn"),
)
SUBJECTS = {"S9": (0.0, 0.0, 0.0), "S11": (150.0, -80.0, 0.0)}
"""Subject → by how much the rig has moved, mm."""

# The 17 joints of h36m17 among the 32 of the motion capture.
OF_32 = (0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27)

# Joints of MPII, and those of h36m17 in their place.
HOURGLASS = {
    "r_ankle": "right_ankle",
    "r_knee": "right_knee",
    "r_hip": "right_hip",
    "l_hip": "left_hip",
    "l_knee": "left_knee",
    "l_ankle": "left_ankle",
    "pelvis": "pelvis",
    "thorax": "neck",
    "upper_neck": "nose",
    "head_top": "head",
    "r_wrist": "right_wrist",
    "r_elbow": "right_elbow",
    "r_shoulder": "right_shoulder",
    "l_shoulder": "left_shoulder",
    "l_elbow": "left_elbow",
    "l_wrist": "left_wrist",
}


@dataclass
class TakeData:
    """One take: truth (T, 17, 3) mm, pixels (T, 4, 17, 2), frame numbers (T,)."""

    subject: str
    action: str
    number: int
    truth: np.ndarray
    pixels: np.ndarray
    frames: np.ndarray

    @property
    def name(self) -> str:
        """As the original files are called: "Directions", "Directions 1"."""
        return f"{self.action} {self.number}" if self.number else self.action


@dataclass
class Recording:
    """What all layouts hold."""

    rigs: dict[str, sk.CameraRig]
    takes: list[TakeData] = field(default_factory=list)

    def exchange_sides(self) -> None:
        """Exchange left and right in the detections."""
        order = np.arange(17)
        for left, right in sk.layouts.H36M17.left_right:
            order[[left, right]] = right, left
        for take in self.takes:
            take.pixels = take.pixels[:, :, order]

    def scale_truth(self, factor: float) -> None:
        """Give the truth another unit."""
        for take in self.takes:
            take.truth = take.truth * factor

    def drop_joint(self) -> None:
        """Leave the last joint out of truth and detections."""
        for take in self.takes:
            take.truth, take.pixels = take.truth[:, :16], take.pixels[:, :, :16]


def record(*, frames: int = FRAMES) -> Recording:
    """Simulate the takes."""
    recording = Recording({subject: rig(moved) for subject, moved in SUBJECTS.items()})
    rng = np.random.default_rng(5)
    for subject, cameras in recording.rigs.items():
        for k, (action, number, motion) in enumerate(TAKES):
            truth = synthetic.motion(motion, frames, seed=10 * k + len(subject))
            pixels = sk.project(truth, cameras).swapaxes(0, 1)
            pixels = pixels + rng.normal(0.0, NOISE_PX, pixels.shape)
            recording.takes.append(TakeData(subject, action, number, truth, pixels, np.arange(frames)))
    return recording


def rig(moved: tuple[float, float, float], *, distortion: bool = True) -> sk.CameraRig:
    """Return the rig of `synthetic.human36m_like` under the names of the real one."""
    return sk.CameraRig(
        [
            sk.Camera(c.K, c.R, c.t - c.R @ np.array(moved), distortion=c.distortion, size=c.size, name=name)
            for name, c in zip(CAMERAS, synthetic.human36m_like(distortion=distortion), strict=True)
        ]
    )


def lens(camera: sk.Camera) -> np.ndarray:
    """Return k1, k2, p1, p2, k3."""
    return np.zeros(5) if camera.distortion is None else camera.distortion


def write_cameras(path: Path, recording: Recording) -> None:
    """Write ``camera-parameters.json``."""
    first = next(iter(recording.rigs.values()))
    content = {
        "intrinsics": {
            c.name: {"calibration_matrix": c.K.tolist(), "distortion": lens(c).tolist()} for c in first
        },
        "extrinsics": {
            subject: {c.name: {"R": c.R.tolist(), "t": c.t[:, None].tolist()} for c in cameras}
            for subject, cameras in recording.rigs.items()
        },
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def write_skelsplat(root: Path, recording: Recording, *, detectors: tuple[str, ...] = ("metrabs",)) -> None:
    """Write the layout of the method's authors."""
    write_cameras(root / "cameras" / "camera-parameters.json", recording)
    for take in recording.takes:
        folder = root / "3d_gt" / take.subject / take.name
        folder.mkdir(parents=True)
        np.savez(folder / "poses.npz", poses=take.truth)
    for detector in detectors:
        write_detections(root / f"2d_{detector}", recording)


def write_detections(root: Path, recording: Recording) -> None:
    """Write ``<subject>/<activity>/<camera>/poses.npz`` with the key poses2d."""
    for take in recording.takes:
        for view, name in enumerate(CAMERAS):
            folder = root / take.subject / take.name / name
            folder.mkdir(parents=True)
            np.savez(folder / "poses.npz", poses2d=take.pixels[:, view])


def write_hourglass(root: Path, recording: Recording) -> None:
    """Write one npz per take: 16 detected joints in MPII's order, and their counterparts in the truth."""
    places = [sk.layouts.H36M17.joints.index(name) for name in HOURGLASS.values()]
    for take in recording.takes:
        rig = recording.rigs[take.subject]
        detected = np.insert(take.pixels[:, :, None, places], 2, 1.0, axis=-1)
        np.savez(
            root / f"{take.subject}_{take.name.replace(' ', '_')}.npz",
            **{name: np.stack([getattr(camera, name) for camera in rig]) for name in ("K", "R", "t")},
            dist=np.stack([lens(camera) for camera in rig]),
            image_size=np.array([camera.size for camera in rig]),
            camera_names=list(rig.names),
            det2d=detected,
            gt3d=take.truth[:, None],
            det_joints=list(HOURGLASS),
            gt_joints=list(sk.layouts.H36M17.joints),
            pairs=np.array(list(enumerate(places))),
            frames=take.frames,
            fps=50.0,
            subject=take.subject,
            sequence=take.name,
        )


def joints_32(truth: np.ndarray) -> np.ndarray:
    """Return (T, 32, 3) with the 17 joints in their places; the others are at the pelvis."""
    out = np.repeat(truth[:, :1], 32, axis=1)
    out[:, list(OF_32)] = truth
    return out


def write_videopose3d(
    root: Path, recording: Recording, *, detector: str = "cpn_ft_h36m_dbb", extra: int = 2
) -> None:
    """Write VideoPose3D's archives; detections run on for `extra` frames, as the released ones do."""
    write_cameras(root / "camera-parameters.json", recording)
    truth: dict[str, dict[str, np.ndarray]] = {}
    pixels: dict[str, dict[str, list[np.ndarray]]] = {}
    for take in recording.takes:
        name = take.name.replace("TakingPhoto", "Photo")
        whole = joints_32(take.truth) if take.truth.shape[1] == 17 else take.truth
        truth.setdefault(take.subject, {})[name] = (whole / 1000).astype(np.float32)
        longer = np.concatenate([take.pixels, take.pixels[-1:].repeat(extra, axis=0)])
        pixels.setdefault(take.subject, {})[name] = [longer[:, v].astype(np.float32) for v in range(4)]
    metadata = {
        "layout_name": "h36m",
        "num_joints": 17,
        "keypoints_symmetry": [[4, 5, 6, 11, 12, 13], [1, 2, 3, 14, 15, 16]],
    }
    np.savez_compressed(root / "data_3d_h36m.npz", positions_3d=np.array(truth, dtype=object))
    np.savez_compressed(
        root / f"data_2d_h36m_{detector}.npz",
        positions_2d=np.array(pixels, dtype=object),
        metadata=np.array(metadata, dtype=object),
    )
