"""The articulated body, its motions and the rigs that see it: each does what it is called."""

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.synthetic import skeleton

SEEDS = range(2)
# 8 s: longer than one round of any motion.
FRAMES = 400
J = {name: k for k, name in enumerate(skeleton.JOINT_NAMES)}
LEFT = [J[n] for n in skeleton.JOINT_NAMES if n.startswith("left")]
RIGHT = [J[skeleton.JOINT_NAMES[k].replace("left", "right")] for k in LEFT]
ANKLES = [J["left_ankle"], J["right_ankle"]]


def clip(name, seed):
    return synthetic.motion(name, FRAMES, seed=seed)


def heading(pose):
    """Direction the pelvis faces, radians, unwrapped over time."""
    across = pose[:, J["left_hip"]] - pose[:, J["right_hip"]]
    return np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))


def test_rest_pose_stands_upright_with_left_on_the_left():
    pose = skeleton.forward_kinematics({})[0]
    assert 1400 < pose[J["head"], 2] - pose[J["left_ankle"], 2] < 1750
    assert (pose[LEFT, 1] > 0).all()
    np.testing.assert_allclose(pose[LEFT] * (1, -1, 1), pose[RIGHT])
    assert pose[J["nose"], 0] > 0
    assert pose[J["left_wrist"], 2] < pose[J["left_elbow"], 2] < pose[J["left_shoulder"], 2]


def bone_lengths(points):
    """Length of the bone from each joint to its parent, joints 1 to 16."""
    return np.linalg.norm(points[..., 1:, :] - points[..., skeleton.PARENTS[1:], :], axis=-1)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: synthetic.in_layout(np.zeros((3, 3)), sk.layouts.H36M17), "points"),
        (lambda: synthetic.motion("fly", 3), "name"),
        (lambda: synthetic.motion("walk", 0), "n_frames"),
        (lambda: synthetic.dome(32), "n_views"),
        (lambda: synthetic.dome(radius_mm=float("nan")), "radius_mm"),
    ],
)
def test_bad_input_is_named(call, argument):
    with pytest.raises(sk.InvalidInputError) as caught:
        call()
    assert caught.value.argument == argument


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", synthetic.motion_names)
class TestEveryMotion:
    def test_bones_keep_their_length_and_are_the_same_left_and_right(self, name, seed):
        lengths = bone_lengths(clip(name, seed))
        np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], lengths.shape))
        np.testing.assert_allclose(lengths[:, np.array(LEFT) - 1], lengths[:, np.array(RIGHT) - 1])

    def test_one_foot_stands_and_nothing_is_below_the_floor(self, name, seed):
        pose = clip(name, seed)
        lowest = pose[:, ANKLES, 2].min(axis=1)
        # The soft minimum may leave the lower ankle ln 2 × 8 mm = 5.5 mm under its height, never above.
        assert (lowest <= skeleton.ANKLE_HEIGHT_MM + 1e-9).all()
        assert (lowest >= skeleton.ANKLE_HEIGHT_MM - 5.6).all()
        assert (pose[..., 2] > 0).all()

    def test_moves_smoothly_within_the_room(self, name, seed):
        pose = clip(name, seed)
        assert np.isfinite(pose).all()
        assert (np.linalg.norm(pose[..., :2], axis=-1) < 2000).all()
        # A walker's foot reaches 4 to 5 m/s in swing and 30 to 50 m/s² at its ends; a jump far more.
        assert (np.linalg.norm(np.diff(pose, axis=0), axis=-1) * 50 < 7_000).all()
        assert (np.linalg.norm(np.diff(pose, n=2, axis=0), axis=-1) * 50**2 < 70_000).all()

    def test_seed_decides(self, name, seed):
        ours, other = (clip(name, seed + k) - clip(name, seed + k)[:, :1] for k in (0, 100))
        assert np.linalg.norm(ours - other, axis=-1).mean() > 20.0
        again = synthetic.motion(name, 10, seed=np.random.default_rng(seed))
        np.testing.assert_array_equal(again, clip(name, seed)[:10])


@pytest.mark.parametrize("seed", SEEDS)
def test_walk_goes_where_the_body_faces_with_alternating_steps(seed):
    pose = clip("walk", seed)
    velocity = np.diff(pose[:, 0, :2], axis=0) * 50
    speed = np.linalg.norm(velocity, axis=1)
    assert ((speed > 700) & (speed < 2000)).all()
    facing = heading(pose)[:-1]
    forward = (velocity * np.stack([np.cos(facing), np.sin(facing)], axis=1)).sum(axis=1)
    assert (forward > 0.95 * speed).all()
    ahead = pose[:, J["left_ankle"]] - pose[:, J["right_ankle"]]
    lead = ahead[:, 0] * np.cos(heading(pose)) + ahead[:, 1] * np.sin(heading(pose))
    # 8 s at a stride of 1.0 to 1.3 s: the leading foot changes twice a stride, 12 to 16 times.
    assert 11 <= (np.diff(np.sign(lead)) != 0).sum() <= 17
    assert lead.max() > 400
    assert lead.min() < -400


@pytest.mark.parametrize(
    ("make", "target"),
    [
        *((make, (0, 0, 900)) for make in (synthetic.human36m_like, synthetic.dome, synthetic.stereo)),
        (synthetic.table, (0, 0, 0)),
    ],
)
def test_images_are_upright_and_centred_on_the_target(make, target):
    for view in make():
        there, above = sk.project(np.array([target, np.add(target, (0, 0, 10))], float), [view])[0]
        np.testing.assert_allclose(there, (np.array(view.size) - 1) / 2, atol=1e-9)
        assert above[1] < there[1]
        assert above[0] == pytest.approx(there[0], abs=1e-9)


def test_look_at_without_an_upright_image_is_refused():
    with pytest.raises(sk.DegenerateGeometryError):
        synthetic.look_at((0, 0, 5), (0, 0, 0))


@pytest.mark.parametrize("name", synthetic.motion_names)
def test_every_motion_stays_inside_the_human36m_like_images(name):
    for seed in range(3):
        pixels = sk.project(synthetic.motion(name, 200, seed=seed), synthetic.human36m_like())
        assert (pixels > 0).all()
        assert (pixels < 999).all()


def test_dome_cameras_sit_on_the_dome_and_look_different_ways():
    views = synthetic.dome()
    offsets = np.array([-view.R.T @ view.t for view in views]) - (0, 0, 900)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 2800)
    assert (offsets[:, 2] + 900 > 0).all()
    cosines = offsets @ offsets.T / 2800**2 - 2 * np.eye(31)
    assert np.rad2deg(np.arccos(cosines.max())) > 8.0
    np.testing.assert_array_equal([v.t for v in synthetic.dome(5)], [v.t for v in views[:5]])
