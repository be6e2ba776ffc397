"""The whole of `refine` with `RefineConfig.paper()` against the twin's loop.

The package draws in float32, the twin in float64. A pixel's relative error is at most 3e-5 (`tolerances`), in sums
over some hundred pixels, so a step's gradient agrees to about 1e-5. Adam divides gradients by their own running
size: the error of one step is 1e-5 of 3 mm, 3e-5 mm, and even if 125 of them all pointed the same way they would make
0.004 mm. Where the loss is flat or its gradient changes sign the quotient is more sensitive; a factor of ten for
this gives the tolerance of 0.05 mm. Any difference in the method shows more: one step more or less, a decay counted from
one or no bias correction move the pose by some tenths of a mm to some mm.
"""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import rig
from reference import paper_loop, raster
from reference.arrays import Array, View
from reference.gaussian import covariances

POSE_MM = 0.05
TRUTH = np.array([[-60.0, 40.0, 30.0], [-10.0, 70.0, 75.0], [110.0, -90.0, -110.0]])


def start_and_detections(
    truth: Array, views: list[View], *, start_mm: float = 14.0, noise_px: float = 0.8
) -> tuple[Array, Array]:
    """Make a start some mm off, and detections (M,N,2) some tenths of a pixel off."""
    rng = np.random.default_rng(21)
    detections = scenes.pixels(truth, views)
    start = truth + rng.normal(scale=start_mm, size=truth.shape)
    return start, detections + rng.normal(scale=noise_px, size=detections.shape)


def run_twin(
    start: Array, detections: Array, views: list[View], **settings: object
) -> paper_loop.PaperResult:
    config = paper_loop.PaperConfig(**settings)  # type: ignore[arg-type]
    return paper_loop.refine(
        paper_loop.initial_gaussians(start, config.sigma), detections, views, config=config
    )


def assert_same_course(found: sk.Refinement, expected: paper_loop.PaperResult, start: Array) -> None:
    assert str(found.stop_reason) == expected.stop_reason
    assert int(found.n_iter) == len(expected.losses)
    pose = expected.gaussians.means
    assert np.linalg.norm(found.pose - pose, axis=-1).max() < POSE_MM
    assert np.linalg.norm(pose - start, axis=-1).max() > 100 * POSE_MM


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
def test_every_encoding_ends_at_the_same_pose(encoding: str) -> None:
    views = scenes.small_rig()
    start, detections = start_and_detections(TRUTH, views)
    found = sk.refine(start, detections, rig(views), config=sk.RefineConfig.paper(encoding=encoding))
    assert_same_course(found, run_twin(start, detections, views, encoding=encoding), start)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_fewer_views_per_step_end_at_the_same_pose(count: int) -> None:
    views = scenes.small_rig()
    start, detections = start_and_detections(TRUTH, views)
    config = sk.RefineConfig.paper(views_per_step=count)
    found = sk.refine(start, detections, rig(views), config=config)
    assert_same_course(found, run_twin(start, detections, views, views_per_step=count), start)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_early_stopping_stops_at_the_same_step(tolerance: float) -> None:
    views = scenes.small_rig()
    start, detections = start_and_detections(TRUTH, views)
    expected = run_twin(start, detections, views, stop_tolerance=tolerance)
    # The decision must not hang on float32: no window's difference lies within 2 % of the tolerance.
    assert min(abs(d - tolerance) for d in expected.window_differences) > 0.02 * tolerance
    assert expected.stop_reason == "converged"
    found = sk.refine(start, detections, rig(views), config=sk.RefineConfig.paper(stop_tolerance=tolerance))
    assert_same_course(found, expected, start)


def test_missing_detections_end_at_the_same_pose() -> None:
    views = scenes.small_rig()
    start, detections = start_and_detections(TRUTH, views)
    detections[0, 1] = np.nan
    detections[2, 2] = np.nan
    found = sk.refine(start, detections, rig(views), config=sk.RefineConfig.paper())
    assert_same_course(found, run_twin(start, detections, views), start)


@pytest.mark.parametrize("steps", [1, 2, 25])
def test_person_with_symmetry_ends_at_the_same_pose(steps: int) -> None:
    views = scenes.small_rig(focal=170.0, distance=3500.0)
    start, detections = start_and_detections(scenes.H36M_POSE, views, start_mm=25.0, noise_px=0.3)
    config = paper_loop.PaperConfig(max_steps=steps, symmetry_weight=1e-4)
    expected = paper_loop.refine(
        paper_loop.initial_gaussians(start, config.sigma),
        detections,
        views,
        scenes.symmetric_pairs(1),
        config=config,
    )
    found = sk.refine(
        start,
        detections,
        rig(views),
        layout="h36m17",
        config=sk.RefineConfig.paper(max_steps=steps, symmetry_weight=1e-4),
    )
    assert int(found.n_iter) == steps
    assert np.linalg.norm(found.pose - expected.gaussians.means, axis=-1).max() < POSE_MM
    assert np.linalg.norm(found.pose - start, axis=-1).max() > 2.0


def test_first_step_moves_every_coordinate_by_the_learning_rate() -> None:
    # Bias-corrected Adam's first step is −α·sign(g) exactly, with the undecayed rate of 3 mm.
    views = scenes.small_rig()
    start, detections = start_and_detections(TRUTH, views)
    found = sk.refine(start, detections, rig(views), config=sk.RefineConfig.paper(max_steps=1))
    assert np.abs(found.pose - start) == pytest.approx(np.full((3, 3), 3.0), abs=1e-6)
    # Log-scales move by 0.005 each: the variances are σ²·exp(±0.01). Rotating a sphere does nothing.
    variances = np.linalg.eigvalsh(found.covariance) / np.exp(6.0)
    assert np.abs(np.log(variances)) == pytest.approx(np.full((3, 3), 0.01), abs=1e-6)


def test_covariances_end_at_the_same_shape() -> None:
    views = scenes.small_rig()
    start, detections = start_and_detections(TRUTH, views)
    found = sk.refine(start, detections, rig(views), config=sk.RefineConfig.paper())
    expected = covariances(run_twin(start, detections, views).gaussians)
    # Log-scales take steps of 0.005: by the argument above 125·0.005·1e-5, and with the factor of ten below 1e-3.
    assert scenes.worst_relative_error(found.covariance, expected) < 1e-3
    spread = np.linalg.eigvalsh(expected)
    assert (spread[:, 2] / spread[:, 0]).max() > 1.1
