"""The detections' noise in a recording: factors of a variance, means of posteriors on a ladder of doublings.

A detection of confidence c errs by N(0, v/c), v = usual · 2^(class + view + own), or at will (ε).
"""

from collections.abc import Sequence

import numpy as np

from reference import sequence
from reference.arrays import Array
from reference.rays import Rays, information, offsets

OCTAVES = np.arange(29) / 2 - 4
WRONG, ANYWHERE = (0.02, 0.1, 0.25, 0.45, 0.65), 320.0
OF_CLASS, OF_VIEW, OF_CELL, OF_TIME = 1.5, 1.0, 0.5, 1.0
MOST_FRAMES, AROUND, INDEPENDENT, TAKEN, LEAST_SUPPORT = 6.0, 1.0, 0.2, 0.7, 1.6


def residuals(
    x: Array, rays: Sequence[Rays], model: sequence.Model, held: sequence.Weights
) -> tuple[Array, Array]:
    """½ c |e|²/(1−h) and 1−h (T,M,N), 0 where a frame shows nothing, with a share h of the leverage."""
    k = sequence.kernels(x, rays, model.sigma)
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
        of_class = [mean(known[:, classes == own].sum(axis=(0, 1)), shared, OF_CLASS) for own in classes]
        of_view = np.array([mean(own.sum(axis=0), 0.0, OF_VIEW) for own in less(np.array(of_class))])
    own = [[mean(cells[m, n], of_class[n] + of_view[m], OF_CELL) for n in range(N)] for m in range(M)]
    return usual * 2.0 ** np.array(own), WRONG[best]


def in_time(squares: Array, left: Array, variance: Array, wrong: float, fps: float) -> Array:
    """Factors (M,T) of the variances (M,N)."""
    usual, reach = float(np.sort(variance.ravel())[variance.size // 2]), sequence.frames_in(AROUND, fps)
    log = np.einsum("tmn,tmnk->tmk", left, log_p(squares / variance, wrong, usual)) / (1 + INDEPENDENT * fps)
    out = np.ones(squares.shape[1::-1])
    for t in range(len(log)):
        near = log[max(t - reach, 0) : t + reach + 1].sum(axis=0)
        shared = mean(near.sum(axis=0), 0.0, OF_TIME)
        out[:, t] = [2.0 ** mean(own, shared, OF_CELL) for own in near]
    return out
