"""Simulated rigs: what each promises about its cameras."""

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic

VIEWS = {
    "human36m": synthetic.human36m_like(),
    "dome": synthetic.dome(),
    "stereo": synthetic.stereo(),
    "table": synthetic.table(),
}


def centre(view):
    return -view.R.T @ view.t


def pixel(view, point):
    x, y, z = view.K @ (view.R @ np.asarray(point, dtype=float) + view.t)
    return np.array([x / z, y / z]), z


@pytest.mark.parametrize("views", VIEWS.values(), ids=VIEWS)
def test_rotations_are_proper(views):
    for view in views:
        # Rounding of a product of unit vectors.
        np.testing.assert_allclose(view.R @ view.R.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(view.R) > 0


@pytest.mark.parametrize("views", VIEWS.values(), ids=VIEWS)
def test_images_are_upright_and_centred_on_the_target(views):
    target = np.zeros(3) if views is VIEWS["table"] else np.array([0.0, 0.0, 900.0])
    for view in views:
        there, depth = pixel(view, target)
        above, _ = pixel(view, target + np.array([0, 0, 10.0]))
        assert depth > 0
        np.testing.assert_allclose(there, (np.array(view.size) - 1) / 2, atol=1e-9)
        assert above[1] < there[1]
        assert above[0] == pytest.approx(there[0], abs=1e-9)


@pytest.mark.parametrize("eye", [(0, 0, 0), (0, 0, 5)], ids=["on the target", "above the target"])
def test_look_at_without_an_upright_image_is_refused(eye):
    with pytest.raises(sk.DegenerateGeometryError):
        synthetic.look_at(eye, (0, 0, 0))


def test_human36m_like_is_a_room_with_a_camera_in_each_corner():
    views = VIEWS["human36m"]
    centres = np.array([centre(v) for v in views])
    assert len({(x > 0, y > 0) for x, y, _ in centres}) == 4
    radius = np.linalg.norm(centres[:, :2], axis=1)
    assert ((radius > 5000) & (radius < 5500)).all()
    assert ((centres[:, 2] > 1400) & (centres[:, 2] < 1700)).all()
    # DESIGN §2: 5e-4 × 1.1 × the largest distance from the mean centre is 3 mm on the Human3.6M rig.
    extent = 5e-4 * 1.1 * np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()
    assert extent == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("name", synthetic.motion_names)
def test_every_motion_stays_inside_the_human36m_like_images(name):
    for seed in range(5):
        pixels = sk.project(synthetic.motion(name, 200, seed=seed), synthetic.human36m_like())
        assert (pixels > 0).all()
        assert (pixels < 999).all()


def test_dome_cameras_sit_on_the_dome_and_look_different_ways():
    views = VIEWS["dome"]
    offsets = np.array([centre(v) for v in views]) - (0, 0, 900)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 2800)
    assert (offsets[:, 2] + 900 > 0).all()
    cosines = offsets @ offsets.T / 2800**2 - 2 * np.eye(31)
    assert np.rad2deg(np.arccos(cosines.max())) > 8.0
    np.testing.assert_array_equal([v.t for v in synthetic.dome(5)], [v.t for v in views[:5]])


def test_stereo_baseline_and_distance():
    left, right = synthetic.stereo(baseline_mm=400, distance_mm=3000)
    np.testing.assert_allclose(centre(right) - centre(left), (400, 0, 0), atol=1e-9)
    assert centre(left)[1] == pytest.approx(-3000)
    # A point to the right in the left image: the left camera is on the left side of the pair.
    assert pixel(left, (0, -500, 900))[0][0] > pixel(right, (0, -500, 900))[0][0]


@pytest.mark.parametrize(
    ("rig", "count", "size"),
    [
        (lambda: synthetic.human36m_like(), 4, (1000, 1002)),
        (lambda: synthetic.dome(8), 8, (1920, 1080)),
        (lambda: synthetic.stereo(), 2, (1280, 720)),
        (lambda: synthetic.table(), 4, (640, 480)),
    ],
    ids=["human36m_like", "dome", "stereo", "table"],
)
def test_rigs_are_camera_rigs_in_mm(rig, count, size):
    cameras = rig()
    assert isinstance(cameras, sk.CameraRig)
    assert cameras.unit == "mm"
    assert len(cameras) == len(set(cameras.names)) == count
    assert tuple(cameras[0].size) == size


def test_distortion_bends_the_images_and_is_undone():
    ideal, bent = synthetic.human36m_like(), synthetic.human36m_like(distortion=True)
    point = np.array([[900.0, 700.0, 1700.0]])
    straight, curved = sk.project(point, ideal), sk.project(point, bent)
    assert (np.linalg.norm(straight - curved, axis=-1) > 0.5).all()
    for view, (a, b) in enumerate(zip(straight, curved, strict=True)):
        # The undistortion is converged to 1e-9 px.
        np.testing.assert_allclose(bent[view].undistort(b), a, atol=1e-6)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: synthetic.dome(32), "n_views"),
        (lambda: synthetic.table(0), "n_views"),
        (lambda: synthetic.stereo(baseline_mm=0), "baseline_mm"),
        (lambda: synthetic.dome(radius_mm=float("nan")), "radius_mm"),
    ],
)
def test_bad_input_is_named(call, argument):
    with pytest.raises(sk.InvalidInputError) as caught:
        call()
    assert caught.value.argument == argument
