"""Which cameras are named as those that disagree."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from skelsplat.cli._doubts import _cameras
from skelsplat.cli._statistics import Group


def group(name, rejected, used=1000):
    counts = dict.fromkeys(("left_out", "missing", "down_weighted", "swapped", "poor"), 0)
    errors = dict.fromkeys(("before_px", "after_px", "p90_before_px", "p90_after_px"), 1.0)
    return Group(name=name, used=used, rejected=rejected, mean_weight=0.5, **counts, **errors)


def doubts(*rejected):
    cameras = [group(f"cam_{i:02d}", count) for i, count in enumerate(rejected, 1)]
    return list(_cameras(SimpleNamespace(cameras=cameras, total=group("all", sum(rejected)))))


@pytest.mark.parametrize(
    ("rejected", "named"),
    [
        ((30, 30, 240, 30), ["cam_03"]),
        ((30, 390, 260, 100), ["cam_02", "cam_03"]),  # neither has three times the others' median
        ((90, 110, 120, 100), []),  # all alike
        ((150, 190, 180, 20), []),  # less than a fifth, and the best camera is not what is usual
        ((300, 350, 400), []),
        ((20, 99, 20), []),
        ((0, 0, 100), ["cam_03"]),
        ((400, 500, 600, 0), ["cam_01", "cam_02", "cam_03"]),
        ((900,), []),
    ],
)
def test_bad_cameras_do_not_hide_each_other(rejected, named):
    assert [doubt.split()[0] for doubt in doubts(*rejected)] == named


def test_a_doubted_camera_is_compared_with_those_that_are_not():
    first, second = doubts(30, 390, 260, 100)
    assert first.startswith("cam_02 disagrees with the other cameras: 39% of its detections are rejected, ")
    assert "6% of those of cam_01, cam_04, and its mean weight is 0.50." in first
    assert "check-cameras looks for the cause; --without cam_02 leaves it out." in first
    assert "--without cam_03 leaves it out." in second
    (alone,) = doubts(30, 30, 240)
    assert "24% of its detections are rejected, 3% of theirs, and its mean weight is 0.50. The" in alone


def test_of_two_cameras_none_can_be_left_out():
    (doubt,) = doubts(20, 100)
    assert doubt.endswith("check-cameras looks for the cause.")
