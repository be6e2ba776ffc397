"""Ctrl-C in the midst of compiled calls and of commands, and readers of stdout that go away."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

import interrupt_case
import skelsplat as sk
from command_line import invoke
from skelsplat import synthetic
from skelsplat.io import read_npz, write_calibration
from sweeps import swept

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and pipes of POSIX")

# All of them together take four seconds; any one that does not hear the signal takes half a minute or more.
LIMIT_S = 25.0


def test_ctrl_c_ends_every_long_call():
    command = [sys.executable, interrupt_case.__file__]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        try:
            heard, _ = program.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            program.kill()
            heard, _ = program.communicate()
    assert heard.split() == list(interrupt_case.CASES)


# commands, and readers of stdout that go away


def start(*args):
    command = [sys.executable, "-m", "skelsplat", *map(str, args)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def walk(folder, steps):
    """Write a walk and its detections; return the arguments of refine that are the same for all."""
    rig = synthetic.human36m_like()
    seen = sk.project(synthetic.motion("walk", steps, seed=3), rig).swapaxes(0, 1)
    np.savez(folder / f"{steps}.npz", detections=seen, camera_names=rig.names)
    write_calibration(folder / "rig.json", rig)
    rest = ["--layout", "h36m17", "-o", folder / "out", "-q", "--threads", 1]
    return ["refine", folder / "rig.json", folder / f"{steps}.npz", *rest]


def test_refine_keeps_the_result_that_is_there(tmp_path):
    assert invoke(*walk(tmp_path, 3), "--fps", 50).exit_code == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    # 3,000 frames of 125 steps, half a minute: the signal comes in time
    with start(*walk(tmp_path, 3000), "--paper", "--write", "trc") as process:
        assert process.stderr.readline().startswith("warning: ")  # the last word before the work
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
        assert process.stderr.read() == f"interrupted; nothing was written to {tmp_path / 'out'}\n"
        assert process.stdout.read() == ""
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    assert len(read_npz(tmp_path / "out" / "pose.npz").frames) == 3


def test_ctrl_c_during_the_imports_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    with start("--version") as process:
        assert process.wait() == 130
        assert process.stderr.read() == "interrupted\n"


@pytest.mark.parametrize("command", [["--help"], ["datasets", "list"], swept(["ablate", "--help"])])
def test_a_reader_that_goes_away_is_no_traceback(command):
    with start(*command) as process:
        process.stdout.close()
        assert process.wait() == 1
        assert process.stderr.read() == ""
