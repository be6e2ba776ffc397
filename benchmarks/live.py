"""Latency and throughput of ``skelsplat live`` through its pipes, as used from another language.

    python benchmarks/live.py [--poses 5000] [--rate 1000] [--markdown]
    python benchmarks/live.py --people 6 --views 8 [--rate 200]

One person: simulated detections `good` of six motions, 17 joints. Several: `synthetic.simulate_scene`, who is
who included. The process runs on one core, this one on the others. First lines are sent as fast as possible,
then ``--rate`` lines per second. The latency is from before a line is written to after its answer is read, so
it includes both pipes and the JSON handling of both processes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import lab
import numpy as np
from lab import Table, wanted
from scenarios import simulated

from skelsplat import synthetic
from skelsplat.io import write_calibration

_PERCENTILES = (50, 90, 99, 99.9, 100)
_WARM_UP = 50  # lines: the first ones allocate


class Live:
    """The process, ready to answer, on one core where the system can bind it."""

    def __init__(self, calibration: Path, core: int | None, *options: str) -> None:
        command = [sys.executable, "-m", "skelsplat", "live", str(calibration)]
        pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        self._process = subprocess.Popen([*command, "--unit", "mm", "--layout", "h36m17", *options], **pipes)
        if core is not None:
            os.sched_setaffinity(self._process.pid, {core})
        self._process.stderr.readline()  # it says that it is ready

    def times(self, lines: list[bytes], rate: float | None) -> tuple[np.ndarray, np.ndarray]:
        """Write the lines, ``rate`` per second or as fast as possible.

        Returns when each was written and its answer read (T,), s; without the warm-up.
        """
        sent, answered = np.empty(len(lines)), np.empty(len(lines))

        def write() -> None:
            begun = time.perf_counter()
            for k, line in enumerate(lines):
                if rate is not None:
                    time.sleep(max(0.0, begun + k / rate - time.perf_counter()))
                sent[k] = time.perf_counter()
                self._process.stdin.write(line)
                self._process.stdin.flush()

        writer = threading.Thread(target=write)
        writer.start()
        for k in range(len(lines)):
            if not self._process.stdout.readline():
                raise SystemExit(self._process.stderr.read().decode())
            answered[k] = time.perf_counter()
        writer.join()
        return sent[_WARM_UP:], answered[_WARM_UP:]

    def end(self) -> str:
        """Close the input and return the process's own statistics."""
        self._process.stdin.close()
        said = self._process.stderr.read().decode().strip()
        self._process.wait()
        return said


def cpu_seconds() -> float:
    """Return the CPU time of all processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def to_lines(detections: np.ndarray) -> list[bytes]:
    """Return the JSON lines of detections (T, M, N, 3) or people (T, M, P, N, 3), null where missing."""
    frames = []
    for views in detections:
        plain = np.where(np.isfinite(views), views, None)
        if views.ndim == 4:  # only those who are there
            there = np.isfinite(views[..., 0]).any(axis=-1)
            frames.append([view[seen].tolist() for view, seen in zip(plain, there, strict=True)])
        else:
            frames.append(plain.tolist())
    return [(json.dumps({"frame": t, "detections": frame}) + "\n").encode() for t, frame in enumerate(frames)]


def live(*, poses: int = 5000, people: int = 0, views: int = 0, rate: float = 0.0) -> Table:
    """Send lines as fast as possible, then at a rate (1000 per second; of several people 200)."""
    views, rate = views or (8 if people else 4), rate or (200.0 if people else 1000.0)
    rig, options = synthetic.ring(views, radius_mm=4500.0), []
    if people:
        scene = synthetic.simulate_scene(people, rig, n_frames=poses + _WARM_UP, fps=rate, seed=0)
        detections, options = scene.people, ["--people", "all", "--fps", f"{rate:g}"]
    else:
        rig = synthetic.human36m_like() if views == 4 else rig
        detections = simulated(poses + _WARM_UP, cameras=rig).detections
    lines = to_lines(detections)
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    core = cores[-1] if len(cores) > 1 else None
    if core is not None:
        os.sched_setaffinity(0, set(cores[:-1]))
    with tempfile.TemporaryDirectory() as folder:
        calibration = Path(folder) / "rig.toml"
        write_calibration(calibration, rig)
        begun = cpu_seconds()
        Live(calibration, core, *options).end()
        empty = cpu_seconds()
        fast = Live(calibration, core, *options)
        _, answered = fast.times(lines, None)
        fast.end()
        own_ms = 1000.0 * (cpu_seconds() - empty - (empty - begun)) / len(lines)
        paced = Live(calibration, core, *options)
        sent, received = paced.times(lines, rate)
        said = paced.end()
    latency = 1000.0 * (received - sent)
    most, kept = ((len(times) - 1) / (times[-1] - times[0]) for times in (answered, received))
    rows = {
        "as fast as it takes them, lines per second": (f"{most:.0f}", "≥ 200" if people else "≥ 1000"),
        "CPU time per line, without start-up": (f"{own_ms:.2f} ms", f"≤ {1000 / rate:g} ms"),
        f"at {rate:g} per second, lines per second": (f"{kept:.0f}", f"{rate:g}"),
        **{
            f"latency through both pipes, {share:g}%": (f"{np.percentile(latency, share):.2f} ms", "")
            for share in _PERCENTILES
        },
    }
    kind = f"{people} people, simulated scene" if people else "simulated detections 'good'"
    table = wanted(f"skelsplat live, {views} views, 17 joints, {kind}, one core", rows)
    return replace(table, notes=(f"second run, as reported by the process: {said}",))


if __name__ == "__main__":
    lab.main(__doc__, live)
