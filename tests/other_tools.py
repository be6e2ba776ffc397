"""One rig as every program writes it, and what its cameras see of a walk as every detector does."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import calibration_files
import detection_files as files
import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import read_calibration

STEPS = 12
NAMES = ["camA", "camB", "camC"]
# names of cameras as each program gives them
RINGS = {
    "opencap": ["Cam0", "Cam1", "Cam2"],
    "qualisys": ["21364", "21365", "21366"],
    "theia": ["21364", "21365", "21366"],
    "vicon": ["2111", "2112", "2113"],
    "dannce": ["Camera1", "Camera2", "Camera3"],
    "voxelpose": ["0", "1", "2"],
    "association": ["18181923", "18181928", "18307864"],
    "openpose": ["17012332", "17012369", "17012386"],
    "panoptic": ["00_00", "00_01", "00_02"],
    "human36m": ["54138969", "55011271", "58860488", "60457274"],
    "easymocap": ["01", "02", "03"],
    "caliscope": ["cam_0", "cam_1", "cam_2"],
    "pyxy3d": ["cam_0", "cam_1", "cam_2"],
}


def write(folder: Path) -> None:
    """Write a folder per program, ``rig.toml``, and the files of detectors that have no folder."""
    for tool, names in RINGS.items():
        (folder / tool).mkdir()
        views = calibration_files.reference(names, distortion=tool != "vicon")  # whose lens model is another
        getattr(calibration_files, tool)(folder / tool, views)
    calibration_files.anipose(folder, calibration_files.reference(NAMES)).rename(folder / "rig.toml")
    rig = read_calibration(folder / "rig.toml", unit="m")
    files.easymocap(folder / "easymocap", _take(rig, "body25", names=RINGS["easymocap"]))
    files.caliscope(folder / "caliscope", _take(rig, "halpe26"), first=0)
    path = files.caliscope_ports(folder / "pyxy3d", _take(rig, "mediapipe33"), first=0)
    path.rename(path.with_name("xy_POSE.csv"))
    two = _take(rig, "coco17", people=2)
    for tool, written, found in (
        ("alphapose", files.alphapose, _take(rig, "halpe26", people=2)),
        ("coco", files.coco, two),
        ("metrabs", files.metrabs, _take(rig, "h36m17")),
        ("dlc", files.deeplabcut_tracks, two),
        ("sleap", files.sleap, two),
        ("sleap_csv", files.sleap_csv, two),
    ):
        (folder / tool).mkdir()
        written(folder / tool, found)
    files.videopose3d_custom(folder, two)
    files.plain_csv(folder, _take(rig, "coco17"))
    for name, view in two.views():
        (folder / "yolo" / name).mkdir(parents=True)
        for t, image in enumerate(view):
            np.save(folder / "yolo" / name / f"{t:06d}.npy", np.nan_to_num(image))


def _take(rig: sk.CameraRig, layout: str, *, names: list[str] = NAMES, people: int = 1) -> files.Take:
    """Return the joints of COCO, or of Human3.6M for its layout, in the order of a layout.

    The last joint of a larger layout, a heel or toes, is where the ankle is; its others are missing.
    """
    known = sk.layouts.get(layout)
    simulated = known if layout == "h36m17" else sk.layouts.COCO17
    found = np.full((STEPS, len(names), people, known.n_joints, 3), np.nan)
    at = [known.joints.index(joint) for joint in simulated.joints]
    for p in range(people):
        walk = synthetic.motion("walk", STEPS, seed=4 + p) + np.array([0.0, 700.0 * p, 0.0])
        truth = synthetic.in_layout(walk, simulated) / 1000.0
        good = synthetic.DetectionNoise.good()
        seen = synthetic.simulate_detections(truth, rig, noise=good, layout=simulated, seed=p)
        found[:, :, p, -1] = seen[:, :, simulated.joints.index("right_ankle")]
        found[:, :, p, at] = seen
    return files.Take(found, names, list(known.joints))
