"""Shared by the benchmarks: simulated scenes, timing, tables and the machine's name."""

from __future__ import annotations

import datetime
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import skelsplat as sk
from skelsplat import synthetic

NOISE = {
    "good": synthetic.DetectionNoise.good(),
    "noisy": synthetic.DetectionNoise.noisy(),
    "occluded2": synthetic.DetectionNoise.occluded(2),
    "occluded3": synthetic.DetectionNoise.occluded(3),
}


@dataclass(frozen=True)
class Scene:
    """Poses (T, 17, 3) mm and their simulated detections (T, M, 17, 3) px."""

    rig: sk.CameraRig
    truth: np.ndarray
    detections: np.ndarray


def simulated(
    poses: int,
    *,
    rig: sk.CameraRig | None = None,
    noise: synthetic.DetectionNoise = NOISE["good"],
    seed: int = 0,
) -> Scene:
    """Simulate the six motions in equal shares, every 4th frame, seen by ``rig`` (default Human3.6M-like)."""
    rig = synthetic.human36m_like() if rig is None else rig
    per_motion = -(-poses // len(synthetic.motion_names))
    takes = [
        synthetic.motion(name, 4 * per_motion, seed=seed + k)[::4]
        for k, name in enumerate(synthetic.motion_names)
    ]
    truth = np.concatenate(takes)[:poses]
    detections = synthetic.simulate_detections(truth, rig, noise=noise, layout="h36m17", seed=seed)
    return Scene(rig, truth, detections)


def seconds(call: Callable[[], object], repeat: int, at_least_s: float = 0.5) -> float:
    """Return the best time of ``repeat`` runs; with more than one, of further runs up to ``at_least_s``."""
    best, spent, runs = np.inf, 0.0, 0
    while runs < repeat or (repeat > 1 and spent < at_least_s):
        begun = time.perf_counter()
        call()
        taken = time.perf_counter() - begun
        best, spent, runs = min(best, taken), spent + taken, runs + 1
    return best


def show(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], *, markdown: bool) -> None:
    """Print a table for the terminal, 100 columns wide, or as Markdown."""
    if markdown:
        print(f"{title}\n")
        for row in (columns, ["---", *["---:"] * (len(columns) - 1)], *rows):
            print("| " + " | ".join(row) + " |")
        print()
        return
    table = Table(title=title)
    for k, column in enumerate(columns):
        table.add_column(column, justify="right" if k else "left", no_wrap=k == 0)
    for row in rows:
        table.add_row(*row)
    Console(width=100).print(table)


def cpu() -> str:
    """Return the processor's name and the number of cores."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {len(names) or '?'} cores"


def circumstances() -> str:
    """Return date, machine, versions and command of the figures."""
    command = " ".join(["python", *sys.argv])
    versions = f"Python {platform.python_version()} · NumPy {np.__version__} · skelsplat {sk.__version__}"
    return f"{datetime.date.today()} · {cpu()} · {versions}\n{command}"
