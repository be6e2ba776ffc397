"""Several people: cameras that contradict each other are named."""

from __future__ import annotations

import pytest

from cases.people import found_with
from sweeps import swept

KIND = "cameras_contradict"


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
