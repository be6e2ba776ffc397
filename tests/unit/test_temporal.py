"""Gaps and noise over time: against splines, frequencies and a scalar filter."""

from __future__ import annotations

import math

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import temporal

RATE = 100.0
NAN = np.nan


def smoothed(pose, **given):
    return temporal.butterworth(pose, RATE, 6.0, **given)[0]


def one_joint(values):
    """Poses (T, 1, 3) whose x is ``values``; y and z are its double and its negative."""
    x = np.asarray(values, dtype=float)
    return np.stack([x, 2 * x, -x], axis=-1)[:, None]


# gaps


def test_linear_interpolation_of_short_gaps_only():
    pose = one_joint([0, NAN, 2, NAN, NAN, NAN, 10, NAN])
    before = pose.copy()
    filled_pose, filled = temporal.fill_gaps(pose, 2, method="linear")
    np.testing.assert_array_equal(filled_pose[:, 0, 0], [0, 1, 2, NAN, NAN, NAN, 10, NAN])
    assert np.flatnonzero(filled[:, 0]).tolist() == [1]
    filled_pose, filled = temporal.fill_gaps(pose, 3, method="linear")
    np.testing.assert_array_equal(filled_pose[:, 0, 2], [0, -1, -2, -4, -6, -8, -10, NAN])
    assert filled[:, 0].sum() == 4
    np.testing.assert_array_equal(pose, before)


def test_a_cubic_spline_restores_a_cubic():
    times = np.arange(12.0)
    truth = one_joint(0.5 * times**3 - 4 * times**2 + times)
    pose = truth.copy()
    pose[[3, 4, 8]] = NAN
    filled_pose, filled = temporal.fill_gaps(pose, 2)
    # a not-a-knot spline through samples of one cubic is that cubic
    np.testing.assert_allclose(filled_pose, truth, rtol=1e-12, atol=1e-9)
    assert np.flatnonzero(filled[:, 0]).tolist() == [3, 4, 8]


def test_gaps_are_counted_and_crossed_in_frame_numbers():
    pose = one_joint([0, NAN, 6, 7])
    frames = [10, 12, 16, 17]
    assert not temporal.fill_gaps(pose, 4, method="linear", frames=frames)[1].any()  # five frames lie between
    filled_pose, _ = temporal.fill_gaps(pose, 5, method="linear", frames=frames)
    assert filled_pose[1, 0].tolist() == [2.0, 4.0, -2.0]


def test_more_than_what_is_missing_can_be_replaced():
    pose = one_joint([0, 9, 2, 9, 9, 5, 9])
    gaps = np.array([[False], [True], [False], [True], [True], [False], [True]])
    filled_pose, filled = temporal.fill_gaps(pose, 1, method="linear", gaps=gaps)
    assert filled_pose[:, 0, 0].tolist() == [0, 1, 2, 9, 9, 5, 9]  # the longer gap and the end keep theirs
    assert np.flatnonzero(filled[:, 0]).tolist() == [1]


# Butterworth


def amplitude(signal, frequency):
    """Amplitude of a sine in the middle of a signal; whole periods of it are used."""
    middle = slice(500, 1500)
    times = np.arange(len(signal))[middle] / RATE
    wave = np.exp(-2j * math.pi * frequency * times)
    return 2.0 * abs(np.mean(signal[middle] * wave))


@pytest.mark.parametrize("order", [2, 8])
@pytest.mark.parametrize("cutoff", [2.0, 20.0])
def test_the_cutoff_is_where_both_passes_together_leave_half_the_power(order, cutoff):
    times = np.arange(2000) / RATE
    pose = one_joint(np.sin(2 * math.pi * cutoff * times))
    smooth, left = temporal.butterworth(pose, RATE, cutoff, order=order)
    # ends, 5 s away, decay as exp(−2π · 2 Hz · sin(π/8) · 5 s) = 3e-11
    assert amplitude(smooth[:, 0, 0], cutoff) == pytest.approx(math.sqrt(0.5), rel=1e-9)
    assert not left.any()


