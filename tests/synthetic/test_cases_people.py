"""Several people: cameras that contradict each other are named."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.findings import collected_warnings
from sweeps import swept

KIND = "cameras_contradict"


def found_with(displaced, off_px, people=2, seed=0, frames=60):
    """Track people whom four cameras see, some of them off by so many pixels; also return the findings."""
    rig = synthetic.ring(4, radius_mm=4500.0)
    scene = synthetic.simulate_scene(people, rig, n_frames=frames, fps=30.0, seed=seed)
    seen = np.array(scene.people)
    seen[:, list(displaced), ..., 0] += off_px
    with warnings.catch_warnings(), collected_warnings() as found:
        return sk.track(seen, rig, fps=30.0, layout=scene.layout), found


@pytest.mark.parametrize(
    ("displaced", "off_px", "people"),
    [((2, 3), 50.0, 1), ((0, 2), 80.0, 2), swept((2, 3), 50.0, 3), swept((1, 2), 50.0, 2)],
)
def test_two_of_four_cameras_that_are_off_are_named(displaced, off_px, people):
    _, findings = found_with(displaced, off_px, people)
    (named,) = [one.subject.cameras for one in findings if one.kind == KIND]
    assert {f"cam{k}" for k in displaced} & set(named)


def test_one_of_four_cameras_that_is_off_is_named_alone():
    people, findings = found_with((1,), 80.0)
    assert [one.subject.cameras for one in findings if one.kind == KIND] == [("cam1",)]
    assert len(people) == 2


@pytest.mark.parametrize("seed", [0, *(swept(seed) for seed in range(1, 6))])
def test_cameras_that_are_right_are_not(seed):
    assert found_with((), 0.0, 3, seed)[1] == []
