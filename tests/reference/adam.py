"""Adam with bias correction (Kingma & Ba 2015, algorithm 1), one learning rate per call."""

import numpy as np

from reference.arrays import Array

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-15
"""DESIGN §2 "Optimisation"."""


class Adam:
    """The state of one parameter group."""

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