def test_the_filter_does_not_cross_gaps():
    pose = np.random.default_rng(0).normal(size=(60, 2, 3))
    pose[25, 0] = NAN
    frames = np.arange(60)
    frames[40:] += 1
    smooth = smoothed(pose, frames=frames)
    for joint, runs in ((0, [(0, 25), (26, 40), (40, 60)]), (1, [(0, 40), (40, 60)])):
        for start, stop in runs:
            part = pose[start:stop, joint : joint + 1]
            np.testing.assert_array_equal(smooth[start:stop, joint : joint + 1], smoothed(part))
    assert np.isnan(smooth[25, 0]).all()


@pytest.mark.parametrize(("order", "shortest"), [(2, 7), (8, 16)])
def test_a_run_that_is_too_short_is_left_and_counted(order, shortest):
    pose = np.random.default_rng(1).normal(size=(shortest, 1, 3))
    smooth, left = temporal.butterworth(pose, RATE, 6.0, order=order)
    assert not left.any()
    assert not np.array_equal(smooth, pose)
    smooth, left = temporal.butterworth(pose[1:], RATE, 6.0, order=order)
    assert left.all()
    np.testing.assert_array_equal(smooth, pose[1:])


# weak positions


def test_a_weak_position_stays_as_it_is_and_does_not_pull_on_others():
    walk = np.random.default_rng(5).normal(size=(60, 2, 3)).cumsum(axis=0)
    weak = np.zeros((60, 2), dtype=bool)
    weak[[0, 1, 20, 21, 22, 40, 59], 0] = True  # at the ends, a stretch, and alone
    wild = walk.copy()
    wild[weak] += 1e4
    usual, wilder = smoothed(walk, weak=weak), smoothed(wild, weak=weak)
    np.testing.assert_array_equal(usual[~weak], wilder[~weak])
    np.testing.assert_array_equal(wilder[weak], wild[weak])
    np.testing.assert_array_equal(usual[:, 1], smoothed(walk)[:, 1])
    assert not np.isclose(usual[~weak], walk[~weak]).all()


def test_butterworth_bridges_weak_positions_by_a_straight_line_within_a_run():
    walk = np.random.default_rng(6).normal(size=(60, 1, 3)).cumsum(axis=0)
    weak = np.zeros((60, 1), dtype=bool)
    weak[[5, 20, 21, 35, 36], 0] = True
    walk[37:40] = NAN  # so that the weak frames before it are the end of a run
    smooth, left = temporal.butterworth(walk, RATE, 6.0, weak=weak)
    bridged, _ = temporal.fill_gaps(walk[:35], 2, method="linear", gaps=weak[:35])
    expected, _ = temporal.butterworth(bridged, RATE, 6.0)
    np.testing.assert_array_equal(smooth[:35][~weak[:35]], expected[~weak[:35]])
    np.testing.assert_array_equal(left, weak)


# bad input


POSE = np.zeros((3, 1, 3))


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: temporal.fill_gaps(np.zeros((3, 3)), 1), "pose"),
        (lambda: temporal.butterworth(POSE, RATE, frames=[1, 3, 2]), "frames"),
        (lambda: temporal.fill_gaps(POSE, 0), "max_gap"),
        (lambda: temporal.fill_gaps(POSE, 1, method="quintic"), "method"),
        (lambda: temporal.fill_gaps(POSE, 1, gaps=[True]), "gaps"),
        (lambda: temporal.butterworth(POSE, RATE, 50.0), "cutoff"),
        (lambda: temporal.butterworth(POSE, RATE, NAN), "cutoff"),
        (lambda: temporal.butterworth(POSE, RATE, order=3), "order"),
        (lambda: temporal.butterworth(POSE, -1.0), "frame_rate"),
    ],
)
def test_bad_input_is_named(call, argument):
    with pytest.raises(sk.InvalidInputError) as caught:
        call()
    assert caught.value.argument == argument
