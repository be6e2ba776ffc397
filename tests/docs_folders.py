"""The folders that the pages talk about: files in the form that each tool writes, small.

Pages on a tool start from a simulated walk, written by the writers of the formats' tests; others from the
first frames of the recording in the package.
"""

from __future__ import annotations

import json
import shutil
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import calibration_files
import detection_files
import mouse
import skelsplat as sk
from detection_files import Take
from docs_code import run
from overlay_case import write_video
from skelsplat import synthetic
from skelsplat.io import read_calibration, sample
from skelsplat.io.detections._record import Record, Video, write_record

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

FRAMES = 24
STEPS = 12
VIDEO_FRAMES = 6
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


def prepare(page: str, folder: Path) -> None:
    """Put the files that `page` starts from into `folder`."""
    if page in PREPARED:
        PREPARED[page](folder)


def _sample(folder: Path, *, calibration: str = "Calib.toml", frames: int = FRAMES) -> None:
    """Put the recording there: a calibration, and ``pose`` with its first frames."""
    paths = sample.extract(folder)
    for camera in paths.detections.iterdir():
        for path in sorted(camera.iterdir())[frames:]:
            path.unlink()
    paths.detections.rename(folder / "pose")
    target = folder / calibration
    target.parent.mkdir(exist_ok=True)
    paths.calibration.rename(target)


def _walk(folder: Path, names: list[str], layout: str, scale: float) -> tuple[Path, detection_files.Take]:
    """Write an Anipose TOML of a ring of cameras; return it with a walk that they see."""
    path = calibration_files.anipose(folder, calibration_files.reference(names), scale)
    rig = read_calibration(path, unit={1.0: "mm", 1e-3: "m"}[scale])
    known = sk.layouts.get(layout)
    truth = synthetic.in_layout(synthetic.motion("walk", STEPS, seed=4), known)
    good = synthetic.DetectionNoise.good()
    seen = synthetic.simulate_detections(truth * scale, rig, noise=good, layout=known, seed=0)
    return path, detection_files.Take(seen[:, :, None], names, list(known.joints))


def _videos(folder: Path) -> None:
    """Grey videos of the recording's size, of as many frames as a page draws."""
    for name in ("cam01", "cam02", "cam03", "cam04"):
        write_video(folder / "videos" / f"{name}.mp4", VIDEO_FRAMES, (1088, 1920), 60.0)


def _pictures(folder: Path) -> None:
    _sample(folder)
    _videos(folder)


def _batches(folder: Path) -> None:
    """Write two days and two trials, each with the first frames of the recording."""
    _sample(folder)
    days = ("monday", "tuesday", "Project/Trial_1", "Project/Trial_2")
    for frames, place in zip((10, 12, 10, 12), days, strict=True):
        shutil.copytree(folder / "pose", folder / place / "pose")
        for camera in (folder / place / "pose").iterdir():
            for path in sorted(camera.iterdir())[frames:]:
                path.unlink()
    (folder / "Project" / "calibration").mkdir()
    shutil.copy(folder / "Calib.toml", folder / "Project" / "calibration")


def _openpose(folder: Path) -> None:
    _sample(folder)
    parameters = folder / "cameraParameters"
    parameters.mkdir()
    calibration_files.openpose(parameters, calibration_files.reference(["1", "2"]))


def _several_people(folder: Path) -> None:
    paths = sample.extract(folder, people=True)
    shutil.copytree(paths.detections, folder / "pose", ignore=lambda _, names: sorted(names)[FRAMES:])


def _freemocap(folder: Path) -> None:
    raw = folder / "recording" / "output_data" / "raw_data"
    raw.mkdir(parents=True)
    path, take = _walk(folder, ["cam_0", "cam_1", "cam_2"], "coco17", 1.0)
    path.rename(folder / "recording" / "session_camera_calibration.toml")
    detection_files.freemocap(raw, take)


def _anipose(folder: Path) -> None:
    session = folder / "session1"
    for name in ("calibration", "pose-2d"):
        (session / name).mkdir(parents=True)
    path, take = _walk(folder, ["A", "B", "C"], "coco17", 1.0)
    path.rename(session / "calibration" / "calibration.toml")
    for name, view in take.views():
        table = detection_files.deeplabcut_table(view, take.joints, 0, multi=False)
        table.to_hdf(
            session / "pose-2d" / f"walk_cam{name}.h5", key="df_with_missing", format="table", mode="w"
        )


def _deeplabcut(folder: Path) -> None:
    path, take = _walk(folder, ["camA", "camB", "camC"], "coco17", 1.0)
    path.rename(folder / "calibration.toml")
    kept = [j for j, joint in enumerate(take.joints) if "ear" not in joint]
    joints = ["snout" if j == 0 else take.joints[j] for j in kept]
    (folder / "dlc").mkdir()
    detection_files.deeplabcut(
        folder / "dlc", detection_files.Take(take.people[..., kept, :], take.names, joints)
    )


