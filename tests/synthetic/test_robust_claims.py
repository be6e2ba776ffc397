"""What the default method promises, on simulated detections of synthetic motions.

The same is measured on motion capture by `benchmarks/accuracy.py`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.synthetic import DetectionNoise
from sweeps import swept

NOISES = {
    "good": DetectionNoise.good(),
    "noisy": DetectionNoise.noisy(),
    "two views occluded": DetectionNoise.occluded(2),
    "three views occluded": DetectionNoise.occluded(3),
}
LOUD = replace(NOISES["good"], sigma_px=2 * NOISES["good"].sigma_px)


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """(T, 17, 3) mm: every fifth frame of two takes of every motion."""
    takes = [synthetic.motion(m, 60, seed=s)[::5] for s in (1, 2) for m in synthetic.motion_names]
    return np.concatenate(takes)


@pytest.fixture(scope="module")
def rig() -> sk.CameraRig:
    return synthetic.human36m_like()


def simulated(poses: np.ndarray, rig: sk.CameraRig, noise: DetectionNoise, seed: int = 1) -> np.ndarray:
    return synthetic.simulate_detections(poses, rig, noise=noise, layout="h36m17", seed=seed)


def refined(detections: np.ndarray, rig: sk.CameraRig, start: np.ndarray | None = None, **arguments):
    return sk.refine(start, detections, rig, layout="h36m17", **arguments)


def error(pose: np.ndarray, truth: np.ndarray) -> float:
    return float(sk.metrics.mpjpe(pose, truth))


def assert_better(found: np.ndarray, other: np.ndarray, truth: np.ndarray, what: str) -> None:
    """Three standard errors of the mean paired difference over the poses: chance passes one in a thousand."""
    ours, theirs = (sk.metrics.mpjpe(pose, truth, reduce="per_pose") for pose in (found, other))
    gain = theirs - ours
    assert gain.mean() > 3.0 * gain.std(ddof=1) / np.sqrt(len(gain)), (
        f"{what}: {theirs.mean()} to {ours.mean()}"
    )


@pytest.mark.parametrize(
    "name", ["three views occluded", swept("noisy"), swept("good"), swept("two views occluded")]
)
def test_it_is_better_than_triangulation_and_the_paper(poses, rig, name):
    detections = simulated(poses, rig, NOISES[name])
    found = refined(detections, rig)
    # Two rays that disagree at a small angle are a long valley.
    assert np.mean(found.stop_reason == "converged") > 0.98
    plain = sk.triangulate(detections[..., :2], rig, method="dlt")
    others = {"DLT": plain, "DLT by confidence": sk.triangulate(detections, rig, method="dlt")}
    for other, pose in others.items():
        assert_better(found.pose, pose, poses, other)
    some = slice(None, None, 4)  # the published method takes longest of all
    paper = refined(detections[some], rig, plain[some], config=sk.RefineConfig.paper()).pose
    assert_better(found.pose[some], paper, poses[some], "paper")
    ransac = sk.triangulate(detections, rig, method="ransac")
    if name == "noisy":  # without many outliers RANSAC is nearly as good
        assert error(found.pose, poses) < error(ransac, poses)
    else:
        assert_better(found.pose, ransac, poses, "RANSAC")
    # Triangulation does without the limbs.
    assert error(sk.triangulate(detections, rig), poses) < error(ransac, poses)


def least(ratios: np.ndarray, errors: list[float]) -> float:
    """Ratio of the least error, by a parabola in its logarithm through the best and its neighbours."""
    k = int(np.clip(np.argmin(errors), 1, len(ratios) - 2))
    a, b, _ = np.polyfit(np.log(ratios[k - 1 : k + 2]), errors[k - 1 : k + 2], 2)
    return float(np.exp(-b / (2 * a)))


@pytest.mark.parametrize("noise", [NOISES["good"], LOUD], ids=["good", "loud"])
@pytest.mark.parametrize("level", [25.0, 60.0])
def test_init_sigma_is_the_standard_deviation_of_the_start(poses, rig, noise, level):
    """The value of least error in a sweep lies within a factor of 1.5 of the truth, whatever the noise."""
    detections = simulated(poses, rig, noise)
    start = synthetic.perturb(poses, level, seed=2)
    ratios = np.array([0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0])
    errors = [error(refined(detections, rig, start, init_sigma=r * level).pose, poses) for r in ratios]
    assert 0 < np.argmin(errors) < len(ratios) - 1
    assert 1 / 1.5 < least(ratios, errors) < 1.5
    assert min(errors) < error(refined(detections, rig, start).pose, poses)
    assert min(errors) < error(start, poses)


def wrong_view(poses: np.ndarray, camera: sk.Camera) -> dict[str, np.ndarray]:
    """Make detections (T, N, 3) of a camera that is of no use, as sure of itself as a good one."""
    rng = np.random.default_rng(5)
    true = sk.project(poses, [camera])[0]
    noisy = true + rng.normal(0.0, 2.3, true.shape)
    wrong = {
        "anywhere": rng.uniform(0.0, camera.size, size=true.shape),
        "100 px off": noisy + np.array([60.0, -80.0]),
        "another pose": np.roll(noisy, len(poses) // 4, axis=0),
    }
    confident = np.full((*true.shape[:-1], 1), 0.9)
    return {name: np.concatenate([pixels, confident], axis=-1) for name, pixels in wrong.items()}


def test_a_useless_fifth_view_changes_little(poses, rig):
    four = simulated(poses, rig, NOISES["good"])
    before = refined(four, rig).pose
    fifth = synthetic.dome(1, radius_mm=5300.0)[0]
    five = sk.CameraRig([*rig, fifth], unit="mm")
    for name, detections in wrong_view(poses, fifth).items():
        together = np.concatenate([four, detections[:, None]], axis=1)
        found = refined(together, five)
        moved = np.linalg.norm(found.pose - before, axis=-1)
        assert np.median(moved) < 1.0, name
        # Another pose of the same person passes many joints at a few centimetres.
        assert error(found.pose, poses) < error(before, poses) + 2.5, name
        # It is not believed, unless it hits by chance.
        assert np.nanmedian(found.view_weights[:, 4]) < sk.REJECTED_WEIGHT, name


IDEAL = np.array([19.9, 73.9, 97.1])
"""Share of a Gaussian in three dimensions within 1, 2 and 3 standard deviations, percent."""


@pytest.mark.parametrize(
    ("name", "n_views"),
    [("good", 3), ("good", 4), ("good", 8), ("two views occluded", 4), ("two views occluded", 8)],
)
def test_error_bars_cover_the_truth(poses, rig, name, n_views):
    """2448 joints of 144 poses: a share is known to 2 points, if a pose's joints are as good as six."""
    cameras = rig if n_views == 4 else synthetic.dome(n_views, radius_mm=5300.0)
    detections = simulated(poses, cameras, NOISES[name])
    found = refined(detections, cameras)
    share = 100 * sk.metrics.sigma_coverage(found.pose, found.uncertainty, poses)
    assert (np.abs(share - IDEAL) < 7.0).all(), share


def test_from_a_monocular_start_with_its_scale_occlusion_costs_little(poses, rig):
    """With three of four views occluded the pose is within 3 mm of what good detections give."""
    detections = simulated(poses, rig, NOISES["three views occluded"])
    start = synthetic.perturb(poses, 25.0, seed=6)
    alone, found = refined(detections, rig), refined(detections, rig, start, init_sigma=25.0)
    assert_better(found.pose, alone.pose, poses, "no prior")
    assert_better(found.pose, start, poses, "the start")
    good = refined(simulated(poses, rig, NOISES["good"]), rig, start, init_sigma=25.0)
    assert error(found.pose, poses) < error(good.pose, poses) + 3.0
