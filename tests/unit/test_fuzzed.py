"""Small cases of what fuzzing found (`tests/fuzz`, docs/reliability.md)."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from array_forms import LAYOUT, PIXELS, RIG, SEEN
from command_line import assert_fails, invoke
from skelsplat import synthetic
from skelsplat.evaluation import baselines


def test_detections_of_images_of_twice_the_size_do_not_make_a_recording_nan():
    found = sk.refine_sequence(2.0 * PIXELS, RIG, layout=LAYOUT, fps=50.0)
    assert np.isfinite(found.pose).all()
    assert (found.joint_status == "weak").all()
    assert np.isfinite(found.noise).all()


@pytest.mark.parametrize(
    "fps",
    [memoryview(np.array(50.0)), np.array("2000", "M8[s]"), np.zeros(0), [50.0, 50.0], "50", 10**400],
)
@pytest.mark.parametrize("name", ["refine_sequence", "Refiner", "Tracker", "track"])
def test_a_rate_that_is_no_number_is_named(name, fps):
    calls = {
        "refine_sequence": lambda: sk.refine_sequence(PIXELS, RIG, layout=LAYOUT, fps=fps),
        "Refiner": lambda: sk.Refiner(RIG, layout=LAYOUT, fps=fps),
        "Tracker": lambda: sk.Tracker(RIG, layout=LAYOUT, fps=fps),
        "track": lambda: sk.track(SEEN[:, :, None], RIG, layout=LAYOUT, fps=fps),
    }
    with pytest.raises(sk.InvalidInputError, match=r"^fps: expected a positive number, got .+$"):
        calls[name]()


@pytest.mark.parametrize("seed", [-1, 1.5, "x"])
def test_a_seed_that_is_none_is_named(seed):
    with pytest.raises(sk.InvalidInputError, match=r"^seed: expected a whole number of at least 0, or a gen"):
        synthetic.motion("walk", 3, seed=seed)


def test_simulated_poses_have_a_limit():
    with pytest.raises(sk.InvalidInputError, match=r"^poses: expected at most 10000000, got "):
        synthetic.simulate_set("human36m-like", poses=10**400)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"root": np.zeros((3, 3))}, r"root: expected shape \(2, 3\) or \(3,\), got \(3, 3\)"),
        ({"heading_deg": np.zeros(3)}, r"heading_deg: expected shape \(2,\) or \(\), got \(3,\)"),
        (
            {"angles": {"knee_flexion_l": np.zeros(3)}},
            r"angles\['knee_flexion_l'\]: expected shape \(2,\) or",
        ),
    ],
)
def test_angles_of_another_number_of_frames_are_named(given, text):
    with pytest.raises(sk.InvalidInputError, match="^" + text):
        synthetic.forward_kinematics(**{"angles": {}, "n_frames": 2, **given})


def test_a_layout_is_printed_in_one_form():
    assert_fails(
        invoke("layouts", "coco17", "--toml", "--json"), 2, "--toml: expected --toml or --json, got both"
    )


def test_no_frames_are_triangulated():
    assert baselines.dlt(SEEN[:0], RIG).shape == (0, 17, 3)


def test_what_files_hold_is_shortened_in_messages():
    said = str(sk.DatasetError("a.csv", "line 1", "frame", "x" * 5000))
    assert len(said) < 1100
    assert said.startswith("a.csv: line 1: expected frame, got xxx")
