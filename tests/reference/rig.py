"""The equations of `adjust_cameras`: derivatives by central differences, joints eliminated densely."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.linalg import inv

from reference.arrays import Array
from reference.camera import project

# Information on a joint that holds what no ray does, relative to a detection's.
LOOSE = 1e-5
# Frames on either side from which the movement of a detection is measured.
REACH = 2
# Steps of the differences: rad, mm, relative; and of a joint, mm.
STEPS = (1e-5, 1e-5, 1e-5, 1e-2, 1e-2, 1e-2, 1e-5)
STEP = 1e-3


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


def sight(detections: Array, t: int, i: int, j: int, clock: float) -> tuple[Array, Array] | None:
    """Pixel of a detection when all clocks show t, and its movement, px per frame; None where missing."""
    k = t + round(clock)
    if not 0 <= k < len(detections) or not np.isfinite(detections[k, i, j]).all():
        return None
    pairs = [
        (d, detections[k + d, i, j, :2] - detections[k - d, i, j, :2])
        for d in range(1, REACH + 1)
        if k - d >= 0 and k + d < len(detections)
    ]
    pairs = [(d, move) for d, move in pairs if np.isfinite(move).all()]
    speed = sum(d * move for d, move in pairs) / sum(2 * d * d for d, _ in pairs) if pairs else np.zeros(2)
    return detections[k, i, j, :2] + speed * (clock - round(clock)), speed


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
            seen = sight(detections, t, i, j, camera.clock)
            if seen is None:
                continue
            pixel, speed = seen
            residual = camera.pixel(x, np.zeros(7)) - pixel
            A, B = slopes(camera, x, speed)
            mm = (camera.R @ x + camera.t)[2] / np.sqrt(camera.K[0, 0] * camera.K[1, 1])
            k = np.exp(-(mm**2) * (residual @ residual) / (4 * sigma**2))
            confidence = detections[t + round(camera.clock), i, j, 2]
            cost += confidence * 2 * sigma**2 * (1 - k)
            W = confidence * k * mm**2
            own = slice(8 * i, 8 * i + 8)
            matrix[own, own] += W * B.T @ B
            gradient[own] += W * B.T @ residual
            H, h, C[own] = H + W * A.T @ A, h + W * A.T @ residual, W * B.T @ A
        loose = inv(H + LOOSE * np.trace(H) * np.eye(3))
        matrix -= C @ loose @ C.T
        gradient -= C @ loose @ h
    return matrix, gradient, cost


def slopes(camera: Camera, x: Array, speed: Array) -> tuple[Array, Array]:
    """Return derivatives of a pixel by the point (2, 3) and by the camera (2, 8)."""
    nothing = np.zeros(7)
    A = np.stack(
        [
            (camera.pixel(x + e, nothing) - camera.pixel(x - e, nothing)) / (2 * STEP)
            for e in STEP * np.eye(3)
        ],
        axis=1,
    )
    B = np.empty((2, 8))
    for k, step in enumerate(STEPS):
        e = np.zeros(7)
        e[k] = step
        B[:, k] = (camera.pixel(x, e) - camera.pixel(x, -e)) / (2 * step)
    B[:, 7] = -speed
    return A, B