def _rtmpose(folder: Path) -> None:
    _, take = _walk(folder, ["cam01", "cam02", "cam03"], "coco17", 1e-3)
    (folder / "mmpose").mkdir()
    detection_files.mmpose(folder / "mmpose", take)


def _detected(folder: Path) -> None:
    """OpenPose's files of the recording with what ``skelsplat detect`` states, and videos."""
    _pictures(folder)
    _recorded(folder)


def _recorded(folder: Path) -> None:
    videos = {f"cam{m:02}": Video(f"cam{m:02}.mp4", (1088, 1920), 60.0) for m in range(1, 5)}
    joints = tuple(sk.layouts.get(sample.LAYOUT).joints)
    write_record(folder / "pose", Record({"backend": "openpose"}, sample.LAYOUT, joints, videos))


def _without_calibration(folder: Path) -> None:
    """All frames of the recording with what ``skelsplat detect`` states, and the cameras' lenses."""
    _sample(folder, calibration="lenses.toml", frames=100)
    _recorded(folder)


def _live(folder: Path) -> None:
    _, take = _walk(folder, ["A", "B", "C", "D"], "h36m17", 1.0)
    for name, views in (("recorded", take.people[:, :, 0]), ("people", take.people)):
        frames = ({"frame": t, "detections": np.nan_to_num(one).tolist()} for t, one in enumerate(views))
        (folder / f"{name}.jsonl").write_text("".join(json.dumps(frame) + "\n" for frame in frames))


def _synthetic(folder: Path) -> None:
    command = "skelsplat synth human36m-like data/h36m-like --poses 60 --openpose"
    status, output = run(command, folder)
    assert status == 0, output


def _other_tools(folder: Path) -> None:
    """Write a folder per program, ``rig.toml``, and the files of detectors that have no folder."""
    for tool, names in RINGS.items():
        (folder / tool).mkdir()
        views = calibration_files.reference(names, distortion=tool != "vicon")  # whose lens model is another
        getattr(calibration_files, tool)(folder / tool, views)
    calibration_files.anipose(folder, calibration_files.reference(NAMES)).rename(folder / "rig.toml")
    rig = read_calibration(folder / "rig.toml", unit="m")
    detection_files.easymocap(folder / "easymocap", _take(rig, "body25", names=RINGS["easymocap"]))
    detection_files.caliscope(folder / "caliscope", _take(rig, "halpe26"), first=0)
    path = detection_files.caliscope_ports(folder / "pyxy3d", _take(rig, "mediapipe33"), first=0)
    path.rename(path.with_name("xy_POSE.csv"))
    two = _take(rig, "coco17", people=2)
    for tool, written, found in (
        ("alphapose", detection_files.alphapose, _take(rig, "halpe26", people=2)),
        ("coco", detection_files.coco, two),
        ("metrabs", detection_files.metrabs, _take(rig, "h36m17")),
        ("dlc", detection_files.deeplabcut_tracks, two),
        ("sleap", detection_files.sleap, two),
        ("sleap_csv", detection_files.sleap_csv, two),
    ):
        (folder / tool).mkdir()
        written(folder / tool, found)
    detection_files.videopose3d_custom(folder, two)
    detection_files.plain_csv(folder, _take(rig, "coco17"))
    for name, view in two.views():
        (folder / "yolo" / name).mkdir(parents=True)
        for t, image in enumerate(view):
            np.save(folder / "yolo" / name / f"{t:06d}.npy", np.nan_to_num(image))


def _take(rig: sk.CameraRig, layout: str, *, names: list[str] = NAMES, people: int = 1) -> Take:
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
    return Take(found, names, list(known.joints))


_SAMPLE_PAGES = (
    *("docs/errors.md", "docs/formats.md", "docs/pose-files.md", "docs/howto/angles.md"),
    "docs/howto/animation.md",
    *("docs/howto/python.md", "docs/howto/run.md", "docs/howto/config.md"),
)
PREPARED: dict[str, Callable[[Path], None]] = {
    **dict.fromkeys(_SAMPLE_PAGES, _sample),
    "README.md": _pictures,
    "docs/howto/anipose.md": _anipose,
    "docs/howto/batches.md": _batches,
    "docs/howto/calibrate.md": _without_calibration,
    "docs/howto/cameras.md": partial(_sample, frames=100),
    "docs/howto/deeplabcut.md": _deeplabcut,
    "docs/howto/freemocap.md": _freemocap,
    "docs/howto/live.md": _live,
    "docs/howto/openpose.md": _openpose,
    "docs/howto/other-tools.md": _other_tools,
    "docs/howto/own-skeleton.md": lambda folder: mouse.write(folder, FRAMES),
    "docs/howto/pose2sim.md": partial(_sample, calibration="calibration/Calib_scene.toml"),
    "docs/howto/rtmpose.md": _rtmpose,
    "docs/howto/several-people.md": _several_people,
    "docs/howto/pictures.md": _pictures,
    "docs/howto/videos.md": _detected,
    "docs/synthetic-data.md": _synthetic,
    "docs/tutorial.md": _videos,
}
