"""A seeded round of fuzzing; `make fuzz MINUTES=60` tries other seeds for longer."""

from __future__ import annotations

from pathlib import Path

import pytest

from fuzz import readers
from fuzz.__main__ import EXPECTED, hunt
from skelsplat.io.calibration import FORMATS as CALIBRATIONS
from skelsplat.io.detections import FORMATS as DETECTIONS
from skelsplat.io.poses import READ


@pytest.mark.parametrize(("area", "seed", "cases"), [("readers", 2, 15), ("arrays", 1, 60)])
def test_a_seeded_round_finds_nothing(area: str, seed: int, cases: int, tmp_path: Path) -> None:
    found = hunt(area, seed, range(cases), tmp_path)
    assert found.total() == cases
    assert found.keys() <= EXPECTED


def test_every_format_is_fuzzed() -> None:
    assert {f"pose {kind}" for kind in READ} <= set(readers.SAMPLES)
    formats = {name.partition(" ")[2] for name in readers.SAMPLES if name.startswith("calibration ")}
    assert set(CALIBRATIONS) <= formats
    assert {case.format for case in readers.CASES.values()} | {"hourglass"} == set(DETECTIONS)
