"""Recordings that were once wrong without a word: honest error bars, a status or a finding."""

from __future__ import annotations

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from cases import BODY, FPS, WRIST, WRISTS, exchanged, exercise, moved, still
from cases import seen as detected
from scenarios import Scene

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.findings import FindingWarning, collected_warnings
from skelsplat.run.bones import find_bones
from sweeps import swept

RIG = synthetic.human36m_like()


def moving(frames=150, motion="walk", seed=0, factor=1.0):
    """Return a moving person and detections with lasting errors, ``factor`` times the usual ones."""
    return scene(synthetic.motion(motion, frames, fps=FPS, seed=seed), seed, factor)


def scene(truth, seed=0, factor=1.0):
    return Scene(truth, detected(truth, RIG, seed, factor), RIG, "h36m17", "")


def solved(seen, rig=RIG, over_time=True, **settings):
    config = sk.RefineConfig(**settings)
    if not over_time:
        return sk.refine(None, seen.detections, rig, layout=BODY, config=config)
    return sk.refine_sequence(seen.detections, rig, fps=FPS, layout=BODY, config=config)


def inside(seen, result, joints=slice(None)):
    """Return which joints (3, T, N) are within 1, 2 and 3 σ."""
    shares = sk.metrics.sigma_coverage(result.pose, result.uncertainty, seen.truth, reduce="none")
    return shares[:, :, joints]


def error(seen, result):
    return np.linalg.norm(result.pose - seen.truth, axis=-1)


@pytest.mark.parametrize("over_time", [True, False])
@pytest.mark.parametrize("weights", [None, [10.0, 1.0, 1.0, 1.0]])
def test_a_camera_does_not_vote_for_itself(weights, over_time):
    found = []
    for k, motion in enumerate(("walk", "reach", "wave")):
        seen = moving(motion=motion, seed=k)
        if weights is None:
            seen.detections[:, 1:, :, 2] *= 0.1
        found.append(inside(seen, solved(seen, over_time=over_time, view_weights=weights)))
    assert np.concatenate(found, axis=1)[2].mean() >= 0.92


@pytest.mark.parametrize("px", [6.0, 10.0, 20.0])
def test_wrists_have_their_own_noise(px):
    added = np.random.default_rng(1).normal(0.0, px, (150, 4, 2, 2))
    seen = moved(moving(motion="reach", seed=1), added, WRISTS)
    assert inside(seen, solved(seen), WRISTS)[2].mean() >= 0.88
    alone = solved(seen, over_time=False)
    sure = alone.joint_status[:, WRISTS] == "ok"
    assert (sure & (inside(seen, alone, WRISTS)[2] == 0)).mean() < 0.2


def test_noise_may_grow():
    added = np.random.default_rng(1).normal(0.0, 15.0, (200, 4, 17, 2))
    added[:100] = 0.0
    seen = moved(moving(200, "wave", 2), added)
    shares = inside(seen, solved(seen))[2]
    assert min(shares.mean(), shares[100:].mean()) >= 0.9


@pytest.mark.parametrize("factor", [3.3, 4.6])
def test_large_noise_has_bars_of_its_size(factor):
    takes = [
        moving(motion=motion, seed=k, factor=factor) for k, motion in enumerate(("walk", "reach", "wave"))
    ]
    shares = [inside(seen, solved(seen)).mean(axis=(1, 2)) for seen in takes]
    assert np.abs(np.mean(shares, axis=0) - [0.199, 0.739, 0.971]).max() < 0.08


@pytest.mark.parametrize("part", [slice(40, 50), slice(30, 75)])
def test_the_pose_before_and_after_decides_the_sides(part):
    seen = moving(100)
    result = solved(exchanged(seen, part, range(4), range(17)))
    assert error(seen, result)[part].mean() < 30.0
    assert result.swapped[part].any()


@pytest.mark.parametrize("frames", [slice(40, 60), slice(0, 100)])
def test_a_bone_that_no_body_has_is_not_ok(frames):
    """Three views take a wrist for an object 2 m above it."""
    seen = moving(100)
    away = sk.project(seen.truth + np.array([0.0, 0.0, 2000.0]), RIG).swapaxes(0, 1)
    seen.detections[frames, :3, WRIST, :2] = away[frames, :3, WRIST]
    result = solved(seen)
    assert (error(seen, result)[frames, WRIST] > 500.0).any()
    assert not (result.joint_status[frames, WRIST] == "ok").any()
    assert inside(seen, result, [WRIST])[2].mean() > 0.9


