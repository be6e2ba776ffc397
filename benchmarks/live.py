"""Latency and throughput of ``skelsplat live`` through its pipes, as used from another language.

    python benchmarks/live.py [--poses 5000] [--rate 1000] [--markdown]

Simulated detections `good` of six motions, 17 joints, 4 views. The process runs on one core, this one on the
others. First lines are sent as fast as possible, then ``--rate`` lines per second. The latency is from before
a line is written to after its answer is read, so it includes both pipes and the JSON handling of both
processes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import _one_core  # noqa: F401  before numpy
import common
import numpy as np

from skelsplat.io import write_calibration

_PERCENTILES = (50, 90, 99, 99.9, 100)
# Warm-up lines: the first ones allocate.
_WARM_UP = 50


class Live:
    """Start the process on one core, ready to answer.

    Parameters
    ----------
    calibration : path
    core : int or None
        The core it is bound to; None where the system does not support this.
    """

    def __init__(self, calibration: Path, core: int | None) -> None:
        command = [sys.executable, "-m", "skelsplat", "live", str(calibration)]
        self._process = subprocess.Popen(
            [*command, "--unit", "mm", "--layout", "h36m17"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        if core is not None:
            os.sched_setaffinity(self._process.pid, {core})
        self._process.stderr.readline()  # it says that it is ready

    def times(self, lines: list[bytes], rate: float | None) -> tuple[np.ndarray, np.ndarray]:
        """Write the lines, ``rate`` per second or as fast as possible.

        Returns
        -------
        sent, answered : (T,)
            Times at which each was written and its answer read, s; without the warm-up.
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


def to_lines(detections: np.ndarray) -> list[bytes]:
    """Return the JSON lines of detections (T, M, N, 3), null for what is missing."""
    plain = np.where(np.isfinite(detections), detections, None).tolist()
    return [(json.dumps({"frame": t, "detections": frame}) + "\n").encode() for t, frame in enumerate(plain)]


def measure(poses: int, rate: float) -> tuple[list[list[str]], str]:
    """Run both; return the rows (what, measured, wanted), and the process's own statistics of the second."""
    scene = common.simulated(poses + _WARM_UP)
    lines = to_lines(scene.detections)
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    core = cores[-1] if len(cores) > 1 else None
    if core is not None:
        os.sched_setaffinity(0, set(cores[:-1]))
    with tempfile.TemporaryDirectory() as folder:
        calibration = Path(folder) / "rig.toml"
        write_calibration(calibration, scene.rig)
        fast = Live(calibration, core)
        _, answered = fast.times(lines, None)
        fast.end()
        paced = Live(calibration, core)
        sent, received = paced.times(lines, rate)
        said = paced.end()
    latency = 1000.0 * (received - sent)
    most = (len(answered) - 1) / (answered[-1] - answered[0])
    kept = (len(received) - 1) / (received[-1] - received[0])
    rows = [
        ["as fast as it takes them, poses per second", f"{most:.0f}", "≥ 1000"],
        [f"at {rate:g} per second, poses per second", f"{kept:.0f}", f"{rate:g}"],
        *(
            [f"latency through both pipes, {share:g}%", f"{np.percentile(latency, share):.2f} ms", ""]
            for share in _PERCENTILES
        ),
    ]
    return rows, said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--poses", type=int, default=5000, help="lines of each run (5000)")
    parser.add_argument(
        "--rate", type=float, default=1000.0, help="lines per second of the second run (1000)"
    )
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    options = parser.parse_args()
    rows, said = measure(options.poses, options.rate)
    title = "skelsplat live, 4 views, 17 joints, simulated detections 'good', one core"
    common.show(title, ["what", "measured", "wanted"], rows, markdown=options.markdown)
    print(f"second run, as reported by the process: {said}")
    print(common.circumstances())


if __name__ == "__main__":
    main()
