"""A seeded round of fuzzing, and that the fuzzer finds what it should."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random

import numpy as np
import pytest

from fuzz import commands, mutate, readers
from fuzz.__main__ import hunt
from skelsplat.io.calibration import FORMATS as CALIBRATIONS
from skelsplat.io.detections import FORMATS as DETECTIONS
from skelsplat.io.poses import POSE_FORMATS

# Area, seed and number of cases: about 20 s in all. `make fuzz MINUTES=60` tries other seeds for longer.
ROUND = [
    *(("readers", seed, 70) for seed in (2, 5)),
    *(("arrays", seed, 200) for seed in (1, 2)),
    *(("commands", seed, 25) for seed in (4, 5)),
]


@pytest.mark.parametrize(("area", "seed", "cases"), ROUND)
def test_a_seeded_round_finds_nothing(area: str, seed: int, cases: int, tmp_path: Path) -> None:
    found = hunt(area, seed, range(cases), tmp_path)
    assert found.outcomes.total() == cases
    assert found.cases == {}


def test_errors_loops_and_deaths_are_found_and_saved_with_how_to_repeat_them(tmp_path: Path) -> None:
    found = hunt("planted", 7, range(6), tmp_path, limit=0.5)
    assert found.outcomes == {"fine": 2, "finding": 2, "ended": 2}
    assert {
        re.sub(r":\d+ ", " ", cause).partition(" (")[0]: first for cause, (_, first) in found.cases.items()
    } == {
        "ValueError in planted.py error": "python -m fuzz planted --seed 7 --case 1",
        "MemoryError in planted.py memory": "python -m fuzz planted --seed 7 --case 3",
        "process ended: SIGPROF: a loop": "python -m fuzz planted --seed 7 --case 2",
        "process ended: SIGABRT: a death": "python -m fuzz planted --seed 7 --case 4",
    }
    how = (tmp_path / "planted-7-1" / "how.txt").read_text()
    assert how.startswith("python -m fuzz planted --seed 7 --case 1\nValueError")
    assert (tmp_path / "planted-7-1" / "input").read_text() == "an error"


@pytest.mark.filterwarnings("ignore")
def test_odd_arrays_are_arrays() -> None:
    for seed in range(200):
        rng, array = Random(seed), np.array(3)
        for _ in range(3):
            array = mutate.odd_array(rng, array)
            assert isinstance(array, np.ndarray), seed


def test_every_format_and_every_command_is_fuzzed() -> None:
    assert {f"pose {kind}" for kind in POSE_FORMATS} <= set(readers.SAMPLES)
    formats = {name.partition(" ")[2] for name in readers.SAMPLES if name.startswith("calibration ")}
    assert set(CALIBRATIONS) <= formats
    read = {case.format for case in readers.CASES.values()}
    assert set(DETECTIONS) == read
    from skelsplat.cli._app import COMMANDS

    fuzzed = {name.partition(" ")[0] for name in commands.START}
    assert set(COMMANDS) - fuzzed == {"demo", "detect", "ablate"}  # minutes each, or models of other packages
