"""A step of a recording's solution on dense matrices: the terms, their gradient and Gauss–Newton's H.

With the offsets e of joints from rays, the weights w of detections and m of accelerations held, the poses x
(T,N,3) minimise

    F = ½ Σ w |e|² + Σ_b 36 (1 − exp(−(‖x_a−x_b‖−l)²/(72 σ_b²))) + ½ Σ m |x_{t−1} − 2 x_t + x_{t+1}|²

All lengths are mm. H and the gradient are joint after joint, each over all frames: (N,T,3).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from reference.arrays import Array
from reference.rays import Rays, offsets

REACH = 6.0
MOTION_REACH, MOTION_SPAN, TRUST_SPAN = 4.0, 0.05, 0.1
CLOSE, LEAST_CLOSE = 0.7, 3


class Model(NamedTuple):
    """Bones (B,2) with l and σ (B,2); q (mm²/s³), ŝ² (mm²) and σ (mm) of the joints (N,); fps."""

    bones: Sequence[tuple[int, int]]
    lengths: Array
    agility: Array
    variance: Array
    sigma: Array
    fps: float


class Weights(NamedTuple):
    """w (T,M,N) of detections and m (T,N) of accelerations, 0 at the ends."""

    seen: Array
    motion: Array


def frames_in(seconds: float, fps: float) -> int:
    """At least one frame; halves are rounded up."""
    return max(int(np.floor(seconds * fps + 0.5)), 1)


def kernels(x: Array, rays: Sequence[Rays], sigma: Array) -> Array:
    """Kernels k (T,M,N), 0 where there is no detection."""
    out = []
    for pose, frame in zip(x, rays, strict=True):
        e, along = offsets(pose, frame)
        k = np.exp(-np.sum(e**2, axis=-1) / (4 * sigma**2))
        out.append(np.where((frame.weight > 0) & (along > 0), k, 0.0))
    return np.array(out)


def held(alone: Array, rays: Sequence[Rays], sigma: float) -> Array:
    """Least k (T,M,N): that at the pose of the frame alone (T,N,3) where all of at least three are close."""
    k = kernels(alone, rays, np.full(alone.shape[1], sigma))
    there = np.array([frame.weight > 0 for frame in rays])
    close = np.count_nonzero(there & (k >= CLOSE), axis=1)
    all_close = (close >= LEAST_CLOSE) & (close == np.count_nonzero(there, axis=1))
    return np.where(all_close[:, None], k, 0.0)


def weights(x: Array, alone: Array, rays: Sequence[Rays], model: Model) -> Weights:
    """Weights at x: k times its mean over the frames around, and Cauchy's of the accelerations."""
    least = held(alone, rays, float(model.sigma[0]))
    k = np.maximum(kernels(x, rays, model.sigma), least)
    there = np.array([frame.weight > 0 for frame in rays])
    around = frames_in(TRUST_SPAN, model.fps)
    mean = np.zeros_like(k)
    for t in range(len(x)):
        near = slice(max(t - around, 0), t + around + 1)
        n = there[near].sum(axis=0)
        mean[t] = np.divide(k[near].sum(axis=0), n, out=np.zeros(n.shape), where=n > 0)
    confidence = np.array([frame.weight for frame in rays])
    seen = confidence * k * np.maximum(mean, least) / model.variance

    h, dt = frames_in(MOTION_SPAN, model.fps), 1 / model.fps
    motion = np.zeros(x.shape[:2])
    for t in range(1, len(x) - 1):
        span = h if t >= h and t + h < len(x) else 1
        usual = 3 * model.agility * (span * dt) ** 3 * (2 / 3 if span > 1 else 1.0)
        d = x[t - span] - 2 * x[t] + x[t + span]
        kept = 1 / (1 + np.sum(d**2, axis=-1) / (usual * MOTION_REACH**2))
        motion[t] = kept / (model.agility * dt**3)
    return Weights(seen, motion)


def objective(x: Array, rays: Sequence[Rays], model: Model, held_weights: Weights) -> float:
    """F at poses (T,N,3), with the weights held."""
    total = 0.0
    for pose, frame, w in zip(x, rays, held_weights.seen, strict=True):
        e, _ = offsets(pose, frame)
        total += 0.5 * float(np.where(w > 0, w * np.sum(e**2, axis=-1), 0.0).sum())
    for (a, b), (length, sigma) in zip(model.bones, model.lengths, strict=True):
        r = np.linalg.norm(x[:, a] - x[:, b], axis=-1) - length
        total += float(np.sum(REACH**2 * (1 - np.exp(-(r**2) / (2 * REACH**2 * sigma**2)))))
    bent = np.sum(np.diff(x, 2, axis=0) ** 2, axis=-1)
    return total + 0.5 * float(np.sum(held_weights.motion[1:-1] * bent))


def normal_equations(
    x: Array, rays: Sequence[Rays], model: Model, held_weights: Weights
) -> tuple[Array, Array]:
    """H (3NT,3NT) and ∇F (N,T,3)."""
    T, N = x.shape[:2]
    H, gradient = np.zeros((N, T, 3, N, T, 3)), np.zeros((N, T, 3))
    eye = np.eye(3)
    for t, (frame, w) in enumerate(zip(rays, held_weights.seen, strict=True)):
        e, _ = offsets(x[t], frame)
        across = eye - np.einsum("mna,mnb->mnab", frame.direction, frame.direction)
        for j in range(N):
            H[j, t, :, j, t] += np.einsum("m,mab->ab", w[:, j], across[:, j])
            gradient[j, t] += w[:, j] @ e[:, j]
    for (a, b), (length, sigma) in zip(model.bones, model.lengths, strict=True):
        for t in range(T):
            d = x[t, a] - x[t, b]
            long = np.linalg.norm(d)
            u, r = d / long, long - length
            k = np.exp(-(r**2) / (2 * REACH**2 * sigma**2)) / sigma**2
            block = k * (np.outer(u, u) + max(r, 0.0) / long * (eye - np.outer(u, u)))
            for p, q, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
                H[p, t, :, q, t] += sign * block
            gradient[a, t] += k * r * u
            gradient[b, t] -= k * r * u
    for j in range(N):
        second = np.diff(np.eye(T), 2, axis=0)
        stiff = second.T @ (held_weights.motion[1:-1, j, None] * second)
        for axis in range(3):
            H[j, :, axis, j, :, axis] += stiff
        gradient[j] += stiff @ x[:, j]
    return H.reshape(3 * N * T, 3 * N * T), gradient
