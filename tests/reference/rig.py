"""The equations of `adjust_cameras` (derivatives by central differences) and of the floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.linalg import inv

from reference.arrays import Array
from reference.camera import project

# Information on a joint that holds what no ray does, relative to a detection's.
LOOSE = 1e-5
# Frames on either side from which the movement of a joint is measured.
REACH = 2
# Steps of the differences: rad, mm, relative; and of a joint, mm.
STEPS = (1e-5, 1e-5, 1e-5, 1e-2, 1e-2, 1e-2, 1e-5)
STEP = 1.0


@dataclass(frozen=True)
class Camera:
    """A camera, mm, and its clock, frames."""

    K: Array
    R: Array
    t: Array
    distortion: Array
    clock: float

    def pixel(self, x: Array, change: Array) -> Array:
        """Project a point (3,) by the camera turned about its axes, moved and zoomed by change (7,)."""
        angle = float(np.linalg.norm(change[:3]))
        R = self.R
        if angle > 0:
            a = change[:3] / angle
            cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
            R = (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross) @ R
        centre = -self.R.T @ self.t + change[3:6]
        K = self.K.copy()
        K[0, 0] *= np.exp(change[6])
        K[1, 1] *= np.exp(change[6])
        return project(x, K, R, -R @ centre, distortion=self.distortion)


def movement(points: Array, t: int, j: int, camera: Camera) -> Array:
    """Movement of a joint in the camera's image, px per frame, by least squares over pairs of frames."""
    pairs = [
        (d, points[t + d, j] - points[t - d, j])
        for d in range(1, REACH + 1)
        if t - d >= 0 and t + d < len(points)
    ]
    if not pairs:
        return np.zeros(2)
    speed = sum(d * move for d, move in pairs) / sum(2 * d * d for d, _ in pairs)
    return by_point(camera, points[t, j]) @ speed


def equations(
    points: Array, detections: Array, cameras: Sequence[Camera], sigma: float
) -> tuple[Array, Array, float]:
    """Return S (8M, 8M), s (8M,) and cost of joints (T, N, 3) and detections (T, M, N, 3); sigma in mm."""
    size = 8 * len(cameras)
    matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    for t, j in np.ndindex(points.shape[:2]):
        x = points[t, j]
        H, h, C = np.zeros((3, 3)), np.zeros(3), np.zeros((size, 3))
        for i, camera in enumerate(cameras):
            k = t + round(camera.clock)
            if not 0 <= k < len(detections) or not np.isfinite(detections[k, i, j]).all():
                continue
            speed = movement(points, t, j, camera)
            pixel, confidence = np.split(detections[k, i, j], [2])
            residual = camera.pixel(x, np.zeros(7)) - pixel - speed * (camera.clock - round(camera.clock))
            A, B = slopes(camera, x, speed)
            mm = (camera.R @ x + camera.t)[2] / np.sqrt(camera.K[0, 0] * camera.K[1, 1])
            kept = np.exp(-(mm**2) * (residual @ residual) / (4 * sigma**2))
            cost += confidence.item() * 2 * sigma**2 * (1 - kept)
            W = confidence.item() * kept * mm**2
            own = slice(8 * i, 8 * i + 8)
            matrix[own, own] += W * B.T @ B
            gradient[own] += W * B.T @ residual
            H, h, C[own] = H + W * A.T @ A, h + W * A.T @ residual, W * B.T @ A
        loose = inv(H + LOOSE * np.trace(H) * np.eye(3))
        matrix -= C @ loose @ C.T
        gradient -= C @ loose @ h
    return matrix, gradient, cost


def by_point(camera: Camera, x: Array) -> Array:
    """Return the derivative (2, 3) of a pixel by the point."""

    def difference(step: Array) -> Array:
        return camera.pixel(x + step, np.zeros(7)) - camera.pixel(x - step, np.zeros(7))

    # Of fourth order: exact to rounding.
    columns = [(8 * difference(e) - difference(2 * e)) / (12 * STEP) for e in STEP * np.eye(3)]
    return np.stack(columns, axis=1)


def slopes(camera: Camera, x: Array, speed: Array) -> tuple[Array, Array]:
    """Return derivatives of a pixel by the point (2, 3) and by the camera (2, 8)."""
    A = by_point(camera, x)
    B = np.empty((2, 8))
    for k, step in enumerate(STEPS):
        e = np.zeros(7)
        e[k] = step
        B[:, k] = (camera.pixel(x, e) - camera.pixel(x, -e)) / (2 * step)
    B[:, 7] = -speed
    return A, B


# Of ankles that stand for a while, one in ten says something new.
NEW = 0.1


def floor_cost(plane: Array, ankles: Array, sigma: float, tilt: float) -> float:
    """Minus log posterior of the plane z = a x + b y + c, `plane` (a, b, c), under ankles (K, 3).

    Heights above it are Cauchy-like with the scale `sigma`; (a, b) ~ N(0, tilt²).
    """
    height = ankles[:, 2] - ankles[:, :2] @ plane[:2] - plane[2]
    return float(NEW / 2 * np.log1p((height / sigma) ** 2).sum() + (plane[:2] ** 2).sum() / (2 * tilt**2))


def floor_covariance(plane: Array, ankles: Array, sigma: float, tilt: float) -> Array:
    """Covariance (3, 3) of the plane: an ankle counts as much as its weight says."""
    height = ankles[:, 2] - ankles[:, :2] @ plane[:2] - plane[2]
    information = np.diag([1 / tilt**2, 1 / tilt**2, 0.0])
    for (x, y, _), h in zip(ankles, height, strict=True):
        row = np.array([x, y, 1.0])
        information += NEW / (sigma**2 + h**2) * np.outer(row, row)
    return np.asarray(np.linalg.inv(information))
