"""Work in child processes, however they are started, after the parent has used its threads.

Threads do not survive a fork: a child that waited for the parent's would wait for ever.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="fork is of POSIX")

PROGRAM = Path(__file__).parents[1] / "process_case.py"
LIMIT_S = 60.0  # the slowest takes three seconds


def outcome(name):
    """Return what the program printed; one that hangs is ended with all of its workers."""
    # Python 3.12 and later warn of every fork of a process that has threads.
    command = [sys.executable, "-W", "ignore::DeprecationWarning", str(PROGRAM), name]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, start_new_session=True, **pipes) as program:
        try:
            out, err = program.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(program.pid, signal.SIGKILL)
            return "hangs"
    return out.strip() or err


@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
def test_a_pool_of_workers_after_a_batch(method):
    assert outcome(method) == "same"


def test_a_fork_after_one_frame_of_the_papers_method():
    assert outcome("after_one_frame") == "same"


def test_workers_of_a_data_loader_beside_busy_threads():
    assert outcome("epochs") == "same same same"
