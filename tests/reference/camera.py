"""World→camera, the pinhole, and OpenCV's two distortion models, forward only (DESIGN §1)."""

import numpy as np

from reference.arrays import Array


def to_camera(points: Array, R: Array, t: Array) -> Array:
    """x_c = R x_w + t for points (...,3)."""
    return np.asarray(points @ R.T + t)


def pinhole(camera_points: Array, K: Array) -> Array:
    """Pixels (...,2) of camera-frame points (...,3); integer coordinates are pixel centres."""
    homogeneous = camera_points @ K.T
    return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])


def tilt_matrix(tau_x: float, tau_y: float) -> Array:
    """Homography (3,3) of a tilted sensor (OpenCV's calibration docs, "tilted sensor"; angles in rad)."""
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    R = about_y @ about_x
    onto_sensor = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]])
    return np.asarray(onto_sensor @ R)


def distort_opencv(ideal: Array, coefficients: Array) -> Array:
    """Distort normalised coordinates (...,2) with 4, 5, 8, 12 or 14 coefficients.

    Order: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [τx τy]]]] (OpenCV's calib3d docs, "Detailed description").
    """
    padded = np.concatenate([coefficients, np.zeros(14 - len(coefficients))])
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = padded
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    x_d = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r2**2
    y_d = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s3 * r2 + s4 * r2**2
    tilted = np.stack([x_d, y_d, np.ones_like(x_d)], axis=-1) @ tilt_matrix(tau_x, tau_y).T
    return np.asarray(tilted[..., :2] / tilted[..., 2:])


def distort_fisheye(ideal: Array, coefficients: Array) -> Array:
    """Distort normalised coordinates (...,2) with k1..k4.

    θ_d = θ(1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) with θ = atan r (OpenCV's fisheye docs).
    """
    r = np.linalg.norm(ideal, axis=-1, keepdims=True)
    theta = np.arctan(r)
    powers = theta ** np.array([2, 4, 6, 8])
    theta_d = theta * (1 + np.sum(coefficients * powers, axis=-1, keepdims=True))
    return ideal * np.where(r > 0, theta_d / np.where(r > 0, r, 1.0), 1.0)


def project(
    points: Array, K: Array, R: Array, t: Array, *, distortion: Array | None = None, fisheye: bool = False
) -> Array:
    """Pixels (...,2) of world points (...,3) with distortion; NaN behind the camera."""
    camera_points = to_camera(points, R, t)
    depth = np.where(camera_points[..., 2:] > 0, camera_points[..., 2:], np.nan)
    ideal = camera_points[..., :2] / depth
    if distortion is not None:
        ideal = (distort_fisheye if fisheye else distort_opencv)(ideal, distortion)
    return pinhole(np.concatenate([ideal, np.ones_like(depth)], axis=-1), K)
