"""Simulated detections whose errors last: shares of the variance, autocorrelation and durations as stated."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import DetectionNoise, Memory
from skelsplat.synthetic.detections import corrupt

LAYOUT = sk.layouts.H36M17
SILENT = DetectionNoise(sigma_px=0.0, memory=Memory())
RATES = (15.0, 60.0)


def still(n_frames, n_views=4, seed=0):
    """Return pixels (T, M, 17, 2) of a body that does not move."""
    one = np.random.default_rng(seed).uniform(100, 900, (1, n_views, 17, 2))
    return np.broadcast_to(one, (n_frames, n_views, 17, 2))


@cache
def jitter(frame_rate):
    """Return 60 s of unit jitter (T, 1 360 series)."""
    shape = (round(60 * frame_rate), 680, 2)
    return Memory(frame_rate=frame_rate).jitter(shape, np.random.default_rng(1)).reshape(shape[0], -1)


def stays(on):
    """Return the durations, in frames, of the runs of True in (T, series), without those cut by an end."""
    padded = np.pad(on, ((1, 1), (0, 0)))
    durations = []
    for series in padded.T:
        edge = np.flatnonzero(np.diff(series.astype(int)))
        runs = edge.reshape(-1, 2)
        durations += [stop - start for start, stop in runs if start > 0 and stop < len(on)]
    return np.array(durations)


def mean_correlation(lag):
    """Return exp(−t/τ) averaged over the time constants."""
    return np.exp(-lag / np.linspace(0.2, 0.5, 1001)).mean()


@pytest.mark.parametrize("frame_rate", RATES)
@pytest.mark.parametrize("lag", [0.1, 0.3, 1.0])
def test_shares_are_as_stated_and_the_autocorrelation_depends_on_time_not_on_the_frame_rate(frame_rate, lag):
    error = jitter(frame_rate)
    # 1 360 series: 4 standard errors of a variance of 0.4 between their means are 4·0.4·√(2/1360) = 0.061.
    # The slow part adds 0.25·2τ/60 s = 0.003 to the variance of a mean.
    assert error.mean(axis=0).var() == pytest.approx(0.4, abs=0.064)
    assert error.var(axis=0).mean() == pytest.approx(0.6, abs=0.02)
    steps = round(lag * frame_rate)
    # Within the series the constant part is out: some 1 360·60/0.7 = 117 000 independent values of the slow
    # one, 4·0.25/√117 000 = 0.003; that the means are of 60 s costs it another 0.003.
    inside = error - error.mean(axis=0)
    got = (inside[steps:] * inside[:-steps]).mean()
    assert got == pytest.approx(0.25 * mean_correlation(steps / frame_rate), abs=0.008)


@pytest.mark.parametrize("frame_rate", RATES)
def test_outliers_come_in_bursts_with_one_offset(frame_rate):
    noise = replace(SILENT, outlier_rate=0.05, memory=replace(SILENT.memory, frame_rate=frame_rate))
    pixels = still(round(60 * frame_rate), 8)
    error = corrupt(pixels, noise=noise, seed=2)[..., :2] - pixels
    off = (np.abs(error).max(axis=-1) > 1e-9).reshape(len(pixels), -1)
    # 136 series of 60 s: 0.05·8160 s/0.3 s = 1 360 bursts; 4 standard errors: 4·0.05·√(1.2/1360) = 0.006.
    assert off.mean() == pytest.approx(0.05, abs=0.006)
    seconds = stays(off) / frame_rate
    # Two bursts that meet are one here: about 1 %.
    assert seconds.mean() == pytest.approx(0.3, abs=0.03)
    assert 0.1 - 1 / frame_rate <= seconds.min()
    assert np.mean(seconds > 0.5 + 1 / frame_rate) < 0.03
    flat = error.reshape(len(pixels), -1, 2)
    inside = off[1:] & off[:-1]
    moved = np.linalg.norm(np.diff(flat, axis=0), axis=-1)[inside]
    assert np.mean(moved > 1e-9) < 0.01
    assert np.linalg.norm(flat, axis=-1)[off].mean() == pytest.approx(noise.outlier_px, rel=0.15)


def test_misses_and_swaps_last():
    missing = np.isnan(corrupt(still(1800), noise=replace(SILENT, miss_rate=0.05))[..., 0]).reshape(1800, -1)
    assert missing.mean() == pytest.approx(0.05, abs=0.012)
    assert (stays(missing) / 30.0).mean() == pytest.approx(0.3, abs=0.06)
    pixels = still(1800, 8)
    noise = replace(SILENT, limb_swap_rate=0.1)
    swapped = np.abs(corrupt(pixels, noise=noise, layout=LAYOUT)[..., :2] - pixels).max(axis=-1) > 0
    arm = swapped[:, :, LAYOUT.joints.index("left_wrist")]
    # 8 views of 60 s: 80 swaps; 4·0.1·√(1.3/80) = 0.05 on the share, 4·0.23/√80 = 0.1 s on the mean.
    assert arm.mean() == pytest.approx(0.1, abs=0.05)
    assert (stays(arm) / 30.0).mean() == pytest.approx(0.6, abs=0.11)


@pytest.mark.parametrize("count", [1, 3])
def test_occluders_stay_and_there_are_always_as_many(count):
    memory = Memory(frame_rate=30.0)
    numbers = memory.occluded(3000, 4, count, np.random.default_rng(count))
    assert ((numbers > 0).sum(axis=1) == count).all()
    ends = [np.flatnonzero(numbers == k) for k in np.unique(numbers[numbers > 0])[count:-count]]
    seconds = np.array([len(one) for one in ends]) / 30.0
    # 100 s: at least 75 stays of mean 1.25 s and standard deviation 0.43 s.
    assert seconds.mean() == pytest.approx(1.25, abs=0.2)
    assert seconds.min() >= 0.46
    assert seconds.max() <= 2.04


def test_a_bad_frame_rate_is_named():
    with pytest.raises(InvalidInputError) as caught:
        Memory(frame_rate=0.0)
    assert caught.value.argument == "frame_rate"
