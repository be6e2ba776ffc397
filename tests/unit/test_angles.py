"""Joint angles: against poses built from angles, and central differences."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

import skelsplat as sk
from skelsplat._arrays import Array

LAYOUT = sk.layouts.HALPE26
PLACE = {name: k for k, name in enumerate(LAYOUT.joints)}
SIDES = ("left", "right")
# x forward, y left, z up, in mm
STANDING = {
    "hip": (0, 120, 900),
    "knee": (0, 120, 480),
    "ankle": (0, 120, 80),
    "heel": (-60, 120, 30),
    "big_toe": (180, 120, 30),
    "small_toe": (160, 170, 30),
    "shoulder": (0, 180, 1400),
    "elbow": (0, 180, 1100),
    "wrist": (0, 180, 850),
}


def standing() -> Array:
    """Upright, facing x, arms hanging."""
    pose = np.full((LAYOUT.n_joints, 3), 1500.0)
    for joint, (x, y, z) in STANDING.items():
        pose[PLACE[f"left_{joint}"]] = (x, y, z)
        pose[PLACE[f"right_{joint}"]] = (x, -y, z)
    return pose


def posed(**places: tuple[float, float, float]) -> Array:
    """`standing` with some joints elsewhere."""
    pose = standing()
    for joint, place in places.items():
        pose[PLACE[joint]] = place
    return pose


def random_pose(seed: int) -> Array:
    return standing() + np.random.default_rng(seed).normal(0.0, 150.0, (LAYOUT.n_joints, 3))


def random_covariance(seed: int, n_joints: int = LAYOUT.n_joints) -> Array:
    factor = np.random.default_rng(seed).normal(0.0, 5.0, (n_joints, 3, 3))
    return factor @ np.swapaxes(factor, -1, -2)


def angles(pose: Array, **options: object) -> sk.JointAngles:
    return sk.joint_angles(pose, layout=LAYOUT, **options)


def direction(a: float, b: float = 0.0) -> Array:
    """Of a limb that hangs down, swung forward by a and then raised to the left by b, in degrees."""
    a, b = np.radians([a, b])
    return np.array([np.sin(a) * np.cos(b), np.sin(b), -np.cos(a) * np.cos(b)])


# definitions


def test_all_angles_of_upright_standing_are_0() -> None:
    found = angles(standing())
    assert len(found.names) == 18
    np.testing.assert_allclose(found.degrees, 0.0, atol=1e-9)
    assert np.isnan(found.sigma).all()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("swung", [-60.0, 35.0, 170.0])
@pytest.mark.parametrize("raised", [-10.0, 50.0])
def test_limbs_have_the_angles_they_are_built_with(side: str, swung: float, raised: float) -> None:
    outward = 1.0 if side == "left" else -1.0
    for upper, joint in (("shoulder", "elbow"), ("hip", "knee")):
        pose = standing()
        pose[PLACE[f"{side}_{joint}"]] = pose[PLACE[f"{side}_{upper}"]] + 300 * direction(
            swung, outward * raised
        )
        found = angles(pose)
        assert found[f"{side}_{upper}_flexion"] == pytest.approx(swung)
        assert found[f"{side}_{upper}_abduction"] == pytest.approx(raised)


@pytest.mark.parametrize("bend", [0.0, 20.0, 90.0, 150.0])
def test_knees_elbows_and_ankles(bend: float) -> None:
    pose = standing()
    pose[PLACE["left_ankle"]] = pose[PLACE["left_knee"]] + 400 * direction(-bend)
    pose[PLACE["right_wrist"]] = pose[PLACE["right_elbow"]] + 250 * direction(bend)
    raised = np.radians(bend / 6)
    pose[PLACE["right_big_toe"]] = pose[PLACE["right_heel"]] + 240 * np.array(
        [np.cos(raised), 0, np.sin(raised)]
    )
    found = angles(pose)
    assert found["left_knee_flexion"] == pytest.approx(bend, abs=1e-6)
    assert found["right_elbow_flexion"] == pytest.approx(bend, abs=1e-6)
    assert found["right_ankle_dorsiflexion"] == pytest.approx(bend / 6)


def test_trunk_and_pelvis_lean_against_the_vertical() -> None:
    pose = standing()
    middle = pose[[PLACE["left_hip"], PLACE["right_hip"]]].mean(axis=0)
    for side in SIDES:  # 30° forward, then 20° to the left
        pose[PLACE[f"{side}_shoulder"]] += middle - 500 * direction(-30.0, -20.0) - (0, 0, 1400)
    found = angles(pose)
    assert found["trunk_forward_lean"] == pytest.approx(30.0)
    assert found["trunk_side_lean"] == pytest.approx(20.0)
    total = np.degrees(np.arccos(np.cos(np.radians(30.0)) * np.cos(np.radians(20.0))))
    assert found["trunk_inclination"] == pytest.approx(total)
    hip = 240 * np.sin(np.radians(10.0))
    pose = posed(left_hip=(0, -120 + 240 * np.cos(np.radians(10.0)), 900 + hip), right_hip=(0, -120, 900))
    assert angles(pose)["pelvis_obliquity"] == pytest.approx(10.0)  # the left hip is higher
    assert [name for name in found.names if name not in angles(pose, up=None).names] == [
        "trunk_inclination",
        "trunk_forward_lean",
        "trunk_side_lean",
        "pelvis_obliquity",
    ]


def test_the_world_may_be_turned_moved_and_scaled() -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    pose, covariance = random_pose(2), random_covariance(2)
    here = angles(pose, uncertainty=covariance)
    there = angles(
        0.001 * pose @ turn.T + 5.0, uncertainty=1e-6 * turn @ covariance @ turn.T, up=3 * turn[:, 2]
    )
    np.testing.assert_allclose(there.degrees, here.degrees, atol=1e-7)
    np.testing.assert_allclose(there.sigma, here.sigma, rtol=1e-7)
    np.testing.assert_array_equal(angles(pose[:, [0, 2, 1]] * [1, -1, 1], up="-y").names, here.names)


# error bars


@pytest.mark.parametrize("seed", range(3))
def test_error_bars_are_those_of_central_differences(seed: int) -> None:
    """Differences over ±0.1 µm: the angles' third derivatives leave 1e-9, rounding 1e-7 of a gradient."""
    pose, covariance = random_pose(seed), random_covariance(seed)
    found = angles(pose, uncertainty=covariance)
    step = 1e-4
    shifts = step * np.eye(pose.size).reshape(pose.size, 1, *pose.shape)  # each a sequence of one frame
    ahead, behind = (angles(pose + sign * shifts).degrees[:, 0] for sign in (1.0, -1.0))
    gradient = ((ahead - behind) / (2 * step)).T.reshape(len(found.names), *pose.shape)
    variance = np.einsum("ani,nij,anj->a", gradient, covariance, gradient)
    np.testing.assert_allclose(found.sigma, np.sqrt(variance), rtol=1e-6)


