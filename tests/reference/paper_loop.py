"""The whole of `RefineConfig.paper()` for one pose in mm (DESIGN §2, "Optimisation")."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from reference.arrays import Array, Gaussians, View
from reference.symmetry import Pairs, observed_pairs
from reference.total import SYMMETRY_WEIGHT, detected, loss_and_gradient, targets

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-15
"""DESIGN §2 "Optimisation"."""


class Adam:
    """Adam with bias correction (Kingma & Ba 2015, algorithm 1): the state of one parameter group."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.first = np.zeros(shape)
        self.second = np.zeros(shape)
        self.steps = 0

    def step(self, parameter: Array, gradient: Array, learning_rate: float) -> Array:
        """Return the parameter after one step: θ − α·m̂/(√v̂ + ε)."""
        self.steps += 1
        self.first = BETA1 * self.first + (1 - BETA1) * gradient
        self.second = BETA2 * self.second + (1 - BETA2) * gradient**2
        m_hat = self.first / (1 - BETA1**self.steps)
        v_hat = self.second / (1 - BETA2**self.steps)
        return np.asarray(parameter - learning_rate * m_hat / (np.sqrt(v_hat) + EPSILON))


@dataclass(frozen=True)
class PaperConfig:
    """Every number of the loop; lengths in mm, learning rates per step."""

    sigma_mm: float = float(np.exp(3.0))
    encoding: str = "one_hot"
    symmetry_weight: float = SYMMETRY_WEIGHT
    max_steps: int = 125
    views_per_step: int | None = None
    position_lr_mm: float = 3.0
    log_scale_lr: float = 0.005
    rotation_lr: float = 0.001
    lr_decay: float = 0.01
    lr_decay_steps: int = 1000
    stop_tolerance: float = 1e-6


@dataclass(frozen=True)
class PaperResult:
    """Gaussians after the last step, the loss before each step, the differences that stopping looked at."""

    gaussians: Gaussians
    losses: list[float]
    window_differences: list[float]
    stop_reason: str


def initial_gaussians(pose: Array, sigma: float) -> Gaussians:
    """Isotropic Gaussians of standard deviation `sigma` at the joints (N,3)."""
    n = len(pose)
    return Gaussians(pose.copy(), np.full((n, 3), np.log(sigma)), np.tile([1.0, 0, 0, 0], (n, 1)))


def step_views(step: int, n_views: int, views_per_step: int | None) -> list[int]:
    """Return the views of a step, taken cyclically: (t·v + k) mod M for k < v."""
    count = n_views if views_per_step is None else views_per_step
    return [(step * count + k) % n_views for k in range(count)]


def position_lr(step: int, config: PaperConfig) -> float:
    """lr₀·0.01^(t/1000): by a factor of 100 over 1000 steps. The other groups keep their rate."""
    return float(config.position_lr_mm * config.lr_decay ** (step / config.lr_decay_steps))


def window_difference(losses: list[float], window: int) -> float | None:
    """|min of the last window − min of the one before| after each full window; None in between."""
    if len(losses) % window or len(losses) < 2 * window:
        return None
    return abs(min(losses[-window:]) - min(losses[-2 * window : -window]))


def refine(
    gaussians: Gaussians, detections: Array, views: Sequence[View], pairs: Pairs = (), *, config: PaperConfig
) -> PaperResult:
    """Run the loop from `gaussians`; the pseudo ground truth is made once, from these."""
    images = targets(gaussians, detections, views, config.encoding)
    pairs = observed_pairs(pairs, np.any(detected(detections), axis=0))
    optimizers = [Adam(group.shape) for group in gaussians]
    losses: list[float] = []
    differences: list[float] = []
    for step in range(config.max_steps):
        chosen = step_views(step, len(views), config.views_per_step)
        result = loss_and_gradient(
            gaussians,
            detections[chosen],
            [views[i] for i in chosen],
            [images[i] for i in chosen],
            encoding=config.encoding,
            pairs=pairs,
            symmetry_weight=config.symmetry_weight,
        )
        rates = (position_lr(step, config), config.log_scale_lr, config.rotation_lr)
        groups = zip(optimizers, gaussians, result.gradient, rates, strict=True)
        gaussians = Gaussians(*(adam.step(value, slope, rate) for adam, value, slope, rate in groups))
        losses.append(result.loss)
        difference = window_difference(losses, len(views))
        if difference is not None:
            differences.append(difference)
            if difference < config.stop_tolerance:
                return PaperResult(gaussians, losses, differences, "converged")
    return PaperResult(gaussians, losses, differences, "max_steps")
