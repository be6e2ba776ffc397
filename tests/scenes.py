"""Small scenes for the tests: rigs, skeletons, detections. Lengths in mm; nothing here needs the package."""

from dataclasses import dataclass

import numpy as np

from reference.arrays import Array, Gaussians, View
from reference.camera import pinhole, to_camera
from reference.gaussian import covariances
from reference.symmetry import Pairs
from reference.total import targets

H36M_PAIRS_BY_TIER: dict[int, Pairs] = {
    0: (),
    1: (((12, 13), (15, 16)), ((5, 6), (2, 3))),
    2: (((11, 12), (14, 15)), ((4, 5), (1, 2))),
    3: (((0, 4), (0, 1)), ((8, 11), (8, 14))),
}
"""What each symmetry tier adds (Human3.6M-17): lower limbs, upper limbs, hip–root and shoulder–neck."""

H36M_POSE = 1000.0 * np.array(
    [
        [0.00, 0.00, 0.00],
        [-0.13, 0.01, -0.02],
        [-0.15, 0.10, -0.44],
        [-0.16, -0.05, -0.86],
        [0.13, -0.01, 0.01],
        [0.16, 0.18, -0.38],
        [0.20, 0.07, -0.82],
        [0.00, 0.02, 0.24],
        [0.01, 0.03, 0.48],
        [0.02, 0.12, 0.57],
        [0.02, 0.06, 0.68],
        [0.16, 0.02, 0.42],
        [0.27, 0.10, 0.17],
        [0.20, 0.29, 0.05],
        [-0.14, 0.04, 0.43],
        [-0.25, 0.07, 0.15],
        [-0.22, 0.26, 0.30],
    ]
)
"""A standing person (17,3), z up, whose left and right limbs differ by some centimetres."""


def symmetric_pairs(tier: int) -> Pairs:
    """All pairs of Human3.6M-17 up to a tier."""
    return tuple(pair for level in range(tier + 1) for pair in H36M_PAIRS_BY_TIER[level])


def look_at(centre: Array, target: Array, focal: tuple[float, float], size: tuple[int, int]) -> View:
    """Make a camera at `centre` that looks at `target` with z up in the world; off-centre principal point."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[focal[0], 0, 0.5 * size[0] - 3.2], [0, focal[1], 0.5 * size[1] + 2.7], [0, 0, 1.0]])
    return View(K, R, -R @ centre, size)


def small_rig(
    size: tuple[int, int] = (120, 96), focal: float = 300.0, distance: float = 2000.0
) -> list[View]:
    """Four cameras around the origin at different heights, distances and focal lengths."""
    views = []
    for k, (azimuth, height) in enumerate([(0.2, 500.0), (1.9, -150.0), (3.4, 700.0), (4.9, 250.0)]):
        reach = distance * (1 + 0.07 * k)
        centre = np.array([reach * np.cos(azimuth), reach * np.sin(azimuth), height])
        f = focal * (1 + 0.05 * k)
        views.append(look_at(centre, np.array([15.0, -10.0, 5.0]), (f, 1.02 * f), size))
    return views


def pixels(points: Array, views: list[View]) -> Array:
    """Project points (N,3) into every view: (M,N,2) px, without distortion."""
    return np.array([pinhole(to_camera(points, view.R, view.t), view.K) for view in views])


@dataclass(frozen=True)
class Scene:
    """Gaussians as they are, Gaussians that shape the pseudo ground truth, detections (M,N,3), cameras."""

    gaussians: Gaussians
    initial: Gaussians
    detections: Array
    views: list[View]

    def targets(self, encoding: str) -> list[Array]:
        """Pseudo ground truth of every view."""
        return targets(self.initial, self.detections, self.views, encoding)

    @property
    def initial_covariances(self) -> Array:
        """Σ (N,3,3) of the initial Gaussians."""
        return covariances(self.initial)


def make_scene(means: Array, sigma: float, views: list[View], seed: int) -> Scene:
    """Make rotated anisotropic Gaussians, unnormalised quaternions, detections 2 px off, confidence 0.5–1."""
    rng = np.random.default_rng(seed)
    n = len(means)

    def gaussians(centres: Array) -> Gaussians:
        log_scales = np.log(sigma) + rng.uniform(-0.35, 0.35, (n, 3))
        return Gaussians(centres, log_scales, rng.normal(size=(n, 4)) * rng.uniform(0.5, 2.0, (n, 1)))

    current, initial = gaussians(means), gaussians(means + rng.normal(scale=8.0, size=means.shape))
    found = pixels(means + rng.normal(scale=8.0, size=means.shape), views)
    found += rng.normal(scale=1.0, size=found.shape)
    confidence = rng.uniform(0.5, 1.0, (len(views), n, 1))
    return Scene(current, initial, np.concatenate([found, confidence], axis=-1), views)


def three_joints(seed: int = 3) -> Scene:
    """Make two overlapping joints and one apart; one detection is NaN, another has confidence 0."""
    means = np.array([[-60.0, 40.0, 30.0], [-10.0, 70.0, 75.0], [110.0, -90.0, -110.0]])
    scene = make_scene(means, 27.0, small_rig(), seed)
    scene.detections[1, 2] = np.nan
    scene.detections[3, 0, 2] = 0.0
    return scene


def beyond_the_image(seed: int = 5) -> Scene:
    """Make wide Gaussians centred beyond the widened field of view of some cameras: J is clamped there."""
    means = np.array([[-180.0, 560.0, 40.0], [60.0, -120.0, 560.0]])
    return make_scene(means, 110.0, small_rig(), seed)


def person(seed: int = 7) -> Scene:
    """Make the Human3.6M-17 skeleton, small in the image."""
    return make_scene(H36M_POSE, 40.0, small_rig(focal=170.0, distance=3500.0), seed)


def worst_relative_error(found: Array, expected: Array) -> float:
    """Return the largest difference over the largest expected value of the group."""
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))
