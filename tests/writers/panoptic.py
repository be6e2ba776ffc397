"""CMU Panoptic as panoptic-toolbox downloads it, and as the SkelSplat authors keep it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from writers.people import FloatArray, Person, person

SEQUENCES = ("171204_pose5", "171204_pose6")
HD = (1, 2, 10, 13, 3, 23, 19, 30)
LENS = (-0.27, 0.15, 0.0004, -0.0002, 0.03)
FIRST_FRAME = 100
GUESS_ERROR = 30.0
# z up → y down.
_Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Written:
    """What the files hold: truth in mm with y down, detections (T, 8, 19, 3) in the order of `HD`."""

    truth: dict[str, FloatArray]
    detections: dict[str, FloatArray]
    frames: np.ndarray


def write(root: Path, *, layout: str = "toolbox", per_camera: bool = False, n_frames: int = 5) -> Written:
    """Write both sequences, all eight cameras' detections by MeTRAbs, filtered ones for 4 and 8 views.

    In the toolbox's layout frame `FIRST_FRAME` has no body; in that of the authors nobody is left out.
    """
    people = {name: _person(n_frames, seed) for seed, name in enumerate(SEQUENCES)}
    frames = FIRST_FRAME + np.arange(n_frames)
    for name, who in people.items():
        folder = root / (name if layout == "toolbox" else "cameras")
        folder.mkdir(parents=True, exist_ok=True)
        calibration = {"calibDataSource": "simulated", "cameras": _cameras(who.rig)}
        (folder / f"calibration_{name}.json").write_text(json.dumps(calibration))
        if layout == "toolbox":
            _write_bodies(folder / "hdPose3d_stage1_coco19", who.truth, frames)
        for views in (4, 8):
            _write_arrays(root, name, who, frames, views, layout, per_camera=per_camera)
    return Written(
        {name: who.truth @ _Y_DOWN.T for name, who in people.items()},
        {name: who.detections for name, who in people.items()},
        frames,
    )


def _person(n_frames: int, seed: int) -> Person:
    spread = synthetic.dome(len(HD))
    rig = sk.CameraRig(
        [
            sk.Camera(c.K, c.R, c.t, distortion=LENS, size=c.size, name=f"00_{number:02d}")
            for c, number in zip(spread, HD, strict=True)
        ]
    )
    return person(sk.layouts.PANOPTIC19, rig, n_frames, motion="turn", seed=seed)


def _cameras(rig: sk.CameraRig) -> list[dict[str, object]]:
    def entry(camera: sk.Camera, name: str, kind: str) -> dict[str, object]:
        return {
            "name": name,
            "type": kind,
            "resolution": list(camera.size),
            "panel": int(name[:2]),
            "node": int(name[3:]),
            "K": camera.K.tolist(),
            "distCoef": list(LENS),
            "R": (camera.R @ _Y_DOWN.T).tolist(),
            "t": (camera.t / 10.0).reshape(3, 1).tolist(),
        }

    hd = [entry(camera, str(camera.name), "hd") for camera in rig]
    others = [entry(rig[0], "01_01", "vga"), entry(rig[0], "50_01", "kinect-color")]
    return others + sorted(hd, key=lambda camera: str(camera["name"]))


def _write_bodies(folder: Path, truth: FloatArray, frames: np.ndarray) -> None:
    folder.mkdir()
    for frame, pose in zip(frames.tolist(), truth @ _Y_DOWN.T / 10.0, strict=True):
        joints = np.concatenate([pose, np.full((len(pose), 1), 0.6)], axis=1)
        body = {"id": 3, "joints19": joints.ravel().tolist()}
        bodies = [] if frame == FIRST_FRAME else [body]
        document = {"version": 0.7, "univTime": 33.4 * frame, "fpsType": "hd_29_97", "bodies": bodies}
        (folder / f"body3DScene_{frame:08d}.json").write_text(json.dumps(document))


def _write_arrays(
    root: Path, name: str, who: Person, frames: np.ndarray, views: int, layout: str, *, per_camera: bool
) -> None:
    folder = root / "2d_metrabs" / "S0" / name
    folder.mkdir(parents=True, exist_ok=True)
    extra = {"frames": frames} if layout == "toolbox" else {}
    pixels = who.detections[:, :views, :, :2]
    if per_camera:
        for i, number in enumerate(HD[:views]):
            (folder / f"{number}").mkdir(exist_ok=True)
            path = folder / f"{number}" / f"poses_filtered_{views}.npz"
            np.savez(path, poses2d=pixels[:, i], **extra)
    else:
        np.savez(folder / f"poses_filtered_{views}.npz", poses2d=pixels, **extra)
    guess = root / "initial_guess" / "metrabs" / "S0" / name
    guess.mkdir(parents=True, exist_ok=True)
    np.savez(guess / f"poses_filtered_{views}.npz", poses3d=who.truth @ _Y_DOWN.T + GUESS_ERROR)
    if layout == "skelsplat":
        truth = root / "3d_gt" / "S0" / name
        truth.mkdir(parents=True, exist_ok=True)
        np.savez(truth / f"poses_filtered_{views}.npz", poses3d=who.truth @ _Y_DOWN.T / 10.0)
