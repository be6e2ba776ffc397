"""One frame of the overlay: colours, places to a part of a pixel, and what is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from overlay_case import need_opencv
from skelsplat.viz import Skeleton, _style

need_opencv()

from skelsplat.viz.overlay import (  # noqa: E402  after the check
    OverlayFrame,
    Shown,
    draw_overlay,
)
from skelsplat.viz.overlay._marks import bgr  # noqa: E402

SKELETON = Skeleton(limbs=((0, 1), (1, 2)), left_right=((0, 2),))
SHOWN = Shown(rejected_below=0.25)
NOTHING = Shown(rejected_below=0.25, pose=False, ellipses=False, detections=False)
GROUND = 128


def of(joints, **changes) -> OverlayFrame:
    """Return a frame of joints alone: no ellipse, no detection."""
    joints = np.asarray(joints, dtype=float)
    count = len(joints)
    given = {
        "pose": joints,
        "covariances": np.full((count, 2, 2), np.nan),
        "reliable": np.ones(count, dtype=bool),
        "detections": np.full((count, 2), np.nan),
        "weights": np.full(count, np.nan),
        "swapped": np.zeros(count, dtype=bool),
        "before": np.full((count, 2), np.nan),
    }
    return OverlayFrame(**{**given, **changes})


def drawn(frame, shown=SHOWN, size=(300, 200)):
    image = np.full((size[1], size[0], 3), GROUND, dtype=np.uint8)
    draw_overlay(image, frame, SKELETON, shown)
    return image


def changed(image):
    return (image != GROUND).any(axis=2)


THREE = np.array([[50.0, 50.0], [150.0, 50.0], [150.0, 150.0]])
NONE = np.full((3, 2), np.nan)


@pytest.mark.parametrize("place", [(0.0, 0.0), (60.25, 40.75), (60.5, 40.0)])
def test_a_detection_is_centred_to_a_part_of_a_pixel(place):
    """Pixel (0, 0) has its centre at (0, 0); the mean of the changed pixels, weighted, is the place."""
    big, shift = np.array(place) + 20.0, 20
    frame = of(NONE, detections=np.stack([big, *NONE[1:]]), weights=np.ones(3))
    image = drawn(frame, size=(160, 120))
    weight = np.abs(image.astype(float) - GROUND).sum(axis=2)
    rows, columns = np.indices(weight.shape)
    centre = np.array([(columns * weight).sum(), (rows * weight).sum()]) / weight.sum() - shift
    np.testing.assert_allclose(centre, place, atol=0.1)  # sixteenths of a pixel and OpenCV's edges


def test_a_rejected_detection_is_a_cross_with_a_line_to_the_joint():
    frame = of(THREE, detections=THREE + np.array([0.0, 30.0]), weights=np.array([0.1, 1.0, np.nan]))
    image = drawn(frame)
    rejected = np.array(bgr(_style.REJECTED))
    assert (image[80, 50] == rejected).all()
    assert np.abs(image[65, 50].astype(int) - rejected).max() < 60  # the line, half way
    assert not changed(image)[65, 130:146].any()  # none to a detection that is believed
    swapped = drawn(replace(frame, swapped=np.array([True, False, False])))
    assert not changed(swapped)[65, 40:60].any()  # it was meant for another joint
    diamond = np.array(bgr(_style.SWAPPED))
    assert (np.abs(swapped.astype(int) - diamond).max(axis=2) < 8).any()
    assert not (np.abs(image.astype(int) - diamond).max(axis=2) < 8).any()


def test_an_ellipse_is_two_standard_deviations_wide():
    covariance = np.array([[100.0, 0.0], [0.0, 25.0]])
    shown = replace(NOTHING, ellipses=True)
    frame = of([[150.0, 100.0]], covariances=covariance[None])
    inked = changed(drawn(frame, shown))
    columns, rows = np.flatnonzero(inked.any(axis=0)), np.flatnonzero(inked.any(axis=1))
    assert abs((columns[0] + columns[-1]) / 2 - 150) <= 0.5
    assert columns[-1] - columns[0] == pytest.approx(2 * 2 * 10, abs=3)  # the line's own width
    assert rows[-1] - rows[0] == pytest.approx(2 * 2 * 5, abs=3)
    assert not inked[100, 140:161].any()


def test_what_is_unknown_behind_or_far_away_is_not_drawn():
    nothing = of(NONE, covariances=np.repeat(np.eye(2)[None], 3, axis=0))
    assert not changed(drawn(nothing)).any()
    far = of([[1e12, 1e12], [np.inf, 0.0], [-1e7, 1e7]], covariances=np.full((3, 2, 2), 1e30))
    assert not changed(drawn(far)).any()
    off = of(THREE + 1000, detections=THREE + 1000, weights=np.zeros(3))
    assert not changed(drawn(off)).any()
