"""The benchmarks of recordings run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import recordings

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SCRIPT = BENCHMARKS / "sequences.py"


def test_lower_frame_rates_show_the_same_motion_and_the_person_stays_in_view() -> None:
    whole, third = (recordings.takes("good", count=3, fps=fps, seed=2) for fps in (30, 10))
    for one, other in zip(whole, third, strict=True):
        assert one.name == other.name
        assert len(other.scene.truth) == -(-len(one.scene.truth) // 3)
        assert one.scene.detected.mean() > 0.9
        assert np.ptp(one.scene.truth[..., 2]) < 3000.0


def test_breaks_of_the_capture_are_cut_out() -> None:
    time = np.arange(100)[:, None, None] / 30.0
    take = np.tile(1000.0 * time, (1, 17, 3))
    take[0] += 500.0
    take[40, 3] += 400.0
    # The second differences that are too large hold frames 0 to 2 and 38 to 42.
    np.testing.assert_array_equal(recordings.unbroken(take), take[43:])
    take[40, 3] -= 400.0
    np.testing.assert_array_equal(recordings.unbroken(take), take[3:])


def test_the_benchmark_runs() -> None:
    longest = max(recordings.motions().items(), key=lambda take: len(take[1]))[0]
    small = ["--names", longest, "--frames", "45", "--views", "3", "--fps", "15", "--json"]
    methods = ["--methods", "frames", "butterworth", "kalman"]
    command = [sys.executable, str(SCRIPT), *small, *methods]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert list(report["conditions"]) == list(recordings.CONDITIONS[:4])
    good = report["conditions"]["good"]
    assert 5.0 < good["kalman"]["mean_mm"] < good["frames"]["mean_mm"] + 5.0 < 40.0
    assert good["butterworth"]["acceleration_m_s2"] < good["frames"]["acceleration_m_s2"]
    assert good["butterworth"]["within_1_sigma"] is None
    assert list(good["kalman"]["joints"]) == ["ends", "middle", "trunk", "fastest 1 %", "hardest 1 %"]
    assert report["circumstances"].splitlines()[1].endswith("kalman")


def test_every_camera_of_the_sample_is_predicted_from_the_others() -> None:
    command = [sys.executable, str(BENCHMARKS / "leave_one_out.py"), "--markdown"]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    figures = {}
    corrected = next(k for k, line in enumerate(lines) if line.startswith("cam_03 rotated by"))
    for line in lines[corrected:]:
        if line.startswith("| cam_0"):
            name, _, middle, most, *_ = (cell.strip() for cell in line.strip("|").split("|"))
            figures[name] = np.array([float(middle), float(most)])
    assert len(figures) == 12
    for view in range(1, 5):
        in_time, alone = (figures[f"cam_0{view}, {name}"] for name in ("sequence", "frames"))
        assert (in_time <= alone).all()
        assert (alone < [20.0, 40.0]).all()
