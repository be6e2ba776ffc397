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
from reference.rays import Rays, information, offsets

REACH = 6.0
MOTION_REACH, MOTION_SPAN, TRUST_SPAN = 6.0, 0.1, 0.1
CLOSE, LEAST_CLOSE = 0.7, 3
AGREES = 0.25
SPAN, AROUND, PRIOR, PRIOR_TIME, LEAST = 0.4, 0.5, 6.0, 0.2, 6
CLEAR, SOFT, LEAST_WHITE, USUAL_AGILITY = 12.0, 1.0, 0.1, 2.5e6
SLOW_RATE, SHARE = 15.0, 0.5


class Model(NamedTuple):
    """Bones (B,2) with l and σ (B,2); ŝ² (mm²) and σ (mm) of the joints (N,); fps."""

    bones: Sequence[tuple[int, int]]
    lengths: Array
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


def held(alone: Array, rays: Sequence[Rays], sigma: Array) -> Array:
    """Least k (T,M,N): that at the pose of the frame alone (T,N,3) where all of at least three are close."""
    k = kernels(alone, rays, sigma)
    there = np.array([frame.weight > 0 for frame in rays])
    close = np.count_nonzero(there & (k >= CLOSE), axis=1)
    all_close = (close >= LEAST_CLOSE) & (close == np.count_nonzero(there, axis=1))
    return np.where(all_close[:, None], k, 0.0)


