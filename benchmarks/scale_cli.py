"""Memory and time of ``skelsplat refine`` on long recordings.

    python benchmarks/scale_cli.py [--frames 100000] [--folder DIR] [--options "--no-html"]

Simulated: one person walks, sits and waves by turns, 17 joints in 4 views at 50 Hz, detections `good`. The
recording is written piece by piece as npz, removed again, and refined in a process of its own, of which the
peak of the resident memory is stated. A million frames need 25 GB on the disk of DIR.
"""

from __future__ import annotations

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


def scale_cli(*, frames: int = 100_000, folder: Path | None = None, options: str = "") -> Table:
    """Write a recording, refine it, and measure peak memory in MB and times in s."""
    rig = synthetic.human36m_like()
    with tempfile.TemporaryDirectory(prefix="skelsplat-scale-", dir=folder) as temporary:
        top = Path(temporary)
        write_calibration(top / "cameras.json", rig)
        source, out = write_npz(top, frames, rig), top / "out"
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
    return Table.of("skelsplat refine", "frames", {f"{frames:,}": row}, [files], digits=0)


if __name__ == "__main__":
    lab.main(__doc__, scale_cli)
