"""What is too large or too small to compute with is refused by name, before anything is allocated."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic


def valid() -> dict:
    """Give the arguments of a camera."""
    k = np.array([[1000.0, 0, 500], [0, 1000.0, 500], [0, 0, 1]])
    return {"K": k, "R": np.eye(3), "t": np.array([0.0, 0, 3000]), "size": (1000, 1000)}


def camera(**changed) -> sk.Camera:
    """Give the valid one with something changed."""
    return sk.Camera(**{**valid(), **changed})


def intrinsics(fx=1000.0, fy=1000.0, cx=500.0, cy=500.0) -> np.ndarray:
    """Build K of these numbers."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


BROKEN_CAMERAS = {
    "focal_too_short": (
        {"K": intrinsics(fx=1e-306)},
        "K: expected focal lengths from 1e-9 to 1e9 pixels, got fx = 1e-306, fy = 1e3",
    ),
    "focal_too_long": (
        {"K": intrinsics(fy=1e10)},
        "K: expected focal lengths from 1e-9 to 1e9 pixels, got fx = 1e3, fy = 1e10",
    ),
    "principal_point": (
        {"K": intrinsics(cx=-1e308)},
        "K: expected a principal point within ±1e9 pixels, got cx = -1e308, cy = 5e2",
    ),
    "translation": ({"t": [0, 1e200, 3e3]}, "t: expected values within ±1e12, got 1e200"),
    "distortion": (
        {"distortion": [0, 0, -1e300, 0]},
        "distortion: expected values within ±1e9, got -1e300",
    ),
    "size": (
        {"size": (1000, 2**31)},
        "size: expected (width, height) of at most 65535 pixels, got (1000, 2147483648)",
    ),
}


@pytest.mark.parametrize("case", BROKEN_CAMERAS)
def test_a_camera_outside_its_ranges(case):
    broken, text = BROKEN_CAMERAS[case]
    with pytest.raises(sk.InvalidInputError, match=f"^{re.escape(text)}$"):
        camera(**broken)


@pytest.mark.parametrize(
    "real",
    [
        {"K": intrinsics(fx=2e6, fy=2e6)},  # a microscope's
        {"K": np.eye(3), "size": (1, 1)},  # normalised coordinates
        {"t": [4.5e8, 5.3e9, 1e6]},  # a geographic grid in mm
        {"size": (65535, 65535)},
        {"distortion": [22.6, -310.0, 1e-4, -2e-4, 980.0, 23.1, -300.0, 870.0]},
    ],
)
def test_real_cameras_lie_inside(real):
    sk.project(np.zeros((1, 3)), [camera(**real)])


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (1e306, "factor: expected a factor that gives K finite values"),
        (1e7, "factor: expected a factor that gives K focal lengths from 1e-9 to 1e9 pixels, got 1e7"),
        (1e-13, "factor: expected a factor that gives K focal lengths from 1e-9 to 1e9 pixels, got 1e-13"),
        (100.0, "factor: expected a factor that gives size (width, height) of at most 65535 pixels"),
    ],
)
def test_scaled_leaves_no_range(factor, text):
    with pytest.raises(sk.InvalidInputError, match=f"^{re.escape(text)}"):
        camera().scaled(factor)


def test_the_resolution_is_named():
    config = sk.RefineConfig.paper(resolution=1e6)
    with pytest.raises(sk.InvalidInputError, match=r"^config.resolution: expected a factor that gives size"):
        sk.Refiner([camera(K=intrinsics(1.0, 1.0))], config=config)


@pytest.mark.parametrize(
    ("field", "text"),
    [
        ({"sigma_mm": 1e300}, "config.sigma_mm: expected a number from 1e-15 to 1e9, got 1e300"),
        ({"sigma_mm": 1e-300}, "config.sigma_mm: expected a number from 1e-15 to 1e9, got 1e-300"),
        (
            {"detection_sigma_px": 1e200},
            "config.detection_sigma_px: expected a number from 1e-4 to 1e9, got 1e200",
        ),
        (
            {"detection_sigma_px": 1e-12},
            "config.detection_sigma_px: expected a number from 1e-4 to 1e9, got 1e-12",
        ),
        ({"symmetry_weight": 1e300}, "config.symmetry_weight: expected a number of at most 1e9, got 1e300"),
        ({"n_threads": 10**9}, "config.n_threads: expected at most 1024, got 1000000000"),
    ],
)
def test_settings_outside_their_ranges(field, text):
    with pytest.raises(sk.InvalidInputError, match=f"^{re.escape(text)}$"):
        (sk.RefineConfig.paper if "symmetry_weight" in field else sk.RefineConfig)(**field)


