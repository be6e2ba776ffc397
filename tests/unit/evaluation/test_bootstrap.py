"""Intervals by bootstrap over takes."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.evaluation.scores import mean_interval


def test_the_same_seed_gives_the_same_interval() -> None:
    sums, counts = np.arange(20.0) * 7, np.full(20, 7)
    assert mean_interval(sums, counts, seed=3) == mean_interval(sums, counts, seed=3)
    assert mean_interval(sums, counts, seed=3) != mean_interval(sums, counts, seed=4)


def test_many_equal_takes_give_the_interval_of_the_normal_law() -> None:
    values = np.random.default_rng(0).normal(20.0, 3.0, 400)
    low, high = mean_interval(values, np.ones(400), resamples=4000)
    half = 1.96 * values.std() / np.sqrt(400)
    # The ends are quantiles of 4000 means: about 3 % of the half width.
    assert low == pytest.approx(values.mean() - half, abs=0.1 * half)
    assert high == pytest.approx(values.mean() + half, abs=0.1 * half)


def test_takes_weigh_by_their_numbers() -> None:
    """Two takes, of mean 1 over 9 numbers and 11 over 1: the means drawn are 1, 2 (one of each) and 11."""
    low, high = mean_interval([9.0, 11.0], [9, 1], level=0.4, resamples=5000)
    assert (low, high) == (2.0, 2.0)
    assert mean_interval([9.0, 11.0], [9, 1], level=0.9, resamples=5000) == (1.0, 11.0)


def test_one_take_has_no_interval() -> None:
    assert np.isnan(mean_interval([3.0, 0.0], [3, 0])).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: mean_interval([1.0], [1, 2]), "counts: expected shape"),
        (lambda: mean_interval([1.0], [1], level=1.0), "level: expected a number between 0 and 1, got 1.0"),
        (lambda: mean_interval([1.0], [1], resamples=0), "resamples: expected an integer >= 1, got 0"),
    ],
)
def test_wrong_arguments_are_named(call, message: str) -> None:
    with pytest.raises(sk.InvalidInputError, match=message):
        call()
