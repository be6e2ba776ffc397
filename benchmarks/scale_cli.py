"""Memory and time of ``skelsplat refine`` on long recordings.

    python benchmarks/scale_cli.py [--frames 100000] [--format npz] [--folder DIR] [--options "--no-html"]

Simulated: one person walks, sits and waves by turns, 17 joints in 4 views at 50 Hz, detections `good`. The
recording is written piece by piece (npz, csv, openpose or sleap), removed again, and refined in a process of
its own, of which the peak of the resident memory is stated. A million frames need 25 GB on the disk of DIR.
"""

from __future__ import annotations

import json
import resource
import shlex
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import lab
import numpy as np
from lab import Table

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import write_calibration

LAYOUT, FPS = "h36m17", 50
_PIECE = 4000


def pieces(frames: int, rig: sk.CameraRig) -> Iterator[np.ndarray]:
    """Yield the detections (≤ 4000, M, 17, 3) of a recording: each motion there and back."""
    names, done, noise = synthetic.motion_names, 0, synthetic.DetectionNoise.good()
    for k in range(-(-frames // _PIECE)):
        there = synthetic.motion(names[k % len(names)], _PIECE // 2, seed=k)
        poses = np.concatenate([there, there[::-1]])[: frames - done]
        yield synthetic.simulate_detections(poses, rig, noise=noise, layout=LAYOUT, seed=k)
        done += len(poses)


def write_npz(folder: Path, frames: int, rig: sk.CameraRig) -> Path:
    """Write one npz file of all cameras."""
    path, layout = folder / "detections.npz", sk.layouts.get(LAYOUT)
    shape = (frames, len(rig), layout.n_joints, 3)
    with zipfile.ZipFile(path, "w") as archive:
        with archive.open("detections.npy", "w", force_zip64=True) as stream:
            header = {"descr": "<f8", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_2_0(stream, header)
            for piece in pieces(frames, rig):
                stream.write(np.ascontiguousarray(piece, dtype="<f8").tobytes())
        small = {"camera_names": rig.names, "joint_names": layout.joints, "frame_rate": float(FPS)}
        for name, value in small.items():
            with archive.open(f"{name}.npy", "w") as stream:
                np.lib.format.write_array(stream, np.asarray(value))
    return path


def write_csv(folder: Path, frames: int, rig: sk.CameraRig) -> Path:
    """Write one csv file of all cameras, frame by frame."""
    path, joints = folder / "detections.csv", sk.layouts.get(LAYOUT).joints
    frame = 0
    with path.open("w") as stream:
        stream.write("frame,camera,joint,x,y,confidence\n")
        for piece in pieces(frames, rig):
            for views in piece.tolist():
                for name, view in zip(rig.names, views, strict=True):
                    for joint, (x, y, sure) in zip(joints, view, strict=True):
                        place = ",," if x != x else f"{x:.2f},{y:.2f},{sure:.3f}"
                        stream.write(f"{frame},{name},{joint},{place}\n")
                frame += 1
    return path


def write_openpose(folder: Path, frames: int, rig: sk.CameraRig) -> Path:
    """Write a folder per camera with a JSON file per frame."""
    top, frame = folder / "openpose", 0
    for name in rig.names:
        (top / name).mkdir(parents=True)
    for piece in pieces(frames, rig):
        for views in np.nan_to_num(piece):
            for name, view in zip(rig.names, views, strict=True):
                people = [{"pose_keypoints_2d": np.round(view, 3).ravel().tolist()}]
                (top / name / f"{frame:07d}_keypoints.json").write_text(json.dumps({"people": people}))
            frame += 1
    return top


def write_sleap(folder: Path, frames: int, rig: sk.CameraRig) -> Path:
    """Write an analysis file of SLEAP per camera."""
    import h5py

    top, joints = folder / "sleap", sk.layouts.get(LAYOUT).joints
    top.mkdir()
    files = [h5py.File(top / f"{name}.h5", "w") for name in rig.names]
    for file in files:
        shape = (1, 2, len(joints), frames)
        file.create_dataset("tracks", shape, "f8", chunks=(1, 2, len(joints), 1024), compression="gzip")
        file["node_names"] = [joint.encode() for joint in joints]
    done = 0
    for piece in pieces(frames, rig):
        for m, file in enumerate(files):
            file["tracks"][0, :, :, done : done + len(piece)] = piece[:, m, :, :2].transpose(2, 1, 0)
        done += len(piece)
    for file in files:
        file.close()
    return top


WRITERS = {"npz": write_npz, "csv": write_csv, "openpose": write_openpose, "sleap": write_sleap}


def scale_cli(
    *, frames: int = 100_000, format: str = "npz", folder: Path | None = None, options: str = ""
) -> Table:
    """Write a recording, refine it, and measure peak memory in MB and times in s."""
    rig = synthetic.human36m_like()
    with tempfile.TemporaryDirectory(prefix="skelsplat-scale-", dir=folder) as temporary:
        top = Path(temporary)
        write_calibration(top / "cameras.json", rig)
        source, out = WRITERS[format](top, frames, rig), top / "out"
        command = [sys.executable, "-m", "skelsplat", "refine", str(top / "cameras.json"), str(source)]
        command += ["-o", str(out), "--layout", LAYOUT, "--fps", str(FPS), "--quiet", *shlex.split(options)]
        seconds = lab.seconds(lambda: subprocess.run(command, check=True), 1)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        sizes = {path.name: path.stat().st_size / 1e6 for path in sorted(out.iterdir())}
    row = {
        "peak MB": used.ru_maxrss / 1024,
        "wall s": seconds,
        "CPU s": used.ru_utime + used.ru_stime,
        "µs per frame": 1e6 * seconds / frames,
    }
    files = "files, MB: " + ", ".join(f"{name} {size:.0f}" for name, size in sizes.items())
    return Table.of(f"skelsplat refine, {format}", "frames", {f"{frames:,}": row}, [files], digits=0)


if __name__ == "__main__":
    lab.main(__doc__, scale_cli)
