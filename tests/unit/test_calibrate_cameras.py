"""`skelsplat.calibrate_cameras`: places, clocks and world within their error bars, and what is refused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from calibrate import similarity

import skelsplat as sk
from skelsplat import _calibrate, _skelsplat, synthetic
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.exceptions import DegenerateGeometryError, InvalidInputError
from skelsplat.findings import FindingWarning
from skelsplat.synthetic import DetectionNoise
from sweeps import swept

RIG = sk.CameraRig(synthetic.human36m_like(), unit="mm")
NAMES = RIG.names
BLANK = [sk.Intrinsics(camera.size, name=camera.name) for camera in RIG]
LAYOUT = "h36m17"
FRAMES, FPS = 80, 10.0
LATE = (0.0, 7.4, -12.0, 3.7)


def roaming(seconds: np.ndarray) -> np.ndarray:
    """Return somebody who walks about, turns and reaches, (T, 17, 3) mm."""
    steps = np.rint(10 * FPS * seconds).astype(int)
    poses = synthetic.motion("reach", steps.max() + 1, fps=10 * FPS)[steps]
    middle = poses[:1, :1] * [1.0, 1.0, 0.0]
    c, s, zero = np.cos(0.7 * seconds), np.sin(0.7 * seconds), np.zeros(len(seconds))
    turn = np.array([[c, s, zero], [-s, c, zero], [zero, zero, zero + 1]])
    path = np.stack([900 * np.sin(0.9 * seconds), 800 * np.cos(1.3 * seconds), zero], axis=1)
    return np.einsum("tni,ijt->tnj", poses - middle, turn) + path[:, None]


def seen(late: tuple[float, ...] = (0.0,) * 4, seed: int = 3) -> np.ndarray:
    """Simulate eight seconds, of which camera i is `late[i]` frames ahead."""
    noise = DetectionNoise.recording(frame_rate=FPS)

    def of_view(i: int) -> np.ndarray:
        poses = roaming((20 + np.arange(FRAMES) - late[i]) / FPS)
        return synthetic.simulate_detections(poses, RIG, noise=noise, layout=LAYOUT, seed=seed)[:, i]

    return np.stack([of_view(i) for i in range(len(RIG))], axis=1)


@cache
def walk() -> np.ndarray:
    return seen()


@cache
def known() -> sk.RigCalibration:
    return sk.calibrate_cameras(walk(), list(RIG), layout=LAYOUT)


def aligned(found: sk.RigCalibration) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Return what is left of turns, degrees, and of places (M, 3), mm along the axes of the found world.

    Of the aligned rig; and its scale and rotation (3, 3) into the true world.
    """
    true = [RIG[name] for name in found.cameras.names]
    R, S = (np.stack([np.asarray(camera.R) for camera in rig]) for rig in (found.cameras, true))
    a, b = (np.stack([np.asarray(camera.centre) for camera in rig]) for rig in (found.cameras, true))
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    Q, scale = similarity(a, b, (b**2).sum() / len(b) * np.einsum("vji,vjk->ik", S, R))
    cosines = (np.einsum("vij,vij->v", S, R @ Q.T) - 1) / 2
    turns = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return turns, scale * a - b @ Q, scale, Q


