"""Ctrl-C in the midst of every compiled call that can take long; for commands, test_cli_interrupt.py."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import interrupt_case

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

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


def test_a_call_works_after_an_interrupted_one():
    work = (
        "import interrupt_case as case, skelsplat as sk, numpy as np\n"
        "before = case.interrupted(case.CASES['one_paper_frame'])\n"
        "pose = sk.refine(None, case.FRAME, case.RIG, config=sk.RefineConfig.paper(max_steps=2)).pose\n"
        "print(before, bool(np.isfinite(pose).all()))"
    )
    folder = Path(interrupt_case.__file__).parent
    done = subprocess.run(
        [sys.executable, "-c", work], cwd=folder, capture_output=True, text=True, check=False, timeout=LIMIT_S
    )
    assert done.stdout.split() == ["True", "True"], done.stderr