@pytest.mark.parametrize("error_px", [0.0, 1e-3, 0.1, 3.0, 300.0])
def test_the_least_noise_that_can_be_given_has_error_bars(error_px):
    rig = synthetic.human36m_like()
    seen = sk.project(synthetic.motion("walk", 4, seed=3), rig).swapaxes(0, 1)
    seen += np.random.default_rng(0).normal(size=seen.shape) * error_px
    found = sk.refine(None, seen, rig, layout="h36m17", config=sk.RefineConfig(detection_sigma_px=1e-4))
    assert np.isfinite(found.uncertainty).all()


POINTS = np.random.default_rng(0).normal(size=(5, 3)) * 100
WIDE = np.tile(np.eye(3) * 400.0, (5, 1, 1))
PIXELS = sk.project(POINTS, [camera()])[0]
TURNS = np.tile([1.0, 0, 0, 0], (5, 1))
FAR = [0] * 4 + [1e308]


def far(values: np.ndarray, number: float = 1e308) -> np.ndarray:
    """Give the same with one number that is none to compute with."""
    out = values.copy()
    out[(-1,) * out.ndim] = number
    return out


ENDLESS = far(PIXELS, -np.inf)
FAR_VALUES: dict[str, tuple[Callable[[], object], str]] = {
    "refine endless": (lambda: sk.refine(None, ENDLESS[None, None], [camera()]), "detections[0, 0, 4, 1]"),
    "in time endless": (
        lambda: sk.refine_sequence(np.stack([PIXELS, ENDLESS])[:, None], [camera()], fps=25),
        "detections[1, 0, 4, 1]",
    ),
    "step endless": (lambda: sk.Refiner([camera()], fps=25).step(ENDLESS[None]), "detections[0, 4, 1]"),
    "track endless": (
        lambda: sk.track(far(np.zeros((2, 2, 1, 17, 2)), np.inf), synthetic.ring(2), fps=25, layout="h36m17"),
        "people[1, 1, 0, 16, 1]",
    ),
    "project": (lambda: sk.project(far(POINTS), [camera()]), "points[4, 2]"),
    "gaussians": (lambda: sk.project_gaussians(far(POINTS), WIDE, [camera()]), "means[4, 2]"),
    "covariances": (lambda: sk.render(POINTS, far(WIDE), camera()), "covariances[4, 2, 2]"),
    "triangulate": (lambda: sk.triangulate(far(PIXELS)[None], [camera()]), "detections[0, 4, 1]"),
    "refine": (lambda: sk.refine(None, far(PIXELS)[None, None], [camera()]), "detections[0, 0, 4, 1]"),
    "heat_maps": (lambda: sk.pseudo_ground_truth(far(PIXELS), POINTS, WIDE, camera()), "detections[4, 1]"),
    "start": (lambda: sk.refine(far(POINTS), PIXELS[None], [camera()]), "init_pose[4, 2]"),
    "fuse": (lambda: sk.fuse_monocular(far(POINTS)[None], PIXELS[None], [camera()]), "poses[0, 4, 2]"),
    "undistort": (lambda: camera().undistort(far(PIXELS)), "points[4, 1]"),
    "quaternions": (
        lambda: sk.loss_and_gradient(POINTS, POINTS * 0, far(TURNS), PIXELS[None], [camera()]),
        "quaternions[4, 3]",
    ),
}


@pytest.mark.parametrize("case", FAR_VALUES)
def test_numbers_that_are_none_to_compute_with(case):
    call, name = FAR_VALUES[case]
    with pytest.raises(sk.InvalidInputError, match=f"^{re.escape(name)}: expected values within ±1e30"):
        call()


def test_a_log_scale_beyond_all_lengths():
    with pytest.raises(sk.InvalidInputError, match=r"^log_scales\[4, 2\]: expected a value within ±50"):
        sk.loss_and_gradient(POINTS, far(POINTS * 0), TURNS, PIXELS[None], [camera()])


def test_a_start_that_is_too_exact():
    text = "init_sigma: expected standard deviations of at least 1e-15, got 1e-200"
    with pytest.raises(sk.InvalidInputError, match=f"^{text}$"):
        sk.refine(POINTS, PIXELS[None], [camera()], init_sigma=1e-200)


measured = pytest.mark.skipif(sys.platform != "linux", reason="other systems do not say what is available")