@pytest.mark.parametrize("factor", [0.05, 0.2, 8.0, 10.0])
def test_the_size_of_the_world_does_not_matter(factor):
    truth, errors = synthetic.motion("walk", 80, fps=FPS, seed=0), []
    noise = synthetic.DetectionNoise.recording_occluded(3, frame_rate=FPS)
    detections = synthetic.simulate_detections(truth, RIG, noise=noise, layout=BODY, seed=0)
    for size in (1.0, factor):
        rig = sk.CameraRig([sk.Camera(K=c.K, R=c.R, t=size * np.asarray(c.t), size=c.size) for c in RIG])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FindingWarning)  # of a body of such a size
            result = sk.refine_sequence(detections, rig, fps=FPS, layout=BODY)
        errors.append(np.linalg.norm(result.pose / size - truth, axis=-1).mean())
    assert errors[1] == pytest.approx(errors[0], rel=0.02)


def findings(seen, layout=BODY):
    """Return the findings on bones of a recording."""
    result = sk.refine(None, seen.detections, RIG, layout=layout)
    alone = SimpleNamespace(result=result, config=sk.RefineConfig())
    return list(find_bones(SimpleNamespace(layout=layout, rig=RIG), alone))


@pytest.mark.parametrize(("first", "then"), [(1.57, 1.93), (0.91, 1.80), (1.7, 1.7)])
def test_lengths_that_change_are_said(first, then):
    truth = synthetic.motion("walk", 300, fps=FPS, seed=0)
    place = truth[:, :1] * [1.0, 1.0, 0.0]
    size = np.repeat([first, then], 150)[:, None, None] / 1.7
    found = findings(scene(place + (truth - place) * size))
    assert [finding.kind for finding in found] == ["lengths_change"] * (first != then)
    for finding in found:
        assert finding.numbers["change"] == pytest.approx(then / first - 1, rel=0.25)
        assert finding.numbers["frame"] == pytest.approx(150, abs=25)


def test_a_limb_whose_length_varies_is_no_bone():
    layout = sk.Layout("wrong", BODY.joints, limbs=[*BODY.limbs, WRISTS], left_right=BODY.left_right)
    (found,) = findings(moving(150, "wave", 1), layout)
    assert found.kind == "limb_lengths_vary"
    assert set(found.subject.joints) == {"left_wrist", "right_wrist"}


@pytest.mark.parametrize("wrong", [("hip", "knee"), ("elbow", "wrist")])
def test_joints_in_another_order_make_no_person(wrong):
    pairs = [[BODY.joints.index(f"{side}_{one}") for one in wrong] for side in ("left", "right")]
    detections = moving(60).detections.copy()
    for pair in pairs:
        detections[:, :, pair] = detections[:, :, pair[::-1]]
    (found,) = findings(SimpleNamespace(detections=detections))
    assert found.kind == "bones_unlike_people"


def test_neither_a_period_nor_stillness_is_a_lag():
    squats = exercise("squats", 2.0, np.random.default_rng([0, 4, 0]))[:45]
    sitting = still("sitting", np.random.default_rng([0, 3, 0]))[:100]
    for motion in (squats, sitting):
        report = sk.adjust_cameras(detected(motion, RIG, 0), RIG, clock=True).report
        assert {one.status for one in report} == {"sound"}


@pytest.mark.parametrize(
    ("name", "hz", "late"), [("squats", 2.0, 20), swept("still", 0, 5), swept("curls", 1.0, 3)]
)
def test_a_lag_that_cannot_be_told_is_in_doubt_or_within_the_bar(name, hz, late):
    rng = np.random.default_rng(0)
    motion = exercise(name, hz, rng) if hz else still("standing", rng)
    detections = detected(motion[late:], RIG, 0)
    detections[:, 1] = detected(motion[:-late], RIG, 1)[:, 1]
    for i, one in enumerate(sk.adjust_cameras(detections, RIG, clock=True).report):
        assert one.status == ("doubtful" if hz and i == 1 else "sound")
        assert abs(one.clock - late * (i == 1)) < 2.0 * one.clock_sigma


def test_lengths_are_those_of_the_recording_in_a_part_that_shows_none():
    seen = moving(1300).detections
    seen[450:] = np.nan
    parts = list(sk.refine_batches(seen, RIG, fps=8.0, layout=BODY, frames_per_chunk=600))
    whole = sk.refine_sequence(seen, RIG, fps=8.0, layout=BODY)
    for part in parts:
        np.testing.assert_array_equal(part.bone_lengths, whole.bone_lengths)
    np.testing.assert_array_equal(
        np.isinf([part.bone_length_sigma[0] for part in parts]), [False, True, True]
    )


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
