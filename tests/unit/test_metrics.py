"""Metrics against values worked out by hand, and their rule for missing joints."""

from __future__ import annotations

import numpy as np
import pytest

from skelsplat import InvalidInputError, metrics


def poses(rng, n_frames=4, n_joints=6):
    return 500.0 * rng.standard_normal((n_frames, n_joints, 3))


def rotation(axis, angle):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def test_mpjpe_is_the_mean_distance():
    gt = np.zeros((2, 2, 3))
    pred = np.array([[[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])
    assert metrics.mpjpe(pred, gt) == 2.0
    np.testing.assert_allclose(metrics.mpjpe(pred, gt, reduce="per_joint"), [2.5, 1.5])
    np.testing.assert_allclose(metrics.mpjpe(pred, gt, reduce="per_pose"), [3.0, 1.0])
    np.testing.assert_allclose(metrics.mpjpe(pred, gt, reduce="none"), [[5.0, 1.0], [0.0, 2.0]])


def test_missing_joints_are_left_out_of_distances_and_counted_by_missing_rate():
    gt = np.zeros((2, 2, 3))
    pred = np.full((2, 2, 3), 0.0)
    pred[0, 0] = (0.0, np.nan, 0.0)
    pred[0, 1] = (0.0, 0.0, 6.0)
    gt[1, 1, 2] = np.nan
    assert metrics.mpjpe(pred, gt) == 3.0
    assert metrics.missing_rate(pred, gt) == pytest.approx(1 / 3)
    np.testing.assert_array_equal(metrics.missing_rate(pred, gt, reduce="per_joint"), [0.5, 0.0])


def test_a_mean_over_nothing_is_nan():
    nothing = np.full((2, 3, 3), np.nan)
    assert np.isnan(metrics.mpjpe(nothing, np.zeros((2, 3, 3))))
    assert np.isnan(metrics.pa_mpjpe(nothing, np.zeros((2, 3, 3))))
    assert np.isnan(metrics.pck(np.zeros((2, 3, 3)), nothing))


def test_root_relative_ignores_a_common_shift_and_uses_the_mean_of_several_roots(rng):
    gt = poses(rng)
    pred = gt + np.array([100.0, -20.0, 30.0])
    # Rounding of coordinates of size 1e3 in float64.
    assert metrics.root_relative_mpjpe(pred, gt, root=0) < 1e-9
    assert metrics.root_relative_mpjpe(pred, gt, root=(1, 2)) < 1e-9
    pred[:, 1] += (10.0, 0.0, 0.0)
    errors = metrics.root_relative_mpjpe(pred, gt, root=(1, 2), reduce="per_joint")
    # The root moves by half of joint 1's 10 mm.
    np.testing.assert_allclose(errors, 5.0)
    pred[0, 0] = np.nan
    assert np.isnan(metrics.root_relative_mpjpe(pred, gt, root=0, reduce="per_pose")[0])


def test_procrustes_removes_a_similarity(rng):
    gt = poses(rng)
    pred = 0.7 * gt @ rotation((1, 2, 3), 2.0).T + np.array([1000.0, 0.0, -300.0])
    assert metrics.mpjpe(pred, gt) > 100.0
    assert metrics.pa_mpjpe(pred, gt) < 1e-9


def test_procrustes_does_not_reflect(rng):
    gt = poses(rng)
    assert metrics.pa_mpjpe(gt * (-1.0, 1.0, 1.0), gt) > 50.0


def test_procrustes_uses_only_present_joints(rng):
    gt = poses(rng)
    pred = 1.2 * gt + 50.0
    pred[:, 2] = np.nan
    gt[:, 4] = np.nan
    errors = metrics.pa_mpjpe(pred, gt, reduce="per_joint")
    assert np.isnan(errors[[2, 4]]).all()
    assert np.nanmax(errors) < 1e-9
    pred[0, :4] = np.nan
    assert np.isnan(metrics.pa_mpjpe(pred, gt, reduce="per_pose")[0])


def test_pck_counts_the_threshold_as_correct_and_missing_as_wrong():
    gt = np.zeros((1, 4, 3))
    pred = np.zeros((1, 4, 3))
    pred[0, 0, 0], pred[0, 1, 0], pred[0, 2, 0] = 100.0, 100.1, np.nan
    assert metrics.pck(pred, gt, threshold_mm=100.0) == 0.5
    np.testing.assert_array_equal(metrics.pck(pred, gt, threshold_mm=100.0, reduce="none"), [[1, 0, 0, 1]])


def test_auc_is_the_mean_pck_from_0_to_150_mm():
    gt = np.zeros((1, 2, 3))
    pred = np.zeros((1, 2, 3))
    pred[0, 1, 0] = 75.0
    # 75 mm is correct at 75, 80, …, 150: 16 of the 31 thresholds; the other joint at all.
    assert metrics.auc(pred, gt) == pytest.approx((1 + 16 / 31) / 2)
    assert metrics.auc(pred, gt, thresholds_mm=[50.0, 100.0]) == 0.75
    np.testing.assert_allclose(metrics.auc(pred, gt, reduce="per_joint"), [1.0, 16 / 31])


def test_pcp_takes_the_mean_of_the_two_endpoint_errors():
    gt = np.array([[[0.0, 0, 0], [100, 0, 0], [200, 0, 0], [300, 0, 0]]])
    pred = gt.copy()
    pred[0, 1, 1] = 99.0
    pred[0, 2, 1] = 2.0
    # Half the length is 50: limb (0,1) errs by 49.5, (1,2) by 50.5, (2,3) by 1.
    limbs = [(0, 1), (1, 2), (2, 3)]
    np.testing.assert_array_equal(metrics.pcp(pred, gt, limbs, reduce="per_joint"), [1, 0, 1])
    assert metrics.pcp(pred, gt, limbs) == pytest.approx(2 / 3)
    assert metrics.pcp(pred, gt, limbs, alpha=0.51) == 1.0
    # The centre of joints 0 and 1 is off by 49.5, joint 3 by nothing.
    assert metrics.pcp(pred, gt, [((0, 1), 3)], alpha=0.1) == 1.0
    pred[0, 0] = np.nan
    gt[0, 3] = np.nan
    np.testing.assert_array_equal(metrics.pcp(pred, gt, limbs, reduce="per_joint"), [0, 0, np.nan])


def test_sigma_coverage_of_gaussian_errors_is_chi_square_with_three_degrees(rng):
    n = 20_000
    root = np.array([[30.0, 0, 0], [10.0, 5.0, 0], [-4.0, 2.0, 60.0]])
    gt = np.zeros((n, 1, 3))
    pred = rng.standard_normal((n, 1, 3)) @ root.T
    covariance = np.broadcast_to(root @ root.T, (n, 1, 3, 3))
    # Chi-square with 3 degrees at 1, 4, 9; 4 standard errors of a share p: 4·√(p(1−p)/n) ≤ 0.0142.
    np.testing.assert_allclose(
        metrics.sigma_coverage(pred, covariance, gt), [0.19875, 0.73854, 0.97071], atol=0.0142
    )


def test_sigma_coverage_excludes_missing_and_keeps_joints_apart():
    gt, pred = np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    pred[0, 1, 0], pred[1, 1, 0], pred[0, 2, 0] = 15.0, 25.0, np.nan
    covariance = np.broadcast_to(100.0 * np.eye(3), (2, 3, 3, 3)).copy()
    covariance[1, 2] = np.nan
    got = metrics.sigma_coverage(pred, covariance, gt, reduce="per_joint")
    np.testing.assert_array_equal(got, [[1, 0, np.nan], [1, 0.5, np.nan], [1, 1, np.nan]])


GT = np.zeros((2, 4, 3))


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: metrics.mpjpe(GT[..., :2], GT), "pred"),
        (lambda: metrics.mpjpe(GT + np.inf, GT), "pred"),
        (lambda: metrics.mpjpe(GT, GT, reduce="sum"), "reduce"),
        (lambda: metrics.root_relative_mpjpe(GT, GT, root=4), "root"),
        (lambda: metrics.pck(GT, GT, threshold_mm=-1.0), "threshold_mm"),
        (lambda: metrics.auc(GT, GT, thresholds_mm=[]), "thresholds_mm"),
        (lambda: metrics.pcp(GT, GT, []), "limbs"),
        (lambda: metrics.sigma_coverage(GT, GT, GT), "covariance"),
        (lambda: metrics.sigma_coverage(GT, np.zeros((2, 4, 3, 3)), GT), "covariance[0, 0]"),
    ],
)
def test_bad_input_is_named(call, argument):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.argument == argument


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
