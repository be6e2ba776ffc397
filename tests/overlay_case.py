"""A small run folder with known pixels, and videos and images to draw it on."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.io import PoseData, write_npz
from skelsplat.io._run_files import REPORT
from skelsplat.io.poses._pose_data import ARRAYS
from skelsplat.io.run_folder import read_run, write_run_inputs

LAYOUT = sk.layouts.get("h36m17")
NAMES = ("cam_01", "cam_02")
SIZE = (320, 240)
FRAMES = 6
BARREL = (-0.3, 0.1, 0.0, 0.0)
# From the joint's projection to its detection, px: apart from the joint's dot.
AWAY = np.array([12.0, 0.0])


@dataclass(frozen=True)
class Case:
    """The folder of a run, and what is in it."""

    folder: Path
    rig: sk.CameraRig
    pose: np.ndarray
    detections: np.ndarray

    def pixels(self, view: int) -> np.ndarray:
        """Return the joints' pixels (T, N, 2) in a view."""
        return sk.project(self.pose, [self.rig[view]])[0]


def rig() -> sk.CameraRig:
    """Two cameras 2 m from the origin along z, the second with a strong distortion."""
    K = np.array([[200.0, 0.0, 159.5], [0.0, 200.0, 119.5], [0.0, 0.0, 1.0]])
    cameras = [
        sk.Camera(K, np.eye(3), [0.0, 0.0, 2000.0], size=SIZE, name=name, distortion=lens)
        for name, lens in zip(NAMES, (None, BARREL), strict=True)
    ]
    return sk.CameraRig(cameras, "mm")


def pose() -> np.ndarray:
    """Joints on a grid that moves by 50 mm (5 px) per frame to the right, (T, N, 3)."""
    j = np.arange(LAYOUT.n_joints)
    grid = np.stack([(j % 5 - 2.5) * 450.0, (j // 5 - 1.5) * 480.0, 0.0 * j], axis=1)
    return grid + np.arange(FRAMES)[:, None, None] * [50.0, 0.0, 0.0]


def write_run(folder: Path, *, frames=None, offsets=None, undistort=True, **changes) -> Case:
    """Write a run; ``changes`` replace arrays of its poses, or ``detections`` (T, M, N, 3)."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras, joints = rig(), changes.get("pose", pose())
    numbers = np.arange(FRAMES) if frames is None else np.asarray(frames)
    shape = (FRAMES, len(NAMES), LAYOUT.n_joints)
    seen = np.full((*shape, 3), 0.9)
    seen[..., :2] = sk.project(pose(), cameras).swapaxes(0, 1) + AWAY
    seen = changes.pop("detections", seen)
    arrays = {
        "pose": joints,
        "init_pose": joints,
        "uncertainty": np.broadcast_to(np.diag([40.0, 20.0, 10.0]) ** 2, (*joints.shape, 3)).copy(),
        "view_weights": np.where(np.isfinite(seen[..., 0]), 1.0, np.nan),
        "swapped": np.zeros(shape, dtype=bool),
        "joint_status": np.full((FRAMES, LAYOUT.n_joints), "ok", dtype="<U10"),
    }
    poses = PoseData(
        **{**arrays, **changes},
        joint_names=tuple(LAYOUT.joints),
        frames=numbers,
        unit="mm",
        camera_names=NAMES,
    )
    write_npz(folder / "pose.npz", poses)
    write_run_inputs(folder, cameras, LAYOUT, seen, numbers)
    report = {
        "input": {"layout": LAYOUT.name, "offsets": offsets or {}},
        "settings": {"undistort": undistort},
    }
    (folder / REPORT).write_text(json.dumps(report))
    return Case(folder, cameras, joints, seen)


def write_people(folder: Path, apart_mm=300.0) -> list[Case]:
    """Write the runs of two people, the second nearer to the cameras and only in the last four frames."""
    folders = ["person_0", "person_3"]
    folder.mkdir(parents=True)
    report = {"versions": {"skelsplat": "0"}, "settings": {}, "folders": folders}
    (folder / REPORT).write_text(json.dumps(report))
    first, second = (folder / name for name in folders)
    cases = [write_run(first), write_run(second, pose=pose() - [0.0, 0.0, apart_mm])]
    kept, run = np.arange(2, FRAMES), read_run(second)
    held = {name: getattr(run.poses, name) for name in ARRAYS}
    arrays = {name: value[kept] for name, value in held.items() if len(value)}
    write_npz(second / "pose.npz", replace(run.poses, frames=kept, **arrays))
    write_run_inputs(second, run.rig, LAYOUT, run.detections[kept], kept)
    return cases


def grey(number: int) -> int:
    """Return the level of a frame, by which it is found again."""
    return 40 + 20 * number


def frame(number: int, size=SIZE) -> np.ndarray:
    return np.full((size[1], size[0], 3), grey(number), dtype=np.uint8)


def level(image: np.ndarray) -> int:
    """Return the number of the frame that an image shows, from its lower left corner."""
    corner = image[-8:, :8].astype(float).mean()
    return round((corner - 40) / 20)


def write_images(folder: Path, numbers=range(FRAMES), size=SIZE, first=0) -> Path:
    """Write images frame_NNN.png; the image ``number`` has the level of ``number − first``."""
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        cv2.imwrite(str(folder / f"take2_{number:03d}.png"), frame(number - first, size))
    return folder


def write_video(path: Path, count=FRAMES, size=SIZE, rate=25.0) -> Path:
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), rate, size)
    assert writer.isOpened()
    for number in range(count):
        writer.write(frame(number, size))
    writer.release()
    return path


def read_video(path: Path) -> tuple[list[np.ndarray], float]:
    """Return the frames and the frame rate."""
    import cv2

    capture = cv2.VideoCapture(str(path))
    frames = []
    while (got := capture.read())[0]:
        frames.append(got[1])
    rate = capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    return frames, rate


def read_image(path: Path) -> np.ndarray:
    import cv2

    image = cv2.imread(str(path))
    assert image is not None, path
    return image


def at(image: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the colour of the pixel in which a point lies."""
    column, row = np.rint(point).astype(int)
    return image[row, column].astype(int)


def need_opencv() -> None:
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed: pip install 'skelsplat[dev]'")
    pytest.importorskip("av", reason="PyAV is not installed: pip install 'skelsplat[dev]'")
