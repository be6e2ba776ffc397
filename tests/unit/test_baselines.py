"""The triangulations that SkelSplat is measured against."""

from __future__ import annotations

import numpy as np
import pytest
from compare import opencv_dlt
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat.evaluation import baselines
from skelsplat.evaluation.baselines import _robust

Array = NDArray[np.float64]

ALL = {
    "dlt": baselines.dlt,
    "opencv_dlt": opencv_dlt,
    "ransac_iskakov": baselines.ransac_iskakov,
    "ransac_adafuse": baselines.ransac_adafuse,
    "cauchy": baselines.cauchy,
}
# Rounding of pixels near 1e3 and lengths near 5e3 mm leaves 1e-9 mm; the condition of a pair of rays and the
# lens's iteration take six digits.
EXACT_MM = 1e-3


@pytest.fixture
def rig() -> sk.CameraRig:
    return sk.synthetic.human36m_like()


@pytest.fixture
def truth() -> Array:
    return sk.synthetic.motion("reach", 3, seed=2)


def pixels(truth: Array, rig: sk.CameraRig) -> Array:
    return sk.project(truth, rig).swapaxes(0, 1).copy()


def noisy(truth: Array, rig: sk.CameraRig, sigma_px: float = 4.0) -> Array:
    exact = pixels(truth, rig)
    return exact + np.random.default_rng(1).normal(0, sigma_px, exact.shape)


def without(detections: Array, view: int) -> Array:
    rest = detections.copy()
    rest[:, view] = np.nan
    return rest


def always_draw(monkeypatch: pytest.MonkeyPatch, *views: int) -> None:
    """Make every drawn pair this one."""

    def pair(seen: NDArray[np.bool_], _: np.random.Generator) -> NDArray[np.bool_]:
        drawn = np.zeros_like(seen)
        drawn[:, views] = True
        return drawn

    monkeypatch.setattr(_robust, "sample_pairs", pair)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("unit", ["mm", "m"])
def test_exact_detections_give_the_truth_through_a_lens(name: str, unit: str, truth: Array) -> None:
    rig = sk.synthetic.human36m_like(distortion=True)
    if unit == "m":
        rig = sk.CameraRig(
            [sk.Camera(c.K, c.R, c.t / 1000, distortion=c.distortion, size=c.size) for c in rig], unit="m"
        )
        truth = truth / 1000
    found = ALL[name](pixels(truth, rig), rig)
    np.testing.assert_allclose(found, truth, atol=EXACT_MM / rig.mm_per_unit)


@pytest.mark.parametrize("name", ALL)
def test_missing_detections_take_no_part(name: str, rig: sk.CameraRig, truth: Array) -> None:
    detections = np.concatenate([noisy(truth, rig), np.ones((3, 4, 17, 1))], axis=-1)
    detections[0, 1:, 2] = np.nan  # one view left
    detections[1, :2, 3] = (1e4, 1e4, 0.0)  # two left: nothing to choose from
    found = ALL[name](detections, rig)
    assert np.isnan(found[0, 2]).all()
    assert np.isnan(found).any(axis=-1).sum() == 1
    detections[1, :2, 3] = np.nan
    np.testing.assert_array_equal(found, ALL[name](detections, rig))
    of_two = sk.triangulate(detections[1, :, 3:4, :2], rig, method="dlt")[0]
    # The two rays pass each other by some px · 5 m / 1147 px; what lies between them is a matter of weights.
    np.testing.assert_allclose(found[1, 3], of_two, atol=20.0)


@pytest.mark.parametrize("weighted", [False, True])
def test_dlt_is_the_one_of_the_core(weighted: bool, truth: Array) -> None:
    rig = sk.synthetic.human36m_like(distortion=True)
    noise = sk.synthetic.DetectionNoise.occluded(2)
    detections = sk.synthetic.simulate_detections(truth, rig, noise=noise, seed=3)
    found = baselines.dlt(detections, rig, confidence=weighted)
    given = detections if weighted else detections[..., :2]
    expected = sk.triangulate(given, rig, method="dlt")
    # Where a view misses a joint the core has the frame of the others, the baseline that of the whole rig.
    all_views = np.isfinite(detections).all(axis=(1, 3))
    assert np.count_nonzero(all_views) > 40
    np.testing.assert_allclose(found[all_views], expected[all_views], atol=1e-5)


@pytest.mark.parametrize(
    ("ransac", "limit_px", "keywords"),
    [
        (baselines.ransac_iskakov, 30.0, {}),
        (baselines.ransac_iskakov, 60.0, {"crop_scale": np.full((3, 4), 2.0)}),
        (baselines.ransac_adafuse, 20.0, {}),
    ],
)
def test_a_view_agrees_up_to_a_distance(
    ransac, limit_px: float, keywords, rig: sk.CameraRig, truth: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    always_draw(monkeypatch, 0, 1)
    monkeypatch.setattr(_robust, "minimise", lambda start, *_: start)
    for distance_px in (limit_px - 1.0, limit_px + 1.0):
        detections = pixels(truth, rig)
        detections[:, 3] += (0.6 * distance_px, 0.8 * distance_px)
        kept = detections if distance_px < limit_px else without(detections, 3)
        np.testing.assert_array_equal(ransac(detections, rig, **keywords), baselines.dlt(kept, rig))


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda d, c: baselines.dlt(d[:, :3], c), "detections"),
        (lambda d, c: baselines.dlt(np.concatenate([d, d[..., :1]], axis=-1), c), "detections"),
    ],
)
def test_wrong_arguments_are_named(call, argument: str, rig: sk.CameraRig, truth: Array) -> None:
    with pytest.raises(sk.InvalidInputError, match=f"^{argument}: "):
        call(pixels(truth, rig), rig)
