"""One 3D Gaussian: Σ = R S Sᵀ Rᵀ (DESIGN §1; paper, "Background"), forward and gradient."""

import numpy as np

from reference.arrays import Array, Gaussians


def rotation_matrix(quaternion: Array) -> Array:
    """R (3,3) of a quaternion (w, x, y, z), normalised first (DESIGN §1)."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_partials(unit: Array) -> Array:
    """∂R/∂(w, x, y, z) (4,3,3) of the polynomial in `rotation_matrix`, at a unit quaternion."""
    w, x, y, z = unit
    by_w = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    by_x = [[0, y, z], [y, -2 * x, -w], [z, w, -2 * x]]
    by_y = [[-2 * y, x, w], [x, 0, z], [-w, z, -2 * y]]
    by_z = [[-2 * z, -w, x], [w, -2 * z, y], [x, y, 0]]
    return 2.0 * np.array([by_w, by_x, by_y, by_z], dtype=float)


def covariance(log_scales: Array, quaternion: Array) -> Array:
    """Σ = R S Sᵀ Rᵀ (3,3) with S = diag(exp(log_scales))."""
    R = rotation_matrix(quaternion)
    S = np.diag(np.exp(log_scales))
    return np.asarray(R @ S @ S.T @ R.T)


def covariances(gaussians: Gaussians) -> Array:
    """Σ of every joint, (N,3,3)."""
    return np.array(
        [covariance(s, q) for s, q in zip(gaussians.log_scales, gaussians.quaternions, strict=True)]
    )


def covariance_gradient(d_covariance: Array, log_scales: Array, quaternion: Array) -> tuple[Array, Array]:
    """Carry ∂L/∂Σ (3,3, symmetric) back to the log-scales (3,) and the quaternion as given (4,).

    With D = S Sᵀ: ∂L/∂s_k = 2 D_kk (Rᵀ G R)_kk, and dΣ = dR D Rᵀ + R D dRᵀ gives ∂L/∂R = 2 G R D.
    Normalising n = q/‖q‖ adds the factor (I − n nᵀ)/‖q‖.
    """
    G, R = d_covariance, rotation_matrix(quaternion)
    D = np.diag(np.exp(2 * log_scales))
    d_log_scales = 2 * np.diag(D) * np.diag(R.T @ G @ R)
    norm = np.linalg.norm(quaternion)
    unit = quaternion / norm
    d_unit = np.array([np.sum(2 * G @ R @ D * partial) for partial in rotation_partials(unit)])
    d_quaternion = (np.eye(4) - np.outer(unit, unit)) @ d_unit / norm
    return d_log_scales, d_quaternion
