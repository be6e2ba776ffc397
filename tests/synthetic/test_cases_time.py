"""Recordings in time that were once wrong without a word: honest error bars, a status or a finding."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import skelsplat as sk
from cases import time as cases
from skelsplat.findings import FindingWarning
from skelsplat.run.bones import find_bones

MOTIONS = ("walk", "reach", "wave")


def solved(detections, rig=cases.RIG, layout=cases.BODY, **settings):
    return sk.refine_sequence(
        detections, rig, fps=cases.FPS, layout=layout, config=sk.RefineConfig(**settings)
    )


def inside(result, truth, joints=slice(None)):
    """Return which joints (3, T, N) are within 1, 2 and 3 σ."""
    return sk.metrics.sigma_coverage(result.pose, result.uncertainty, truth, reduce="none")[:, :, joints]


@pytest.mark.parametrize("weights", [None, [10.0, 1.0, 1.0, 1.0]])
def test_a_camera_does_not_vote_for_itself(weights):
    found = []
    for k, motion in enumerate(MOTIONS):
        truth = cases.moving(motion=motion, seed=k)
        detections = cases.seen(truth, seed=k)
        detections = detections if weights else cases.unequal(detections)
        found.append(inside(solved(detections, view_weights=weights), truth))
    assert np.concatenate(found, axis=1)[2].mean() >= 0.92


@pytest.mark.parametrize("px", [6.0, 10.0, 20.0])
def test_wrists_have_their_own_noise(px):
    truth = cases.moving(motion="reach", seed=1)
    result = solved(cases.shaken(cases.seen(truth, seed=1), px, cases.WRISTS))
    assert inside(result, truth, cases.WRISTS)[2].mean() >= 0.88


def test_noise_may_grow():
    truth = cases.moving(200, "wave", 2)
    result = solved(cases.shaken(cases.seen(truth, seed=2), 15.0, list(range(17)), first=100))
    shares = inside(result, truth)[2]
    assert min(shares.mean(), shares[100:].mean()) >= 0.9


@pytest.mark.parametrize("factor", [3.3, 4.6])
def test_large_noise_has_bars_of_its_size(factor):
    shares = []
    for k, motion in enumerate(MOTIONS):
        truth = cases.moving(motion=motion, seed=k)
        shares.append(inside(solved(cases.seen(truth, factor, seed=k)), truth).mean(axis=(1, 2)))
    assert np.abs(np.mean(shares, axis=0) - [0.199, 0.739, 0.971]).max() < 0.08


def test_the_pose_before_and_after_decides_the_sides():
    truth = cases.moving(100)
    result = solved(cases.exchanged(cases.seen(truth), slice(40, 50)))
    error = np.linalg.norm(result.pose - truth, axis=-1)
    assert error[40:50].mean() < 30.0
    assert result.swapped[40:50].any()


@pytest.mark.parametrize("frames", [slice(40, 60), slice(0, 100)])
def test_a_bone_that_no_body_has_is_not_ok(frames):
    truth = cases.moving(100)
    result = solved(cases.elsewhere(cases.seen(truth), truth, frames))
    wrist = cases.WRISTS[0]
    assert (np.linalg.norm(result.pose - truth, axis=-1)[frames, wrist] > 500.0).any()
    assert not (result.joint_status[frames, wrist] == "ok").any()
    assert inside(result, truth, [wrist])[2].mean() > 0.9


@pytest.mark.parametrize("factor", [0.05, 0.2, 8.0, 10.0])
def test_the_size_of_the_world_does_not_matter(factor):
    truth, errors = cases.moving(80), []
    for size in (1.0, factor):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FindingWarning)  # of a body of such a size
            result = solved(cases.seen(truth, hidden=3), cases.resized(size))
        errors.append(np.linalg.norm(result.pose / size - truth, axis=-1).mean())
    assert errors[1] == pytest.approx(errors[0], rel=0.02)


def findings(detections, layout=cases.BODY):
    """Return the findings on bones of a recording."""
    alone = SimpleNamespace(result=sk.refine(None, detections, cases.RIG, layout=layout))
    return list(find_bones(SimpleNamespace(layout=layout, rig=cases.RIG), alone))


@pytest.mark.parametrize(("first", "then"), [(1.57, 1.93), (0.91, 1.80), (1.7, 1.7)])
def test_lengths_that_change_are_said(first, then):
    found = findings(cases.seen(cases.two_people(first, then)))
    assert [finding.kind for finding in found] == ["lengths_change"] * (first != then)
    for finding in found:
        assert finding.numbers["change"] == pytest.approx(then / first - 1, rel=0.25)
        assert finding.numbers["frame"] == pytest.approx(150, abs=25)


def test_a_limb_whose_length_varies_is_no_bone():
    limbs = [*cases.BODY.limbs, (cases.WRISTS[0], cases.WRISTS[1])]
    layout = sk.Layout("wrong", joints=cases.BODY.joints, limbs=limbs, left_right=cases.BODY.left_right)
    (found,) = findings(cases.seen(cases.moving(150, "wave", 1)), layout)
    assert found.kind == "limb_varies"
    assert set(found.subject.joints) == {"left_wrist", "right_wrist"}


def test_lengths_are_those_of_the_recording_in_a_part_that_shows_none():
    truth = cases.moving(1300)
    detections = cases.seen(truth)
    detections[450:] = np.nan
    parts = list(sk.refine_batches(detections, cases.RIG, fps=8.0, layout=cases.BODY, frames_per_chunk=600))
    whole = sk.refine_sequence(detections, cases.RIG, fps=8.0, layout=cases.BODY)
    for part in parts:
        np.testing.assert_array_equal(part.bone_lengths, whole.bone_lengths)
    np.testing.assert_array_equal(
        np.isinf([part.bone_length_sigma[0] for part in parts]), [False, True, True]
    )
