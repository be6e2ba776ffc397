"""Hands the scenes' plain arrays to the package."""

from collections.abc import Sequence

import numpy as np

import skelsplat as sk
from reference.arrays import Array, Gaussians, View
from scenes import Scene


def camera(view: View) -> sk.Camera:
    """Make the package's camera of a distortion-free view."""
    return sk.Camera(view.K, view.R, view.t, size=view.size)


def rig(views: Sequence[View]) -> sk.CameraRig:
    """Make the package's rig, in mm."""
    return sk.CameraRig([camera(view) for view in views], unit="mm")


def loss_and_gradient(scene: Scene, **settings: object) -> sk.LossAndGradient:
    """Call the package on a scene; `settings` change the paper's."""
    layout = settings.pop("layout", None)
    return sk.loss_and_gradient(
        *scene.gaussians,
        scene.detections,
        rig(scene.views),
        layout=layout,
        config=sk.RefineConfig.paper(**settings),
        target_means=scene.initial.means,
        target_covariances=scene.initial_covariances,
    )


def gradient(result: sk.LossAndGradient) -> Gaussians:
    """Collect the package's gradients."""
    return Gaussians(
        np.asarray(result.d_means), np.asarray(result.d_log_scales), np.asarray(result.d_quaternions)
    )


def random_covariances(n: int, sigma: float, seed: int) -> Array:
    """Make covariances (n,3,3) with random axes of 0.5–2 `sigma`."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    variances = (sigma * rng.uniform(0.5, 2.0, (n, 3))) ** 2
    return np.asarray(np.einsum("nab,nb,ncb->nac", axes, variances, axes))
