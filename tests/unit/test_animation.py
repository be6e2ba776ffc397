"""Animation files: what pymotion, pygltflib and Blender find in them."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from skelsplat import layouts, synthetic
from skelsplat.cameras import matrix_from_vector
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import FindingWarning, collected_warnings
from skelsplat.io import PoseData, write_pose
from skelsplat.io.poses import convert_poses

FPS, T = 50.0, 40
JOINTS = {
    "LeftUpLeg": "left_hip",
    "LeftLeg": "left_knee",
    "RightFoot": "right_ankle",
    "RightArm": "right_shoulder",
    "LeftForeArm": "left_elbow",
    "RightHand": "right_wrist",
}

pytestmark = pytest.mark.filterwarnings("ignore::skelsplat.findings.FindingWarning")
WITH_GLB = pytest.mark.skipif(not find_spec("pygltflib"), reason="pygltflib is not installed")


def walk(pose=None, layout="h36m17", frames=None, **others):
    pose = synthetic.motion("walk", T, fps=FPS) if pose is None else pose
    names = tuple(layouts.get(layout).joints)
    return PoseData(pose, names, np.arange(len(pose)) if frames is None else frames, "mm", **others)


def turn(axis, degrees):
    """Return rotations about a coordinate axis."""
    vectors = np.zeros((len(degrees), 3))
    vectors[:, axis] = np.radians(degrees)
    return np.stack([matrix_from_vector(vector) for vector in vectors])


def read_bvh(path):
    """Return what pymotion finds: by joint its places (T, 3), rotations against the parent, and offset."""
    file = pytest.importorskip("pymotion.io.bvh", reason="pymotion is not installed").BVH()
    from pymotion.rotations.quat_np import to_matrix

    file.load(str(path))
    quaternions, moves, parents, offsets, *_ = file.get_data()
    assert (file.data["rot_order"] == ["z", "x", "y"]).all()
    assert np.abs(np.diff(file.data["rotations"], axis=0)).max() < 180.0
    own = to_matrix(quaternions)
    places, world = moves.copy(), own.copy()
    for k, parent in enumerate(parents[1:], 1):
        places[:, k] = places[:, parent] + np.einsum("tij,tj->ti", world[:, parent], moves[:, k])
        world[:, k] = world[:, parent] @ own[:, k]
    names = file.data["names"].tolist()
    each = (dict(zip(names, np.moveaxis(one, k, 0), strict=True)) for one, k in ((places, -2), (own, -3)))
    return *each, dict(zip(names, offsets, strict=True)), file.data["frame_time"]


def read_glb(path):
    """Return by joint its places (T, 3), m, and the times."""
    import pygltflib
    from scipy.spatial import transform

    file = pygltflib.GLTF2().load(str(path))

    def values(accessor):
        one = file.accessors[accessor]
        start = file.bufferViews[one.bufferView].byteOffset
        numbers = np.frombuffer(
            file.binary_blob(), np.float32, one.count * {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[one.type], start
        )
        return numbers.reshape(one.count, -1).astype(float)

    (animation,) = file.animations
    moves = {}
    for channel in animation.channels:
        move = values(animation.samplers[channel.sampler].output)
        moves[channel.target.node, channel.target.path] = move
        assert channel.target.path != "rotation" or (move[1:] * move[:-1]).sum(axis=1).min() > 0.0
    times = values(animation.samplers[0].input)[:, 0]
    still = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
    places = {}

    def follow(node, begin, world):
        one = file.nodes[node]
        shift = moves.get((node, "translation"), np.tile(one.translation, (len(times), 1)))
        begin = begin + np.einsum("tij,tj->ti", world, shift)
        world = world @ transform.Rotation.from_quat(moves.get((node, "rotation"), still)).as_matrix()
        places[one.name] = begin
        for child in one.children:
            follow(child, begin, world)

    follow(file.scenes[0].nodes[0], np.zeros((len(times), 3)), np.tile(np.eye(3), (len(times), 1, 1)))
    return places, times


def upright(pose, name, layout="h36m17"):
    """Return a joint of a world with z up, in one with y up."""
    return pose[:, layouts.get(layout).joints.index(name)][:, [1, 2, 0]]


def test_bvh_places_the_joints_where_the_poses_do(tmp_path):
    data = walk()
    write_pose(tmp_path / "walk.bvh", data, frame_rate=FPS)
    places, own, offsets, time = read_bvh(tmp_path / "walk.bvh")
    for part, joint in JOINTS.items():
        np.testing.assert_allclose(10 * places[part], upright(data.pose, joint), atol=1.0)
    assert time == pytest.approx(1 / FPS)
    # the rest pose: arms sideways, legs down
    for part, axis, sign in (
        ("LeftForeArm", 0, 1),
        ("RightForeArm", 0, -1),
        ("LeftLeg", 1, -1),
        ("Neck", 1, 1),
    ):
        direction = offsets[part] / np.linalg.norm(offsets[part])
        assert direction[axis] * sign == pytest.approx(1.0, abs=1e-6)
    # knees bend backwards, about x
    bent = own["LeftLeg"][np.argmin(np.einsum("tii->t", own["LeftLeg"]))]
    assert bent[1, 2] == pytest.approx(-bent[2, 1], abs=1e-6)
    assert bent[2, 1] > 0.2


@WITH_GLB
def test_glb_and_bvh_say_the_same(tmp_path):
    pose = np.einsum("tij,tnj->tni", turn(2, np.linspace(0, 720, T)), synthetic.motion("walk", T, fps=FPS))
    for kind in ("bvh", "glb"):
        write_pose(tmp_path / f"walk.{kind}", walk(pose), frame_rate=FPS)
    places, *_ = read_bvh(tmp_path / "walk.bvh")
    in_metres, times = read_glb(tmp_path / "walk.glb")
    assert in_metres.keys() == places.keys()
    for part, place in places.items():
        np.testing.assert_allclose(100 * in_metres[part], place, atol=2e-3)
    np.testing.assert_allclose(times, np.arange(T) / FPS, atol=1e-6)


def test_an_arm_that_is_stretched_does_not_twist(tmp_path):
    """The plane of the elbow is lost where the arm is straight."""
    pose = np.repeat(synthetic.motion("walk", 1, fps=FPS), 60, axis=0)
    names = ("right_shoulder", "left_shoulder", "left_elbow", "left_wrist")
    right, shoulder, elbow, wrist = map(layouts.get("h36m17").joints.index, names)
    upper = pose[0, elbow] - pose[0, shoulder]
    upper /= np.linalg.norm(upper)
    ahead = np.cross(upper, pose[0, right] - pose[0, shoulder])
    ahead /= -np.linalg.norm(ahead)
    bend = np.radians(60) * np.abs(np.linspace(-1, 1, 60))[:, None]
    pose[:, wrist] = pose[:, elbow] + 250 * (np.cos(bend) * upper + np.sin(bend) * ahead)
    pose[:, wrist] += np.random.default_rng(0).normal(0, 3, (60, 3))
    write_pose(tmp_path / "arm.bvh", walk(pose), frame_rate=FPS)
    _, own, _, _ = read_bvh(tmp_path / "arm.bvh")
    cosines = (np.einsum("tij,tij->t", own["LeftArm"][1:], own["LeftArm"][:-1]) - 1) / 2
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 15.0


def test_thighs_and_upper_arms_twist_with_the_plane_of_knee_and_elbow(tmp_path):
    pose = np.repeat(synthetic.motion("walk", 1, fps=FPS), T, axis=0)
    for limb in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")):
        root, middle, end = (layouts.get("h36m17").joints.index(f"left_{joint}") for joint in limb)
        upper, lower = pose[0, middle] - pose[0, root], pose[0, end] - pose[0, middle]
        upper /= np.linalg.norm(upper)
        aside = lower - upper @ lower * upper
        bent = 100 * upper + 200 * aside / np.linalg.norm(aside)
        twist = np.stack([matrix_from_vector(upper * angle) for angle in np.linspace(-0.8, 0.8, T)])
        pose[:, end] = pose[:, middle] + twist @ bent
    write_pose(tmp_path / "twist.bvh", walk(pose), frame_rate=FPS)
    _, own, _, _ = read_bvh(tmp_path / "twist.bvh")
    # the axis about which the lower part turns stays the upper one's: x of the leg, y of the arm
    assert own["LeftLeg"][:, 0, 0].min() > 0.98
    assert own["LeftForeArm"][:, 1, 1].min() > 0.98


def test_gaps_are_interpolated(tmp_path):
    pose, wrist = synthetic.motion("walk", T, fps=FPS), layouts.get("h36m17").joints.index("left_wrist")
    whole = walk(pose)
    holes = pose.copy()
    holes[12:15, wrist] = np.nan
    kept = np.array([t for t in range(T) if t not in (20, 21)])
    for name, data in (("whole", whole), ("holes", walk(holes[kept], frames=7 + kept))):
        write_pose(tmp_path / f"{name}.bvh", data, frame_rate=FPS)
    places = [read_bvh(tmp_path / f"{name}.bvh")[0]["LeftHand"] for name in ("whole", "holes")]
    assert places[0].shape == places[1].shape
    np.testing.assert_allclose(places[1], places[0], atol=2.0)


def test_every_so_many_th_frame_has_its_own_rate(tmp_path):
    write_pose(tmp_path / "walk.bvh", walk(frames=5 * np.arange(T)), frame_rate=FPS)
    places, _, _, time = read_bvh(tmp_path / "walk.bvh")
    assert len(places["Hips"]) == T
    assert time == pytest.approx(5 / FPS)


@pytest.mark.parametrize("layout", ["mouse22", "fly38", "hand21"])
def test_animals_and_hands_have_their_joints(tmp_path, layout):
    joints = list(layouts.get(layout).joints)
    body = np.random.default_rng(0).normal(0, 100, (len(joints), 3))
    turns = turn(2, np.linspace(0, 90, 20)) @ turn(0, np.linspace(0, 20, 20))
    pose = np.einsum("tij,nj->tni", turns, body) + np.linspace(0, 300, 20)[:, None, None]
    data = PoseData(pose, joints, np.arange(len(pose)), "mm")
    write_pose(tmp_path / "animal.bvh", data, frame_rate=FPS, unit="mm")
    places, *_ = read_bvh(tmp_path / "animal.bvh")
    assert set(places) == set(joints)
    for joint in joints:
        np.testing.assert_allclose(places[joint], upright(pose, joint, layout), atol=0.05)


@WITH_GLB
def test_pieces_that_no_bone_connects_move_by_themselves(tmp_path):
    joints, rng = layouts.get("fly38").joints, np.random.default_rng(4)
    # six legs, the stripes of both sides, and the antennae
    piece = ["_antenna" if "antenna" in joint else joint.rpartition("_")[0] for joint in joints]
    moves = {of: rng.normal(0, 100, (1, 3)) * np.linspace(0, 1, T)[:, None] for of in piece}
    body = rng.normal(0, 100, (len(joints), 3))
    pose = np.stack([place + moves[of] for place, of in zip(body, piece, strict=True)], axis=1)
    for kind, options in (("bvh", {"unit": "mm"}), ("glb", {})):
        write_pose(tmp_path / f"fly.{kind}", walk(pose, "fly38"), frame_rate=FPS, **options)
    places, *_ = read_bvh(tmp_path / "fly.bvh")
    in_metres, _ = read_glb(tmp_path / "fly.glb")
    for joint in joints:
        np.testing.assert_allclose(places[joint], upright(pose, joint, "fly38"), atol=0.05)
        np.testing.assert_allclose(1000 * in_metres[joint], places[joint], atol=0.05)


@pytest.mark.parametrize("layout", ["coco17", "body25", "halpe26", "mediapipe33", "wholebody133"])
def test_people_of_other_layouts_have_what_these_have(tmp_path, layout):
    joints = layouts.get(layout).joints
    body = np.random.default_rng(1).normal(0, 300, (len(joints), 3))
    pose = np.repeat(body[None], 10, axis=0)
    ears, nose = body[[joints.index(f"{side}_ear") for side in ("left", "right")]], joints.index("nose")
    axis = (ears[1] - ears[0]) / np.linalg.norm(ears[1] - ears[0])
    nods = np.stack([matrix_from_vector(axis * angle) for angle in np.linspace(-0.5, 0.5, 10)])
    pose[:, nose] = ears.mean(axis=0) + nods @ (body[nose] - ears.mean(axis=0))
    pose = np.einsum("tij,tnj->tni", turn(2, np.linspace(0, 60, 10)), pose)
    write_pose(tmp_path / "body.bvh", walk(pose, layout), frame_rate=FPS)
    places, *_ = read_bvh(tmp_path / "body.bvh")
    own = {**JOINTS, "LeftToeBase": "left_big_toe", "LeftHandIndex3": "left_forefinger3", "Nose": "nose"}
    own["RightToeBase"] = "right_foot_index"
    for part, joint in own.items():
        if joint in joints:
            np.testing.assert_allclose(10 * places[part], upright(pose, joint, layout), atol=0.01)
    assert ("LeftHandIndex3" in places) == (layout == "wholebody133")


def test_another_vertical_becomes_y(tmp_path):
    pose = synthetic.motion("walk", T, fps=FPS)
    turned = pose[..., [0, 2, 1]] * [1.0, -1.0, 1.0]  # y is down, as for a camera
    write_pose(tmp_path / "walk.bvh", walk(turned), frame_rate=FPS, up=[0.0, -1.0, 0.0])
    places, *_ = read_bvh(tmp_path / "walk.bvh")
    np.testing.assert_allclose(10 * places["LeftHand"][:, 1], upright(pose, "left_wrist")[:, 1], atol=1.0)


@pytest.mark.parametrize("source", ["walk.npz", "walk.trc"])
def test_animations_have_y_up_whether_it_is_asked_for_or_not(tmp_path, source):
    options = {"frame_rate": FPS, "y_up": True} if source.endswith("trc") else {}
    write_pose(tmp_path / source, walk(), **options)
    with collected_warnings() as found:
        for name, y_up in (("plain", False), ("up", True)):
            convert_poses(tmp_path / source, tmp_path / f"{name}.bvh", y_up=y_up, fps=FPS)
    assert "warning" not in [one.severity for one in found if one.kind == "axes_turned"]
    assert (tmp_path / "plain.bvh").read_bytes() == (tmp_path / "up.bvh").read_bytes()


def test_what_constant_bones_cost_is_said(tmp_path):
    longer = synthetic.motion("walk", T, fps=FPS)
    ankle = layouts.get("h36m17").joints.index("left_ankle")
    knee = layouts.get("h36m17").joints.index("left_knee")
    longer[:, ankle] += 0.2 * np.linspace(0, 1, T)[:, None] ** 8 * (longer[:, ankle] - longer[:, knee])
    with pytest.warns(FindingWarning) as told:
        write_pose(tmp_path / "walk.bvh", walk(longer), frame_rate=FPS)
    (finding,) = (one.message.finding for one in told)
    assert finding.kind == "bones_constant"
    assert finding.numbers["median_mm"] < 3.0
    shin = np.linalg.norm(longer[:, ankle] - longer[:, knee], axis=1)
    places, *_ = read_bvh(tmp_path / "walk.bvh")
    own = np.linalg.norm(10 * (places["LeftFoot"] - places["LeftLeg"]), axis=1)
    np.testing.assert_allclose(own, np.median(shin), rtol=1e-5)


@pytest.mark.parametrize(
    ("expected", "data"),
    [
        ("frames", lambda: walk(frames=np.concatenate([np.arange(T - 1), [10**6]]))),
        ("pose", lambda: walk(np.full((T, 17, 3), np.nan))),
        ("joint_names", lambda: PoseData(np.zeros((T, 2, 3)), ("a", "b"), np.arange(T), "mm")),
        ("frame_rate", lambda: None),
    ],
)
def test_what_cannot_be_an_animation_is_refused(tmp_path, expected, data):
    options = {} if expected == "frame_rate" else {"frame_rate": FPS}
    with pytest.raises(InvalidInputError, match=rf"^{expected}: expected"):
        write_pose(tmp_path / "walk.bvh", data() or walk(), **options)
    assert not (tmp_path / "walk.bvh").exists()


@pytest.mark.parametrize("kind", ["bvh", pytest.param("glb", marks=WITH_GLB)])
def test_a_folder_that_is_not_there_is_an_error(tmp_path, kind):
    with pytest.raises(DatasetError, match="output"):
        write_pose(tmp_path / "none" / f"walk.{kind}", walk(), frame_rate=FPS)
