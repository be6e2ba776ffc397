"""`Camera` against OpenCV: every distortion model forward and back."""

import cv2
import numpy as np
import pytest

import skelsplat as sk
from reference import camera as twin
from reference.arrays import Array

SIZE = (1280, 960)
K = np.array([[1010.0, 0.0, 655.5], [0.0, 1003.0, 470.25], [0.0, 0.0, 1.0]])
ROTATION = np.array([0.2, -0.3, 0.1])
R = np.asarray(cv2.Rodrigues(ROTATION)[0], dtype=float)
T = np.array([120.0, -80.0, 2500.0])
OPENCV = {
    4: [-0.21, 0.09, 0.0012, -0.0008],
    5: [-0.21, 0.09, 0.0012, -0.0008, -0.02],
    8: [0.31, -0.12, 0.0012, -0.0008, 0.02, 0.42, -0.09, 0.01],
    12: [0.31, -0.12, 0.0012, -0.0008, 0.02, 0.42, -0.09, 0.01, 0.002, -0.001, 0.0015, 0.0007],
}
OPENCV[14] = [*OPENCV[12], 0.02, -0.03]
FISHEYE = [-0.02, 0.011, -0.006, 0.0012]
FORWARD_PX = 1e-9
"""A few dozen float64 operations on pixels near 1000: 1e-12 px at best; a thousand times that."""
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
BACK_PX = 2e-8
"""The package converges to 1e-9 px; OpenCV iterates until its own steps are far below that."""


def points() -> Array:
    """World points (60,3) that fill most of the image."""
    rng = np.random.default_rng(4)
    camera_points = np.column_stack(
        [rng.uniform(-1300, 1300, 60), rng.uniform(-1000, 1000, 60), rng.uniform(2400, 3500, 60)]
    )
    return np.asarray((camera_points - T) @ R)


def make(distortion: list[float], *, fisheye: bool = False) -> sk.Camera:
    return sk.Camera(K, R, T, distortion=np.array(distortion), fisheye=fisheye, size=SIZE)


def opencv_pixels(distortion: list[float], *, fisheye: bool = False) -> Array:
    """Return what OpenCV projects `points` to: (60,2)."""
    if fisheye:
        found = cv2.fisheye.projectPoints(points()[:, None], ROTATION, T, K, np.array(distortion))[0]
    else:
        found = cv2.projectPoints(points(), ROTATION, T, K, np.array(distortion))[0]
    return np.asarray(found, dtype=float).reshape(-1, 2)


@pytest.mark.parametrize("count", OPENCV)
def test_project_equals_opencv(count: int) -> None:
    expected = opencv_pixels(OPENCV[count])
    assert sk.project(points(), [make(OPENCV[count])])[0] == pytest.approx(expected, rel=0, abs=FORWARD_PX)


def test_fisheye_project_equals_opencv() -> None:
    expected = opencv_pixels(FISHEYE, fisheye=True)
    found = sk.project(points(), [make(FISHEYE, fisheye=True)])[0]
    assert found == pytest.approx(expected, rel=0, abs=FORWARD_PX)
    by_twin = twin.project(points(), K, R, T, distortion=np.array(FISHEYE), fisheye=True)
    assert by_twin == pytest.approx(expected, rel=0, abs=FORWARD_PX)


def image_grid() -> Array:
    """Pixels (12,9,2) over the whole image."""
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 12), np.linspace(0, SIZE[1] - 1, 9), indexing="ij")
    return np.stack([u, v], axis=-1)


@pytest.mark.parametrize("count", OPENCV)
def test_undistort_equals_opencv(count: int) -> None:
    distortion = np.array(OPENCV[count])
    seen = image_grid()
    if int(cv2.__version__.partition(".")[0]) < 5:
        expected = cv2.undistortPointsIter(seen.reshape(-1, 1, 2), K, distortion, np.eye(3), K, CRITERIA)
    else:
        expected = cv2.undistortPoints(seen.reshape(-1, 1, 2), K, distortion, P=K, criteria=CRITERIA)
    found = make(OPENCV[count]).undistort(seen)
    assert found.shape == seen.shape
    assert found == pytest.approx(np.asarray(expected).reshape(seen.shape), rel=0, abs=BACK_PX)


def test_fisheye_undistort_equals_opencv() -> None:
    seen = image_grid()
    expected = cv2.fisheye.undistortPoints(
        seen.reshape(-1, 1, 2), K, np.array(FISHEYE), P=K, criteria=CRITERIA
    )
    found = make(FISHEYE, fisheye=True).undistort(seen)
    assert found == pytest.approx(np.asarray(expected).reshape(seen.shape), rel=0, abs=BACK_PX)
