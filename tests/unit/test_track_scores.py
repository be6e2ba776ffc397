"""Scores of tracked people against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from skelsplat import InvalidInputError, metrics

T = 6
BODY = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 500.0], [0.0, 0.0, 1000.0]])


def standing(x, frames=T):
    """One person at x mm, (T, 3, 3)."""
    return np.tile(BODY + np.array([x, 0.0, 0.0]), (frames, 1, 1))


@pytest.fixture
def truth():
    return np.stack([standing(0.0), standing(3000.0)])


def test_missed_and_false_people_are_counted(truth):
    # The first person in four of six frames, 30 mm off; the second never; a ghost in two frames.
    tracks = [(0, [0, 1, 2, 3], truth[0, :4] + [0, 30.0, 0]), (1, [4, 5], standing(9000.0, 2))]
    scores = metrics.track_scores(tracks, truth, limbs=[(0, 1)])
    assert scores.recall == 4 / 12
    assert scores.precision == 4 / 6
    assert scores.mpjpe_mm == pytest.approx(30.0)
    assert scores.mota == pytest.approx(1 - (8 + 2) / 12)
    assert scores.idf1 == pytest.approx(2 * 4 / (12 + 6))
    np.testing.assert_allclose(scores.pcp, [4 / 6, 0.0])
    np.testing.assert_array_equal(scores.matched[0], [0, 0, 0, 0, -1, -1])
    assert np.isnan(scores.error_mm[0, 4:]).all()


def test_an_exchange_is_two_switches_and_halves_idf1(truth):
    first = np.concatenate([truth[0, :3], truth[1, 3:]])
    second = np.concatenate([truth[1, :3], truth[0, 3:]])
    scores = metrics.track_scores([(0, np.arange(T), first), (1, np.arange(T), second)], truth)
    assert scores.identity_switches == 2
    assert scores.idf1 == 0.5
    assert (scores.recall, scores.precision, scores.fragmentations) == (1, 1, 0)
    assert scores.mota == pytest.approx(1 - 2 / 12)


def test_a_person_lost_and_found_is_a_fragment_and_a_new_name_is_a_switch(truth):
    tracks = [(0, [0, 1], truth[0, :2]), (4, [3, 5], truth[0, [3, 5]])]
    scores = metrics.track_scores(tracks, truth[:1])
    assert (scores.fragmentations, scores.identity_switches) == (2, 1)
    assert scores.idf1 == pytest.approx(2 * 2 / (6 + 4))


def test_idf1_is_at_most_one_where_an_estimate_is_nearer_to_somebody_optional():
    truth = np.stack([standing(0.0), standing(200.0)])
    optional = np.array([[True] * T, [False] * T])
    scores = metrics.track_scores([(0, np.arange(T), standing(50.0))], truth, optional=optional)
    assert (scores.n_estimates, scores.n_truth, scores.idf1) == (0, T, 1.0)


def test_a_pair_within_the_gate_stays_matched_though_another_is_nearer():
    truth = np.stack([standing(0.0, 3), standing(300.0, 3)])
    near = np.concatenate([standing(0.0, 1), standing(280.0, 2)])
    far = np.concatenate([standing(300.0, 1), standing(20.0, 2)])
    tracks = [(0, [0, 1, 2], near), (1, [0, 1, 2], far)]
    assert metrics.track_scores(tracks, truth).identity_switches == 0
    assert metrics.track_scores(tracks, truth).mpjpe_mm == pytest.approx(20 * 4 / 6)
    # Beyond the gate it is an exchange.
    assert metrics.track_scores(tracks, truth, gate_mm=250.0).identity_switches == 2


def test_optional_people_and_the_estimates_on_them_do_not_count(truth):
    optional = np.zeros((2, T), dtype=bool)
    optional[1] = True
    tracks = [(k, np.arange(T), truth[k]) for k in range(2)]
    scores = metrics.track_scores(tracks, truth, optional=optional)
    assert (scores.n_truth, scores.n_estimates, scores.precision, scores.idf1) == (6, 6, 1, 1)
    scores = metrics.track_scores(tracks[:1], truth, optional=optional)
    assert (scores.recall, scores.precision, scores.mota) == (1, 1, 1)


@pytest.mark.parametrize(
    ("tracks", "argument"),
    [
        ([(-1, [0], standing(0, 1))], "tracks"),
        ([(0, [6], standing(0, 1))], "tracks[0]"),
        ([(0, [0, 1], standing(0, 1))], "tracks[0]"),
        ([(0, [1, 1], standing(0, 2))], "tracks[0]"),
        ([(0, [1], standing(0, 1)), (0, [1], standing(9, 1))], "tracks[1]"),
    ],
)
def test_tracks_that_do_not_fit_are_refused(truth, tracks, argument):
    with pytest.raises(InvalidInputError) as caught:
        metrics.track_scores(tracks, truth)
    assert caught.value.argument == argument
