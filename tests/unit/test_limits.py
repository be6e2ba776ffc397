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


BROKEN_CAMERAS = [
    ({"K": intrinsics(fx=1e-306)}, "K"),
    ({"K": intrinsics(cx=-1e308)}, "K"),
    ({"t": [0, 1e200, 3e3]}, "t"),
    ({"distortion": [0, 0, -1e300, 0]}, "distortion"),
    ({"size": (1000, 2**31)}, "size"),
]


@pytest.mark.parametrize(("broken", "argument"), BROKEN_CAMERAS)
def test_a_camera_outside_its_ranges(broken, argument):
    with pytest.raises(sk.InvalidInputError, match=f"^{argument}: expected "):
        camera(**broken)


@pytest.mark.parametrize(
    "real",
    [
        {"K": intrinsics(fx=2e6, fy=2e6)},  # a microscope's
        {"t": [4.5e8, 5.3e9, 1e6]},  # a geographic grid in mm
        {"distortion": [22.6, -310.0, 1e-4, -2e-4, 980.0, 23.1, -300.0, 870.0]},
    ],
)
def test_real_cameras_lie_inside(real):
    sk.project(np.zeros((1, 3)), [camera(**real)])


POINTS = np.random.default_rng(0).normal(size=(5, 3)) * 100
WIDE = np.tile(np.eye(3) * 400.0, (5, 1, 1))
PIXELS = sk.project(POINTS, [camera()])[0]
TURNS = np.tile([1.0, 0, 0, 0], (5, 1))


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
    "covariances": (lambda: sk.render(POINTS, far(WIDE), camera()), "covariances[4, 2, 2]"),
    "triangulate": (lambda: sk.triangulate(far(PIXELS)[None], [camera()]), "detections[0, 4, 1]"),
    "fuse": (lambda: sk.fuse_monocular(far(POINTS)[None], PIXELS[None], [camera()]), "poses[0, 4, 2]"),
    "quaternions": (
        lambda: sk.loss_and_gradient(POINTS, POINTS * 0, far(TURNS), PIXELS[None], [camera()]),
        "quaternions[4, 3]",
    ),
}


@pytest.mark.parametrize("case", FAR_VALUES)
def test_numbers_that_are_none_to_compute_with(case):
    call, name = FAR_VALUES[case]
    with pytest.raises(sk.InvalidInputError, match=f"^{re.escape(name)}"):
        call()


# 65,535² pixels: 17 GB on each channel, with as many channels as no machine has memory for.
LARGEST = camera(size=(65535, 65535))
CHANNELS = 2000
HUGE = (np.zeros((CHANNELS, 3)), np.tile(np.eye(3) * 1e10, (CHANNELS, 1, 1)))
NEED = r"images: 2000 x 65535 x 65535 float32 values need 34358.7 GB"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not say what is available")
def test_images_that_do_not_fit_into_memory():
    with pytest.raises(MemoryError, match=NEED):
        sk.render(*HUGE, LARGEST)