def test_straight_limbs_have_an_error_bar() -> None:
    """At 0° the angle has no derivative; each end counts with its distance across the limb."""
    covariance = np.broadcast_to(4.0 * np.eye(3), (LAYOUT.n_joints, 3, 3))
    sigma = angles(standing(), uncertainty=covariance).sigma
    thigh, shank = 420.0, 400.0
    expected = 2.0 * np.sqrt(1 / thigh**2 + (1 / thigh + 1 / shank) ** 2 + 1 / shank**2)
    assert sigma[angles(standing()).names.index("left_knee_flexion")] == pytest.approx(np.degrees(expected))
    assert np.isfinite(sigma).all()


# what is missing, and time


def test_missing_and_coinciding_joints_give_nan() -> None:
    pose = random_pose(5)
    pose[PLACE["right_knee"]] = np.nan
    pose[PLACE["left_wrist"]] = pose[PLACE["left_elbow"]]
    found = angles(pose, uncertainty=random_covariance(5))
    expected = [
        *(f"right_{name}" for name in ("hip_flexion", "hip_abduction", "knee_flexion", "ankle_dorsiflexion")),
        "left_elbow_flexion",
    ]
    for values in (found.degrees, found.sigma):
        assert {name for name, value in zip(found.names, values, strict=True) if np.isnan(value)} == set(
            expected
        )


def circling(swung: Array) -> Array:
    pose = np.repeat(standing()[None], len(swung), axis=0)
    pose[:, PLACE["left_elbow"]] = pose[:, PLACE["left_shoulder"]] + [
        300 * direction(angle, 20.0) for angle in swung
    ]
    return pose


