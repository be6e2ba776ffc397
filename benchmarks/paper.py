"""Speed and memory of `paper`: 17 joints, 4 views, all 125 steps.

    python benchmarks/paper.py

Simulated detections in a Human3.6M-like room. Prints one table with machine and date. Times are the median of
repeated calls of ``skelsplat.refine`` from Python, everything included; memory is the increase of
the peak resident size during one refinement, measured in a fresh process.
"""

from __future__ import annotations

import datetime
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from common import cpu
from rich.console import Console
from rich.table import Table

import skelsplat as sk
from skelsplat import synthetic

REPEATS = 15


def scene(size: int, frames: int) -> tuple[sk.CameraRig, np.ndarray, np.ndarray]:
    """Return a rig of ``size`` × ``size`` px images (same focal length), starts and detections."""
    cameras = []
    for camera in synthetic.human36m_like():
        K = camera.K
        K[:2, 2] = (size - 1) / 2
        cameras.append(sk.Camera(K, camera.R, camera.t, size=(size, size), name=camera.name))
    rig = sk.CameraRig(cameras)
    pose = synthetic.motion("walk", frames, seed=0)
    rng = np.random.default_rng(0)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    detections = detections + rng.normal(0, 3.0, detections.shape)
    return rig, synthetic.perturb(pose, 20.0, seed=1), detections


def milliseconds(call: Callable[[], object], per: int = 1) -> float:
    """Return the median time of ``call`` over ``REPEATS`` runs, divided by ``per``."""
    times = []
    call()
    for _ in range(REPEATS):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return statistics.median(times) * 1e3 / per


def peak_mib() -> float:
    """Return this process's peak resident size in MiB (Linux)."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


def memory_of_one_refinement() -> None:
    """Print the increase of the peak during one refinement, in MiB."""
    rig, start, detections = scene(1000, 2)
    sk.refine(start[1], detections[1], rig, layout="h36m17", config=sk.RefineConfig.paper(max_steps=0))
    before = peak_mib()
    sk.refine(start[0], detections[0], rig, layout="h36m17", config=all_steps(n_threads=1))
    print(peak_mib() - before)


def all_steps(**fields: object) -> sk.RefineConfig:
    """Return the settings of `paper` without early stopping."""
    return sk.RefineConfig.paper(stop_tolerance=0.0, **fields)


def rows() -> list[tuple[str, str, str]]:
    """Measure everything: (what, measured, wanted)."""
    out = []
    for size in (1000, 4000):
        rig, start, detections = scene(size, 1)
        one = milliseconds(
            lambda rig=rig, start=start, detections=detections: sk.refine(
                start[0], detections[0], rig, layout="h36m17", config=all_steps(n_threads=1)
            )
        )
        wanted = "≤ 30 ms" if size == 1000 else "as 1000 px"
        out.append((f"one pose, {size} × {size} px, 125 steps, 1 core", f"{one:.1f} ms", wanted))
    rig, start, detections = scene(1000, 16)
    for threads in (1, 2):
        batch = milliseconds(
            lambda threads=threads: sk.refine(
                start, detections, rig, layout="h36m17", config=all_steps(n_threads=threads)
            ),
            per=16,
        )
        name = "1 core" if threads == 1 else f"{threads} cores"
        out.append((f"batch of 16, 125 steps, {name}, per pose", f"{batch:.1f} ms", ""))
    stopping = milliseconds(
        lambda: sk.refine(start, detections, rig, layout="h36m17", config=sk.RefineConfig.paper(n_threads=1)),
        per=16,
    )
    out.append(("batch of 16, early stopping, 1 core, per pose", f"{stopping:.1f} ms", ""))
    closed = milliseconds(
        lambda: sk.refine(
            start,
            detections,
            rig,
            layout="h36m17",
            config=all_steps(n_threads=1, renderer="closed_form"),
        ),
        per=16,
    )
    out.append(("the same with renderer='closed_form', 125 steps", f"{closed:.1f} ms", ""))
    grown = subprocess.run(
        [sys.executable, __file__, "--memory"], check=True, capture_output=True, text=True
    ).stdout
    out.append(("peak memory of one refinement", f"{float(grown):.1f} MiB", "< 20 MB"))
    return out


def main() -> None:
    table = Table(title="RefineConfig.paper(): 17 joints, 4 views (the paper reports about 3 s on a GPU)")
    for column in ("what", "measured", "wanted"):
        table.add_column(column, justify="left" if column == "what" else "right")
    for row in rows():
        table.add_row(*row)
    console = Console(width=100)
    console.print(table)
    console.print(
        f"{datetime.date.today()} · {cpu()} · Python {platform.python_version()} · {sk.__version__}"
    )


if __name__ == "__main__":
    memory_of_one_refinement() if "--memory" in sys.argv else main()
