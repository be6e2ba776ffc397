"""Scenes with all the trouble that detectors make, seeded, for tests of the whole method. Lengths in mm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat import synthetic

Array = NDArray[np.float64]

TROUBLE = synthetic.DetectionNoise(
    sigma_px=3.0,
    outlier_rate=0.12,
    outlier_px=120.0,
    limb_swap_rate=0.15,
    view_swap_rate=0.05,
    miss_rate=0.1,
    occluded_views=1,
    hidden_missing_rate=0.3,
)
"""Jitter, outliers, exchanged sides, an occluder and joints that are missing."""


def room(n_views: int) -> sk.CameraRig:
    """Return the four cameras of `human36m_like`, or the first of them, and more on a dome as far away."""
    more = synthetic.dome(n_views - 4, radius_mm=5300.0) if n_views > 4 else ()
    return sk.CameraRig([*list(synthetic.human36m_like())[:n_views], *more])


def poses(n: int, seed: int) -> Array:
    """Return n frames (n, 17, 3) of all motions, the pelvis within half a metre of the room's centre."""
    each = -(-n // len(synthetic.motion_names))
    takes = [
        synthetic.motion(name, 4 * each, seed=seed + k)[::4] for k, name in enumerate(synthetic.motion_names)
    ]
    rng = np.random.default_rng(seed)
    drawn = np.concatenate(takes)[rng.permutation(len(takes) * each)[:n]]
    drawn[..., :2] -= drawn[:, :1, :2]
    drawn[..., :2] += rng.uniform(-500.0, 500.0, size=(n, 1, 2))
    return drawn


@dataclass(frozen=True)
class Scene:
    """Truth (T, N, 3), detections (T, M, N, 2|3) and cameras."""

    truth: Array
    detections: Array
    cameras: sk.CameraRig

    def refine(self, **options: object) -> sk.Refinement:
        """Refine all frames, with the layout of the poses unless another is given."""
        return sk.refine(None, self.detections, self.cameras, **{"layout": "h36m17", **options})

    def triangulate(self, method: str) -> Array:
        return sk.triangulate(self.detections, self.cameras, method=method)

    def of_views(self, views: list[int] | NDArray[np.intp]) -> Scene:
        """Return the same scene with these views, in this order."""
        cameras = sk.CameraRig([self.cameras[int(i)] for i in views], unit=self.cameras.unit)
        return replace(self, detections=self.detections[:, views], cameras=cameras)

    def with_view(self, camera: sk.Camera, seen: Array) -> Scene:
        """Return the scene with one more camera at the end, which sees `seen` (T, N, 2|3)."""
        cameras = sk.CameraRig([*self.cameras, camera], unit=self.cameras.unit)
        return replace(
            self, detections=np.concatenate([self.detections, seen[:, None]], axis=1), cameras=cameras
        )


def troubled(
    n_views: int, frames: int = 40, noise: synthetic.DetectionNoise = TROUBLE, seed: int = 0
) -> Scene:
    """Return `frames` poses in a room of `n_views` cameras, as a detector of that noise sees them."""
    truth, cameras = poses(frames, seed + n_views), room(n_views)
    return Scene(
        truth, synthetic.simulate_detections(truth, cameras, noise=noise, seed=seed + n_views), cameras
    )


def normal(truth: Array, cameras: sk.CameraRig, sigma_px: float, seed: int = 0) -> Scene:
    """Return projections with normal noise alone, without a confidence."""
    pixels = np.moveaxis(sk.project(truth, cameras), 0, 1)
    pixels = pixels + sigma_px * np.random.default_rng(seed).standard_normal(pixels.shape)
    return Scene(truth, pixels, cameras)


def lens(camera: sk.Camera, factor: float) -> sk.Camera:
    """Return a lens of `factor` times the focal length in the same housing."""
    K = camera.K * [[factor], [factor], [1.0]]
    K[:2, 2] = camera.K[:2, 2]
    return sk.Camera(K, camera.R, camera.t, size=camera.size)


def bars(result: sk.Refinement) -> Array:
    """Return the length of every error bar (…, N): the root of the trace of its covariance."""
    return np.sqrt(np.trace(result.uncertainty, axis1=-2, axis2=-1))