def test_turns_are_counted_along_the_axis_of_time() -> None:
    swung = np.arange(0.0, 1000.0, 20.0)
    pose = circling(swung)
    np.testing.assert_allclose(angles(pose)["left_shoulder_flexion"], swung, atol=1e-9)
    backwards = angles(circling(-swung))["left_shoulder_flexion"]
    np.testing.assert_allclose(backwards, -swung, atol=1e-9)
    both = np.stack([pose, pose[::-1]])
    np.testing.assert_allclose(
        angles(both)["left_shoulder_flexion"][1], angles(pose[::-1])["left_shoulder_flexion"]
    )
    single = angles(pose[30])["left_shoulder_flexion"]
    assert single == pytest.approx((swung[30] + 90) % 360 - 90)


def test_after_a_gap_turns_are_counted_anew() -> None:
    swung = np.arange(0.0, 600.0, 20.0)
    pose = circling(swung)
    pose[20, PLACE["left_elbow"]] = np.nan
    found = angles(pose)["left_shoulder_flexion"]
    np.testing.assert_allclose(found[:20], swung[:20], atol=1e-9)
    np.testing.assert_allclose(found[21:], swung[21:] - 360.0, atol=1e-9)


# a layout's own


def with_own(*own: tuple[object, ...]) -> sk.Layout:
    return sk.Layout("own", LAYOUT.joints, angles=own)


def test_own_angles_are_those_of_two_segments_with_error_bars() -> None:
    pose, covariance = random_pose(8), random_covariance(8)
    layout = with_own(
        ("knee", ["left_hip", "left_knee", "left_ankle"], 1, 0),
        ("ankle", ["left_ankle", "left_knee", "left_heel", "left_big_toe"], -1, 90),
        ("right_elbow_flexion", ["right_wrist", "right_elbow", "right_shoulder"], 1, 10),
    )
    found = sk.joint_angles(pose, layout=layout, uncertainty=covariance)
    known = angles(pose, uncertainty=covariance)
    assert found.names[-3:] == ("knee", "ankle", "right_elbow_flexion")
    assert sorted(found.names) == sorted((*known.names, "knee", "ankle"))  # one is replaced
    same = {"knee": "left_knee_flexion", "ankle": "left_ankle_dorsiflexion"}
    for own, name in {**same, "right_elbow_flexion": "right_elbow_flexion"}.items():
        here, there = found.names.index(own), known.names.index(name)
        offset = 10 * (own == name)
        assert found.degrees[here] == pytest.approx(known.degrees[there] + offset, abs=1e-9)
        assert found.sigma[here] == pytest.approx(known.sigma[there], rel=1e-9)


def test_a_hand_has_the_angles_of_its_fingers() -> None:
    hand = sk.layouts.get("hand21")
    pose = np.zeros((hand.n_joints, 3))
    pose[:, 0] = np.arange(hand.n_joints)  # all in line, but for the first joints of the fingers
    found = sk.joint_angles(pose, layout=hand)
    assert len(found.names) == 14
    assert found["index_finger_pip_flexion"] == 0.0
    pose[hand.joints.index("index_finger_dip")] = pose[hand.joints.index("index_finger_pip")] + (0, 0, -1)
    assert sk.joint_angles(pose, layout=hand)["index_finger_pip_flexion"] == pytest.approx(90.0)


# input


def test_a_refinement_brings_its_error_bars() -> None:
    pose = random_pose(6)[None]
    covariance = random_covariance(6)[None]
    empty = dict.fromkeys((entry.name for entry in fields(sk.Refinement)), np.empty(0))
    result = sk.Refinement(
        **{**empty, "pose": pose, "uncertainty": covariance, "joint_bias": np.full((1, 26), 3.0)}
    )
    found = sk.joint_angles(result, layout="halpe26")
    np.testing.assert_array_equal(found.sigma, angles(pose, uncertainty=covariance + 9 * np.eye(3)).sigma)
    scatter = sk.joint_angles(result, layout="halpe26", uncertainty=result.uncertainty)
    assert (scatter.sigma < found.sigma).all()


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"pose": np.zeros((17, 3))}, "pose"),
        ({"uncertainty": np.zeros((26, 3))}, "uncertainty"),
        ({"up": "w"}, "up"),
        ({"up": [0, 0, 0]}, "up"),
    ],
)
def test_bad_input_is_named(options: dict[str, object], argument: str) -> None:
    with pytest.raises(sk.InvalidInputError) as caught:
        sk.joint_angles(**{"pose": standing(), "layout": LAYOUT, **options})
    assert caught.value.argument == argument


def test_a_layout_without_angles_is_refused() -> None:
    with pytest.raises(sk.InvalidInputError, match="layout: expected angles, or joints of one"):
        sk.joint_angles(np.zeros((38, 3)), layout="fly38")