def agility(alone: Array, rays: Sequence[Rays], model: Model) -> Array:
    """Densities q (T,N), mm²/s³: by the second differences around, of a joint and its neighbours."""
    T, N = alone.shape[:2]
    spans, around = frames_in(SPAN, model.fps), frames_in(AROUND, model.fps)
    prior = max(PRIOR, PRIOR_TIME * model.fps)
    k = kernels(alone, rays, model.sigma)
    there = np.array([frame.weight > 0 for frame in rays]).sum(axis=1)
    agree = (k >= AGREES).sum(axis=1)
    sure = np.where(((agree >= 3) | ((there == 2) & (agree == 2)))[..., None], alone, np.nan)
    views = held(alone, rays, model.sigma) > 0
    rate = np.minimum(np.maximum(SLOW_RATE / model.fps, SHARE), 1.0)

    second = np.full((spans, T, N), np.nan)
    usual = np.full((spans, N), np.nan)
    for h in range(1, min(spans, (T - 1) // 2) + 1):
        square = np.sum((sure[: -2 * h] - 2 * sure[h:-h] + sure[2 * h :]) ** 2, axis=-1) / 3
        same = views[h:-h].any(axis=1) & np.all(
            (views[: -2 * h] == views[h:-h]) & (views[2 * h :] == views[h:-h]), axis=1
        )
        second[h - 1, h:-h] = np.where(same, square, np.nan)
        for j in range(N):
            known = np.sort(square[np.isfinite(square[:, j]), j])
            if len(known) >= LEAST and (h == 1 or np.isfinite(usual[h - 2, j])):
                usual[h - 1, j] = known[: len(known) - len(known) // 10].mean()

    white = np.clip(usual[0] / 6, LEAST_WHITE * model.variance, model.variance)
    white = np.where(np.isfinite(white), white, model.variance)
    long = (np.arange(spans) + 1) / model.fps
    q = np.array([density(usual[np.isfinite(usual[:, j]), j], white[j], long) for j in range(N)])
    shows = np.isfinite(usual[-1]) | (usual > CLEAR * white).any(axis=0)
    known = q[shows & np.isfinite(q)]
    q = np.where(shows & np.isfinite(q), q, max(np.sort(known)[len(known) // 2], USUAL_AGILITY))
    usual = np.where(np.isfinite(usual), usual, 2 / 3 * q * long[:, None] ** 3 + 6 * white)

    out = np.zeros((T, N))
    for t in range(T):
        near = second[:, max(t - around, 0) : t + around + 1]
        ratios = np.nansum(near / usual[:, None], axis=1)
        counts = np.isfinite(near).sum(axis=1)
        for j in range(N):
            joints = [j, *(sum(bone) - j for bone in model.bones if j in bone)]
            ratio = prior + ratios[:, joints].sum(axis=1)
            squares = usual[:, j] * ratio / (prior + counts[:, joints].sum(axis=1))
            share = rate + (1 - rate) * counts[0, j] / (counts[0, j] + prior)
            free = share * densities(squares, white[j], long) * model.variance[j] / white[j]
            left = np.clip(CLEAR / 6 + SOFT / 2 - squares / (6 * white[j]), 0, SOFT) / SOFT
            left[-1] = 0
            shown = np.concatenate([[1.0], np.cumprod(left[:-1])]) * (1 - left)
            fastest = (np.pi * model.fps) ** 4 * model.variance[j] / model.fps
            out[t, j] = shown @ np.minimum(free, fastest)
    return out


def densities(squares: Array, white: float, long: Array) -> Array:
    """Density q by the mean square of second differences over each of the times `long`."""
    return 1.5 * np.maximum(squares - 6 * white, 0.6 * white) / long**3


def density(squares: Array, white: float, long: Array) -> float:
    """Density q by the mean square over the first of the times `long` at which it exceeds the noise."""
    if len(squares) == 0:
        return np.nan
    clear = np.flatnonzero(squares > CLEAR * white)
    h = clear[0] if len(clear) else len(squares) - 1
    return float(densities(squares, white, long[: len(squares)])[h])


def weights(x: Array, alone: Array, rays: Sequence[Rays], model: Model) -> Weights:
    """Weights at x: k times its mean over the frames around, and Cauchy's of the accelerations."""
    q = agility(alone, rays, model)
    least = held(alone, rays, model.sigma)
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
        usual = 3 * q[t] * (span * dt) ** 3 * (2 / 3 if span > 1 else 1.0)
        d = x[t - span] - 2 * x[t] + x[t + span]
        kept = 1 / (1 + np.sum(d**2, axis=-1) / (usual * MOTION_REACH**2))
        motion[t] = kept / (q[t] * dt**3)
    return Weights(seen, motion)


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


# The detections' noise: factors of a variance, means of posteriors on a ladder of doublings. A detection of
# confidence c errs by N(0, v/c), v = usual · 2^(class + view + own), or at will (ε).

OCTAVES = np.arange(29) / 2 - 4
WRONG, ANYWHERE = (0.02, 0.1, 0.25, 0.45, 0.65), 320.0
FACTOR = 1.0
MOST_FRAMES, MIDDLE, INDEPENDENT, TAKEN, LEAST_SUPPORT = 6.0, 1.0, 0.2, 0.7, 1.5


def residuals(x: Array, rays: Sequence[Rays], model: Model, held: Weights) -> tuple[Array, Array]:
    """½ c |e|²/(1−h) and 1−h (T,M,N), 0 where a frame shows nothing, with a share h of the leverage."""
    k = kernels(x, rays, model.sigma)
    squares, left = np.zeros_like(k), np.zeros_like(k)
    for t, frame in enumerate(rays):
        e, _ = offsets(x[t], frame)
        shown = np.flatnonzero(k[t].sum(axis=0) > LEAST_SUPPORT)
        spread = np.linalg.inv(information(held.seen[t], frame)[shown])
        d, c = frame.direction[:, shown], frame.weight[:, shown]
        across = np.trace(spread, axis1=1, axis2=2) - np.einsum("mna,nab,mnb->mn", d, spread, d)
        leverage = np.clip(c / model.variance[shown] * k[t][:, shown] * across / 2, 0, 1)
        left[t][:, shown] = np.where(c > 0, 1 - TAKEN * leverage, 0.0)
        squares[t][:, shown] = c * np.sum(e[:, shown] ** 2, axis=-1) / 2 / (1 - TAKEN * leverage)
    return squares, left


def log_p(square: Array, wrong: float, usual: float) -> Array:
    """Log p (…,29) of squares, multiples of the usual variance, each as the middle of a quarter doubling."""
    mantissa, exponent = np.frexp(square)
    quarter = np.clip(4 * (exponent - 1) + np.floor(8 * mantissa - 4), -48, 63)
    middle = 2.0 ** (quarter // 4) * (1 + (quarter % 4 + 0.5) / 4)
    v = 2.0**OCTAVES
    return np.log((1 - wrong) / v * np.exp(-middle[..., None] / v) + wrong * usual / ANYWHERE**2)


def mean(log: Array, prior: float, spread: float) -> float:
    """Mean of the posterior with a normal prior, doublings."""
    log = log - ((OCTAVES - prior) / spread) ** 2 / 2
    weight = np.exp(log - log.max())
    return float(weight @ OCTAVES / weight.sum())


def learnt(squares: Array, left: Array, variance: Array, classes: Array) -> tuple[Array, float]:
    """Variances (M,N) of joints of these classes (N,), and ε."""
    usual = float(np.sort(variance)[len(variance) // 2])
    every = [np.einsum("tmn,tmnk->mnk", left, log_p(squares / usual, wrong, usual)) for wrong in WRONG]
    best = int(np.argmax([own.sum(axis=(0, 1)).max() for own in every]))
    cells = every[best] * (MOST_FRAMES / (MOST_FRAMES + (left > 0).sum(axis=0)))[..., None]
    M, N = cells.shape[:2]

    def less(factor: Array) -> Array:
        every = zip(cells.reshape(-1, 29), np.broadcast_to(factor, (M, N)).ravel(), strict=True)
        return np.array([np.interp(OCTAVES + own, OCTAVES, log) for log, own in every]).reshape(M, N, 29)

    shared = mean(cells.sum(axis=(0, 1)), 0.0, np.inf)
    of_view = np.zeros(M)
    for _ in range(3):
        known = less(of_view[:, None])
        of_class = [mean(known[:, classes == own].sum(axis=(0, 1)), shared, 1.5 * FACTOR) for own in classes]
        of_view = np.array([mean(own.sum(axis=0), 0.0, FACTOR) for own in less(np.array(of_class))])
    own = [[mean(cells[m, n], of_class[n] + of_view[m], FACTOR / 2) for n in range(N)] for m in range(M)]
    return usual * 2.0 ** np.array(own), WRONG[best]


def in_time(squares: Array, left: Array, variance: Array, wrong: float, fps: float) -> Array:
    """Factors (M,T) of the variances (M,N)."""
    usual, reach = float(np.sort(variance.ravel())[variance.size // 2]), frames_in(MIDDLE, fps)
    log = np.einsum("tmn,tmnk->tmk", left, log_p(squares / variance, wrong, usual)) / (1 + INDEPENDENT * fps)
    out = np.ones(squares.shape[1::-1])
    for t in range(len(log)):
        near = log[max(t - reach, 0) : t + reach + 1].sum(axis=0)
        shared = mean(near.sum(axis=0), 0.0, FACTOR)
        out[:, t] = [2.0 ** mean(own, shared, FACTOR / 2) for own in near]
    return out