def off(found: sk.RigCalibration) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return what is left of turns, degrees, and places, mm, of the aligned rig, of its scale, and of up."""
    turns, places, scale, Q = aligned(found)
    tilt = float(np.degrees(np.arccos(np.clip(Q[2, 2], -1, 1))))
    return turns, np.linalg.norm(places, axis=1), scale, tilt


def check_shape(found: sk.RigCalibration, degrees: float, mm: float) -> None:
    """Check that all cameras are within two error bars, which are below these limits."""
    turns, places, *_ = off(found)
    bars = np.array([[one.turn_sigma, one.place_sigma] for one in found.report if one.status == "placed"])
    assert (bars > 0).all()
    assert (bars <= [degrees, mm]).all()
    assert (turns <= 2 * bars[:, 0]).all()
    assert (places <= 2 * bars[:, 1]).all()


def test_cameras_are_placed_by_a_walk() -> None:
    found = known()
    check_shape(found, 0.4, 40.0)
    assert found.sure
    assert found.cameras.names == NAMES
    assert {one.status for one in found.report} == {"placed"}
    assert {one.clock for one in found.report} == {0.0}
    assert all(np.isnan([one.focal_sigma, one.clock_sigma]).all() for one in found.report)
    assert all(0.0 < one.error < 8.0 and one.explained > 0.9 for one in found.report)


def turned(recording: np.ndarray, view: int, frames: slice, degrees: float) -> np.ndarray:
    """Return what the views see if one camera is turned in some frames."""
    K, R = RIG[view].K, matrix_from_vector(np.radians(degrees) * np.array([0.3, 0.9, 0.3]))
    out = recording.copy()
    ahead = np.insert(out[frames, view, :, :2], 2, 1.0, axis=2) @ (K @ R @ np.linalg.inv(K)).T
    out[frames, view, :, :2] = ahead[..., :2] / ahead[..., 2:]
    return out


def test_a_camera_that_was_moved_is_placed_by_the_longer_part() -> None:
    """That its first part is the longer one is in test_calibrate_people.py."""
    found = sk.calibrate_cameras(turned(walk(), 0, slice(32), 2.0), list(RIG), layout=LAYOUT)
    check_shape(found, 0.6, 60.0)
    assert found.sure
    assert [one.span is None for one in found.report] == [False, True, True, True]
    assert found.report[0].span == pytest.approx((32, 80), abs=1)
    assert all(np.isfinite(found.people[0][:, i, :, 0]).all(axis=1).sum() > 40 for i in range(4))


def test_places_scatter_as_their_covariances_say() -> None:
    squares = []
    for seed in (3, 4, 5, 6):
        found = known() if seed == 3 else sk.calibrate_cameras(seen(seed=seed), list(RIG), layout=LAYOUT)
        for one, error in zip(found.report, aligned(found)[1], strict=True):
            squares.append(error @ np.linalg.solve(one.place_covariance, error))
    # 3 ± 0.6 of 16 errors of three axes each; error bars may be up to twice as large as the errors
    assert 3 / 4 < np.mean(squares) < 3 + 2 * 0.6


def test_covariances_turn_with_the_world() -> None:
    order = [2, 0, 1, 3]  # the first camera looks along y
    found = sk.calibrate_cameras(walk()[:, order], [RIG[i] for i in order], layout=LAYOUT)
    turned = []
    for one in (known(), found):
        *_, scale, Q = aligned(one)
        turned.append({camera.name: scale**2 * Q @ camera.place_covariance @ Q.T for camera in one.report})
    for name in NAMES:
        np.testing.assert_allclose(turned[1][name], turned[0][name], atol=0.1 * turned[0][name].max())
    axes = [np.asarray(rig[NAMES[0]].R) for rig in (known().cameras, found.cameras)]
    assert np.abs(axes[0] - axes[1]).max() > 0.5


def test_the_world_has_the_size_of_an_adult_and_stands_on_the_floor() -> None:
    found = known()
    *_, scale, tilt = off(found)
    assert scale == pytest.approx(1.0, abs=2 * found.scale_sigma)
    assert tilt <= 2 * found.up_sigma <= 6.0
    points = sk.triangulate(walk(), found.cameras)
    ankles = [sk.layouts.H36M17.joints.index(f"{side}_ankle") for side in ("left", "right")]
    assert 20.0 < np.nanquantile(points[:, ankles, 2], 0.2) < 160.0
    assert np.linalg.norm(np.nanmedian(points[:, 0], axis=0)[:2]) < 600.0
    axis = np.asarray(found.cameras[0].R)[2]  # the first camera looks along y
    assert axis[1] > 0.8


@pytest.mark.parametrize("same", [False, True])
def test_focal_lengths_are_found(same: bool) -> None:
    found = sk.calibrate_cameras(walk(), BLANK, layout=LAYOUT, same_focal=same)
    check_shape(found, 1.5, 250.0)
    focal = [camera.K[0, 0] / RIG[camera.name].K[0, 0] - 1 for camera in found.cameras]
    bars = [one.focal_sigma for one in found.report]
    assert (np.abs(focal) <= 2 * np.array(bars)).all()
    assert max(bars) < 0.06
    if same:
        assert np.ptp(focal) < 0.012  # three standard deviations of lenses of one make


def test_the_lens_is_found_where_it_is_unknown() -> None:
    rig, noise = synthetic.human36m_like(distortion=True), DetectionNoise.recording(frame_rate=FPS)
    poses = roaming((20 + np.arange(FRAMES)) / FPS)
    through_lens = synthetic.simulate_detections(poses, rig, noise=noise, layout=LAYOUT, seed=3)
    found = sk.calibrate_cameras(through_lens, BLANK, layout=LAYOUT, same_focal=True)
    check_shape(found, 1.5, 250.0)
    k1 = [np.asarray(camera.distortion)[0] for camera in found.cameras]
    assert np.ptp(k1) < 0.003
    assert k1[0] == pytest.approx(-0.2, abs=0.1)
    ideal = sk.RefineConfig(undistort=False)
    pinhole = sk.calibrate_cameras(walk(), BLANK, layout=LAYOUT, same_focal=True, config=ideal)
    assert [camera.distortion for camera in pinhole.cameras] == [None] * 4


@pytest.mark.parametrize("zooms", [(1.0, 1.0, 1.08, 1.0), (0.95,) * 4])
def test_error_bars_hold_what_a_lens_that_may_be_wrong_would_change(zooms: tuple[float, ...]) -> None:
    given = [
        altered(one, K=np.asarray(one.K) * [[z, 1, 1], [1, z, 1], [1, 1, 1]])
        for one, z in zip(RIG, zooms, strict=True)
    ]
    found = sk.calibrate_cameras(walk(), given, layout=LAYOUT)
    turns, places, *_ = off(found)
    assert (turns <= [3 * one.turn_sigma for one in found.report]).all()
    assert (places <= [3 * one.place_sigma for one in found.report]).all()
    assert max(places) > 3 * max(one.place_sigma for one in known().report)


@pytest.mark.filterwarnings("ignore:The principal points of all cameras are at 40%")
def test_lenses_of_other_images_are_doubted() -> None:
    def zoomed(*zooms: float) -> list[sk.Camera]:
        each = zip(RIG, zooms, strict=True)
        return [altered(one, K=np.diag([zoom, zoom, 1.0]) @ np.asarray(one.K)) for one, zoom in each]

    for wrong in ((0.8,) * 4, (1.0, 1.0, 1.15, 1.0)):
        found = sk.calibrate_cameras(walk(), zoomed(*wrong), layout=LAYOUT)
        assert found.doubts == ("lenses",)
        assert [one.zoom for one in found.report] == pytest.approx(1 / np.array(wrong), rel=0.05)
        assert [one.zoom == 1.0 for one in found.report] == [factor == 1.0 for factor in wrong]
    assert [one.zoom for one in known().report] == [1.0] * 4
    other = zoomed(1.0, 1.0, 1.0, 1.5)
    poses, noise = roaming((20 + np.arange(FRAMES)) / FPS), DetectionNoise.recording(frame_rate=FPS)
    unlike = synthetic.simulate_detections(poses, other, noise=noise, layout=LAYOUT, seed=3)
    assert "lenses" in sk.calibrate_cameras(unlike, BLANK, layout=LAYOUT, same_focal=True).doubts


def test_images_larger_than_those_of_the_detections_are_warned_of() -> None:
    larger = [sk.Intrinsics((2 * one.size[0], 2 * one.size[1])) for one in RIG]
    with pytest.warns(FindingWarning, match="from images of this size"):
        sk.calibrate_cameras(walk(), larger, layout=LAYOUT)


def test_principal_points_that_are_off_alike_are_warned_of() -> None:
    aside = np.array([[0.0, 0.0, 0.1 * RIG[0].size[0]], [0.0] * 3, [0.0] * 3])
    with pytest.warns(FindingWarning, match="principal points of all cameras are at 60% of"):
        sk.calibrate_cameras(walk(), [altered(one, K=one.K + aside) for one in RIG], layout=LAYOUT)


def test_two_cameras_in_one_place_are_doubted() -> None:
    turned = matrix_from_vector(np.array([0.0, 0.1, 0.02])) @ np.asarray(RIG[0].R)
    pair = [RIG[0], altered(RIG[0], R=turned, t=-turned @ np.asarray(RIG[0].centre), name="beside")]
    noise, poses = DetectionNoise.recording(frame_rate=FPS), roaming((20 + np.arange(FRAMES)) / FPS)
    both = synthetic.simulate_detections(poses, pair, noise=noise, layout=LAYOUT, seed=3)
    assert not sk.calibrate_cameras(both, pair, layout=LAYOUT).sure


def test_a_rig_of_unknown_sureness_is_doubted(monkeypatch) -> None:
    solve, once, sigmas = _skelsplat.calibrate_cameras, [], iter([np.nan, np.inf])

    def solved(*args, **options):
        once.append(once[0] if once else solve(*args, **options))
        cameras, found = once[0]
        return cameras, {**found, "joint_sigma": next(sigmas)}

    monkeypatch.setattr(_skelsplat, "calibrate_cameras", solved)
    for _ in range(2):
        found = _calibrate.calibrate_cameras(walk(), list(RIG), layout=LAYOUT)  # which is not remembered
        assert found.doubts == ("places",)


def test_error_bars_of_poses_contain_that_of_the_cameras() -> None:
    rig, bare = known().cameras, sk.CameraRig(list(known().cameras))
    frames, tracker = walk()[:6], sk.Refiner(rig, layout=LAYOUT)
    refined = [sk.refine(None, frames, cameras, layout=LAYOUT) for cameras in (bare, rig)]
    over_time = [sk.refine_sequence(frames, cameras, fps=FPS, layout=LAYOUT) for cameras in (bare, rig)]
    live = tracker.step(frames[0])
    for without, with_rig in (refined, over_time):
        expected = np.hypot(without.joint_bias, rig.joint_sigma)
        np.testing.assert_allclose(with_rig.joint_bias, expected, rtol=1e-12)
        np.testing.assert_array_equal(without.pose, with_rig.pose)
    np.testing.assert_array_equal(live.joint_bias, refined[1].joint_bias[0])


def test_clocks_are_found_in_parts_of_a_frame() -> None:
    late = seen(late=LATE)[:, :3]
    found = sk.calibrate_cameras(late, list(RIG)[:3], layout=LAYOUT, fps=FPS, clock=True)
    check_shape(found, 0.5, 50.0)
    assert dict(found.clocks) == {one.name: one.clock for one in found.report}
    assert found.report[0].clock == 0.0
    for ahead, one in zip(LATE[1:3], found.report[1:], strict=True):
        assert one.clock == pytest.approx(ahead, abs=3 * one.clock_sigma)
        assert 0.0 < one.clock_sigma < 0.2
    together = found.synchronised(late)
    assert together.shape == (FRAMES, 3, 17, 3)
    apart = np.linalg.norm(together[..., :2] - walk()[:, :3, :, :2], axis=-1)
    assert np.nanmedian(apart) < 6.0 < np.nanmedian(np.linalg.norm((late - walk()[:, :3])[..., :2], axis=-1))


def test_a_walk_in_a_circle_does_not_tell_clocks() -> None:
    noise = DetectionNoise.recording(frame_rate=FPS)
    poses = synthetic.motion("walk", FRAMES + 40, fps=FPS)
    every = synthetic.simulate_detections(poses, RIG, noise=noise, layout=LAYOUT, seed=3)
    views = [every[ahead : ahead + FRAMES, i] for i, ahead in enumerate((20, 13, 32))]
    found = sk.calibrate_cameras(np.stack(views, axis=1), list(RIG)[:3], layout=LAYOUT, fps=FPS, clock=True)
    turns, *_ = off(found)
    assert not found.sure or turns.max() < 1.0


@pytest.mark.parametrize("late", [swept((0.0, 1.0, 0.0, 0.0)), (0.0, 9.0, -7.0, 0.0)])
def test_clocks_that_are_off_by_some_frames_are_found_unasked(late: tuple[float, ...]) -> None:
    found = sk.calibrate_cameras(seen(late=late), list(RIG), layout=LAYOUT)
    assert found.sure
    check_shape(found, 0.5, 50.0)
    for ahead, one in zip(late, found.report, strict=True):
        assert one.clock == pytest.approx(ahead, abs=3 * one.clock_sigma)


def test_cameras_far_out_of_step_are_doubted_if_clocks_are_not_looked_for() -> None:
    late = seen(late=(0.0, 40.0, -35.0, 0.0))[:, :3]
    assert not sk.calibrate_cameras(late, list(RIG)[:3], layout=LAYOUT).sure


def test_a_camera_that_sees_something_else_is_left_out() -> None:
    detections = walk().copy()
    detections[:, 2] = walk()[::-1, 3]
    found = sk.calibrate_cameras(detections, list(RIG), layout=LAYOUT)
    assert [one.name for one in found.report if one.status == "left_out"] == [NAMES[2]]
    assert np.isnan(found.report[2].turn_sigma)
    assert found.cameras.names == (*NAMES[:2], NAMES[3])
    check_shape(found, 0.6, 60.0)
    assert found.synchronised(detections).shape == (FRAMES, 3, 17, 3)


def test_stature_gives_the_scale() -> None:
    tall, adult = sk.calibrate_cameras(walk(), list(RIG), layout=LAYOUT, stature=1.9), known()
    a, b = (np.asarray(found.cameras[0].centre) - found.cameras[2].centre for found in (tall, adult))
    assert np.linalg.norm(a) / np.linalg.norm(b) == pytest.approx(1.9 / 1.7)
    assert (tall.stature, adult.stature) == pytest.approx((1.9, 1.7))
    # What is left is how well bones tell a stature; the spread of adults is 90 mm.
    assert tall.scale_sigma > 0.0
    assert adult.scale_sigma == pytest.approx(np.hypot(tall.scale_sigma, 90 / 1700))


THING = sk.Layout("thing", [f"p{k}" for k in range(17)], limbs=[[0, 1], [1, 2], [2, 3], [4, 5], [5, 6]])


def test_a_distance_gives_the_scale_of_anything() -> None:
    found = sk.calibrate_cameras(walk(), list(RIG), layout=THING, distance=(NAMES[0], 2, 7.5))
    check_shape(found, 0.4, np.inf)
    apart = np.asarray(found.cameras[0].centre) - found.cameras[2].centre
    assert np.linalg.norm(apart) == pytest.approx(7500.0)
    assert found.scale_sigma == 0.0
    assert np.isnan([found.up_sigma, found.stature]).all()
    metres = float(np.linalg.norm(np.asarray(known().cameras[0].centre) - known().cameras[2].centre)) / 1000
    larger = sk.calibrate_cameras(walk(), list(RIG), layout=LAYOUT, distance=(0, 2, 1.1 * metres))
    assert larger.stature == pytest.approx(1.1 * 1.7)


def test_without_a_person_the_world_is_that_of_the_first_camera() -> None:
    found = sk.calibrate_cameras(walk(), list(RIG), layout=THING)
    assert found.scale_sigma == np.inf
    np.testing.assert_allclose(np.asarray(found.cameras[0].R), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.asarray(found.cameras[0].centre), 0.0, atol=1e-9)


MIXED = [*list(RIG)[:3], BLANK[3]]


@pytest.mark.parametrize(
    ("argument", "wrong"),
    [
        ("detections", {"detections": np.zeros((5, 3, 17, 2))}),
        ("detections", {"detections": np.zeros((5, 4, 16, 2))}),
        ("detections", {"detections": np.zeros((4, 17, 2))}),
        ("intrinsics", {"detections": walk()[:, :1], "intrinsics": [RIG[0]]}),
        ("intrinsics[3]", {"intrinsics": MIXED}),
        ("intrinsics", {"detections": walk()[:, :2], "intrinsics": BLANK[:2]}),
        ("fps", {"clock": True}),
        ("fps", {"clock": True, "fps": 0.0}),
        ("stature", {"stature": -1.7}),
        ("stature", {"stature": 175.0}),
        ("stature", {"stature": "tall"}),
        ("stature", {"stature": 1.7, "distance": (0, 1, 7.5)}),
        ("fps", {"fps": 0}),
        ("same_focal", {"same_focal": True}),
        ("detections", {"detections": walk()[:, [0, 1, 1, 3]]}),
        ("detections", {"intrinsics": [sk.Intrinsics(size=(400, 300)) for _ in RIG]}),
        ("detections", {"detections": walk() / 2000.0}),
        ("detections", {"detections": np.where(walk() > 700, np.inf, walk())}),
        ("size", {"intrinsics": [sk.Intrinsics(size=None) for _ in RIG]}),
        ("intrinsics", {"intrinsics": [sk.Intrinsics(one.size, K=np.eye(3)) for one in RIG]}),
        ("distance", {"distance": ("nobody", 0, 2.0)}),
        ("distance", {"distance": (0, 1, 0.0)}),
        ("distance", {"distance": (1, 1, 2.0)}),
        ("distance", {"distance": (0, 1, 7500.0)}),
        ("distance", {"distance": (0, 1, 0.01)}),
        ("distance", {"distance": (0, 1)}),
        ("distance", {"distance": (0, -9, 2.0)}),
    ],
)
def test_a_wrong_argument_is_named(argument: str, wrong: dict[str, object]) -> None:
    given = {"detections": walk(), "intrinsics": list(RIG), "layout": LAYOUT} | wrong
    with pytest.raises(InvalidInputError) as caught:
        sk.calibrate_cameras(**given)
    assert caught.value.argument == argument


def test_nobody_seen_is_an_error() -> None:
    with pytest.raises(DegenerateGeometryError, match="60 joints"):
        sk.calibrate_cameras(np.full((30, 4, 17, 2), np.nan), list(RIG), layout=LAYOUT)
