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


def pixel(view, point):
    x, y, z = view.K @ (view.R @ np.asarray(point, dtype=float) + view.t)
    return np.array([x / z, y / z]), z


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
    views = VIEWS["dome"]
    offsets = np.array([-view.R.T @ view.t for view in views]) - (0, 0, 900)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 2800)
    assert (offsets[:, 2] + 900 > 0).all()
    cosines = offsets @ offsets.T / 2800**2 - 2 * np.eye(31)
    assert np.rad2deg(np.arccos(cosines.max())) > 8.0
    np.testing.assert_array_equal([v.t for v in synthetic.dome(5)], [v.t for v in views[:5]])


@pytest.mark.parametrize(
    ("call", "argument"),
    [(lambda: synthetic.dome(32), "n_views"), (lambda: synthetic.dome(radius_mm=float("nan")), "radius_mm")],
)
def test_bad_input_is_named(call, argument):
    with pytest.raises(sk.InvalidInputError) as caught:
        call()
    assert caught.value.argument == argument
