"""A seeded round of fuzzing, and what it found; `make fuzz MINUTES=60` tries other seeds for longer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from array_forms import LAYOUT, PIXELS, RIG, SEEN
from fuzz import readers
from fuzz.__main__ import EXPECTED, hunt
from skelsplat.io.calibration import FORMATS as CALIBRATIONS
from skelsplat.io.detections import FORMATS as DETECTIONS
from skelsplat.io.poses import READ


@pytest.mark.parametrize(("area", "seed", "cases"), [("readers", 2, 10), ("arrays", 1, 30)])
def test_a_seeded_round_finds_nothing(area: str, seed: int, cases: int, tmp_path: Path) -> None:
    found = hunt(area, seed, range(cases), tmp_path)
    assert found.total() == cases
    assert found.keys() <= EXPECTED


def test_every_format_is_fuzzed() -> None:
    assert {f"pose {kind}" for kind in READ} <= set(readers.SAMPLES)
    formats = {name.partition(" ")[2] for name in readers.SAMPLES if name.startswith("calibration ")}
    assert set(CALIBRATIONS) <= formats
    assert {case.format for case in readers.CASES.values()} | {"hourglass"} == set(DETECTIONS)


def test_detections_of_images_of_twice_the_size_do_not_make_a_recording_nan():
    found = sk.refine_sequence(2.0 * PIXELS, RIG, layout=LAYOUT, fps=50.0)
    assert np.isfinite(found.pose).all()
    assert (found.joint_status == "weak").all()
    assert np.isfinite(found.noise).all()


@pytest.mark.parametrize(
    "fps", [memoryview(np.array(50.0)), np.array("2000", "M8[s]"), [50.0, 50.0], "50", 10**400]
)
@pytest.mark.parametrize("name", ["refine_sequence", "Refiner", "Tracker", "track"])
def test_a_rate_that_is_no_number_is_named(name, fps):
    calls = {
        "refine_sequence": lambda: sk.refine_sequence(PIXELS, RIG, layout=LAYOUT, fps=fps),
        "Refiner": lambda: sk.Refiner(RIG, layout=LAYOUT, fps=fps),
        "Tracker": lambda: sk.Tracker(RIG, layout=LAYOUT, fps=fps),
        "track": lambda: sk.track(SEEN[:, :, None], RIG, layout=LAYOUT, fps=fps),
    }
    with pytest.raises(sk.InvalidInputError, match=r"^fps: expected .+, got .+$"):
        calls[name]()


@pytest.mark.parametrize("confidence", [1e-29, 1e-31, 5e-324])
def test_tiny_confidences_do_not_make_a_pose_nan(confidence):
    seen = SEEN.copy()
    seen[..., 2] = confidence
    for found in (
        sk.refine(None, seen, RIG, layout=LAYOUT),
        sk.refine_sequence(seen, RIG, layout=LAYOUT, fps=50.0),
    ):
        there = found.joint_status != "unobserved"
        assert there.all() == (confidence > 1e-30)
        assert np.isfinite(found.pose[there]).all()