# 65,535² pixels: 17 GB on each channel, with as many channels as no machine has memory for.
LARGEST = camera(size=(65535, 65535))
CHANNELS = 2000
HUGE = (np.zeros((CHANNELS, 3)), np.tile(np.eye(3) * 1e10, (CHANNELS, 1, 1)))
NEED = r"images: 2000 x 65535 x 65535 float32 values need 34358.7 GB"


@measured
def test_images_that_do_not_fit_into_memory():
    with pytest.raises(MemoryError, match=NEED):
        sk.render(*HUGE, LARGEST)
    with pytest.raises(MemoryError, match=NEED):
        sk.pseudo_ground_truth(np.full((CHANNELS, 2), 500.0), *HUGE, LARGEST)


@measured
@pytest.mark.filterwarnings("ignore:The skeleton measures")
@pytest.mark.parametrize("encoding", ["one_hot", "single"])
@pytest.mark.parametrize("frames", [1, 3])
def test_windows_that_do_not_fit_into_memory(encoding, frames):
    detections = np.full((frames, 1, CHANNELS, 2), 500.0)
    cameras = [LARGEST] * (1 if encoding == "one_hot" else 500)
    detections = np.repeat(detections, len(cameras), axis=1)
    config = sk.RefineConfig.paper(sigma_mm=1e6, encoding=encoding)
    start = np.zeros((frames, CHANNELS, 3))
    with pytest.raises(MemoryError, match=r"^heat maps: the windows of \d+ detections.* need \d+\.\d GB"):
        sk.refine(start, detections, cameras, config=config)


@measured
def test_projections_that_do_not_fit_into_memory():
    # The points are one number in memory, the cameras one camera.
    points = np.broadcast_to(np.zeros(3), (200_000, 3))
    with pytest.raises(MemoryError, match=r"^projections: 200000 points in 2000000 views need 6400.0 GB"):
        sk.project(points, [camera()] * 2_000_000)


def test_an_image_of_the_largest_side_is_drawn():
    wide = camera(K=intrinsics(cx=65534.0, cy=20.0), size=(65535, 40))
    image = sk.render(np.zeros((1, 3)), np.eye(3)[None] * 400.0, wide)
    assert image.shape == (1, 40, 65535)
    assert image[0, :, -40:].max() > 0.0


@pytest.mark.filterwarnings("ignore:The skeleton measures")
@pytest.mark.parametrize("seed", range(3))
def test_no_finite_camera_that_is_accepted_panics_or_gives_infinite_numbers(seed):
    random = np.random.default_rng(seed)

    def somewhere(low, high):
        return 10.0 ** random.uniform(low, high) * random.choice([-1.0, 1.0])

    for _ in range(40):
        k = intrinsics(*(abs(somewhere(-9, 9)) for _ in range(2)), somewhere(0, 9), somewhere(0, 9))
        lens = [somewhere(-9, 9) for _ in range(random.choice([4, 5, 8, 12, 14]))]
        size = tuple(int(abs(somewhere(0, 2.5))) for _ in range(2))
        cameras = [
            camera(K=k, t=[somewhere(0, 12) for _ in range(3)], size=size, distortion=lens),
            camera(K=k, size=size),
        ]
        points = random.normal(size=(4, 3)) * abs(somewhere(0, 30))
        points = np.clip(points, -1e30, 1e30)
        spread = np.tile(np.eye(3) * abs(somewhere(-30, 30)), (4, 1, 1))
        pixels = sk.project(points, cameras)
        assert not np.isinf(pixels).any()
        assert not any(np.isinf(found).any() for found in sk.project_gaussians(points, spread, cameras))
        assert np.isfinite(sk.render(points, spread, cameras[0])).all()
        seen = np.where(np.abs(pixels) <= 1e30, pixels, 1e30 * random.uniform(-1, 1, size=pixels.shape))
        assert np.isfinite(sk.pseudo_ground_truth(seen[1], points, spread, cameras[1])).all()
        for method in ("robust", "dlt", "ransac"):
            assert not np.isinf(sk.triangulate(seen, cameras, method=method)).any()
        found = sk.refine(None, seen, cameras)
        assert not np.isinf(found.pose).any()
        assert not np.isinf(found.reprojection_error).any()


def test_far_outliers_are_rejected_as_before():
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", 1, seed=3)[0]
    seen = sk.project(pose, rig)
    seen[0, 0] = 1e20
    found = sk.refine(None, seen, rig, layout="h36m17")
    assert np.abs(found.pose - pose).max() < 0.1
    assert found.view_weights[0, 0] < 0.25
