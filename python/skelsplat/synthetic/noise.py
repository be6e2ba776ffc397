"""Simulated 2D detections: a model of what a keypoint detector does wrong, applied to projected joints.

Nothing here has seen an image. For every view on its own, a true projection (with the lens's distortion if
the camera has one) becomes a simulated detection in this order:

1. *Jitter*: normal, standard deviation `sigma_px` × a factor of the joint (wrists and ankles more than
   shoulders), optionally correlated in time.
2. *Outliers*: with probability `outlier_rate` a joint moves by an exponentially distributed length of mean
   `outlier_px` in a random direction: the heavy tail, tens of px.
3. *Left-right swaps*: of one limb's chain (`limb_swap_rate` per limb and frame) or of everything in the view
   (`view_swap_rate` per frame). The confidence does not know.
4. *Occluders*: in `occluded_views` views, drawn anew for every `occluder_frames` frames, discs lie over the
   body. A joint inside a disc is missing with probability `hidden_missing_rate`; else it is detected at a
   wrong place: uniformly in the disc, or, with probability `hidden_drawn_rate`, near another joint.
5. *Misses*: with probability `miss_rate` a joint is not detected. A joint outside the image never is.

Confidence is about 0.9 for a visible joint, 0.6 for an outlier, 0.4 for a hidden one, 0 for a missing one.

The presets are chosen so that unweighted DLT on the `human36m_like` rig errs about as much as on the
simulated detections of DESIGN §3. Mean error over 300 poses, mm (first), and DESIGN's (second),
from ``pytest tests/synthetic/test_noise.py -k design``, which fails beyond 20 %:

=====================  =====  =====
good                   @G   22.4
noisy                  @N   25.5
occluded(2)            @2   49.7
occluded(3)            @3   64.9
occluded(3, hard=True) @H    198
=====================  =====  =====
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import _effects

if TYPE_CHECKING:
    from skelsplat import Camera, CameraRig

FloatArray = NDArray[np.float64]

# Factor on the jitter by what a joint's name contains: small, fast and loosely dressed joints are harder.
_JOINT_FACTORS = (
    ("wri", 1.3),
    ("ank", 1.2),
    ("toe", 1.3),
    ("heel", 1.3),
    ("elb", 1.1),
    ("hip", 1.1),
    ("pelvis", 1.1),
    ("nose", 0.7),
    ("eye", 0.7),
    ("head", 0.8),
    ("neck", 0.8),
    ("thorax", 0.8),
)


class SkeletonLike(Protocol):
    """What the noise needs to know of a `skelsplat.Layout`."""

    @property
    def name(self) -> str:
        """Name for messages."""

    @property
    def joints(self) -> Sequence[str]:
        """Names of the N joints."""

    @property
    def limbs(self) -> Sequence[tuple[int, int]]:
        """Connected joints."""

    @property
    def left_right(self) -> Sequence[tuple[int, int]]:
        """Pairs of a left joint and its right counterpart."""


@dataclass(frozen=True, kw_only=True)
class DetectionNoise:
    """Parameters of the simulated detector; the module's docstring says what each effect does.

    Rates are probabilities, lengths px. The default has jitter only.

    Attributes
    ----------
    sigma_px : float
        Standard deviation per axis of the jitter of a joint with factor 1.
    correlation : float
        Correlation of the jitter from one frame to the next, 0 ≤ ρ < 1.
    outlier_rate, outlier_px : float
    limb_swap_rate, view_swap_rate : float
    miss_rate : float
    occluded_views : int or None
        Number of views with an occluder; None = all.
    n_discs : int
        Discs per occluded view.
    disc_radius : (float, float)
        Range of the radius as a share of the longer side of the box round the body.
    hidden_missing_rate, hidden_drawn_rate : float
    occluder_frames : int
        For how many frames an occluder stays.

    Raises
    ------
    InvalidInputError
        If a value is out of its range.
    """

    sigma_px: float = 4.0
    correlation: float = 0.0
    outlier_rate: float = 0.0
    outlier_px: float = 40.0
    limb_swap_rate: float = 0.0
    view_swap_rate: float = 0.0
    miss_rate: float = 0.0
    occluded_views: int | None = 0
    n_discs: int = 1
    disc_radius: tuple[float, float] = (0.1, 0.2)
    hidden_missing_rate: float = 0.0
    hidden_drawn_rate: float = 0.0
    occluder_frames: int = 1

    def __post_init__(self) -> None:
        for name in ("sigma_px", "outlier_px"):
            self._require(name, 0.0, np.inf)
        for name in (
            "correlation",
            "outlier_rate",
            "limb_swap_rate",
            "view_swap_rate",
            "miss_rate",
            "hidden_missing_rate",
            "hidden_drawn_rate",
        ):
            self._require(name, 0.0, 1.0)
        if self.correlation == 1.0:
            raise InvalidInputError("correlation: expected a number below 1, got 1.0")
        for name, least in (("occluded_views", 0), ("n_discs", 1), ("occluder_frames", 1)):
            value = getattr(self, name)
            if value is not None and value < least:
                raise InvalidInputError(f"{name}: expected an integer >= {least}, got {value!r}")
        low, high = self.disc_radius
        if not 0.0 <= low <= high < np.inf:
            raise InvalidInputError(f"disc_radius: expected 0 <= low <= high, got {self.disc_radius!r}")

    def _require(self, name: str, low: float, high: float) -> None:
        value = getattr(self, name)
        if not (np.isfinite(value) and low <= value <= high):
            raise InvalidInputError(f"{name}: expected a number from {low} to {high}, got {value!r}")

    @classmethod
    def good(cls) -> DetectionNoise:
        """Simulate a good detector: small jitter, few outliers."""
        return cls(sigma_px=2.3, outlier_rate=0.03, outlier_px=28.0)

    @classmethod
    def noisy(cls) -> DetectionNoise:
        """Simulate a detector with more jitter, some misses."""
        return cls(sigma_px=3.0, outlier_rate=0.025, outlier_px=25.0, miss_rate=0.01)

    @classmethod
    def occluded(cls, n_views: int | None, *, hard: bool = False) -> DetectionNoise:
        """Simulate the good detector with an occluder in each of `n_views` views (None = all).

        With `hard` it is two larger ones, and a hidden joint is never missing: always a gross error.
        """
        return replace(
            cls.good(),
            occluded_views=n_views,
            n_discs=2 if hard else 1,
            disc_radius=(0.16, 0.32) if hard else (0.1, 0.22),
            hidden_missing_rate=0.0 if hard else 0.1,
        )


def simulate_detections(
    points: ArrayLike,
    cameras: CameraRig | Sequence[Camera],
    *,
    noise: DetectionNoise,
    layout: str | SkeletonLike | None = "h36m17",
    seed: int | np.random.Generator = 0,
) -> FloatArray:
    """Simulate what a 2D keypoint detector reports for known 3D joints.

    Parameters
    ----------
    points : (T, N, 3) or (N, 3)
        True joints in the rig's unit.
    cameras : CameraRig or sequence of Camera
        M views.
    noise : DetectionNoise
    layout : name, Layout or None
        The joints' names and sides; None = all joints alike and nothing to swap.
    seed : int or numpy Generator
        Same seed, same detections. Views are independent of each other, and the same whatever cameras follow;
        only which views are occluded depends on M.

    Returns
    -------
    (T, M, N, 3) or (M, N, 3)
        Pixel u, v and confidence in [0, 1]; missing = NaN, NaN, 0.

    Raises
    ------
    InvalidInputError
        If shapes, layout and noise do not fit each other.
    """
    from skelsplat import layouts, project

    world = np.asarray(points, dtype=np.float64)
    if world.ndim not in (2, 3) or world.shape[-1] != 3:
        raise InvalidInputError(f"points: expected shape (T, N, 3) or (N, 3), got {world.shape}")
    frames = world if world.ndim == 3 else world[None]
    pixels = np.moveaxis(np.asarray(project(frames, cameras)), 0, 1)
    limits = np.array([camera.size for camera in cameras], dtype=np.float64)[:, None] - 0.5
    inside = np.all((pixels >= -0.5) & (pixels < limits), axis=-1)
    skeleton = layouts.get(layout) if isinstance(layout, str) else layout
    out = corrupt(np.where(inside[..., None], pixels, np.nan), noise=noise, layout=skeleton, seed=seed)
    return out if world.ndim == 3 else out[0]


def corrupt(
    pixels: ArrayLike,
    *,
    noise: DetectionNoise,
    layout: SkeletonLike | None = None,
    seed: int | np.random.Generator = 0,
) -> FloatArray:
    """Apply the noise model to true projections.

    Parameters
    ----------
    pixels : (T, M, N, 2) px
        True projections; NaN = not in the image.
    noise, layout, seed
        As in `simulate_detections`.

    Returns
    -------
    (T, M, N, 3) px, px, confidence.

    Raises
    ------
    InvalidInputError
        If the shape is another, the layout has another number of joints, or more views are to be occluded
        than there are.
    """
    true = np.asarray(pixels, dtype=np.float64)
    if true.ndim != 4 or true.shape[-1] != 2:
        raise InvalidInputError(f"pixels: expected shape (T, M, N, 2), got {true.shape}")
    n_frames, n_views, n_joints = true.shape[:3]
    if layout is not None and len(layout.joints) != n_joints:
        raise InvalidInputError(
            f"layout: expected one of {n_joints} joints, got {layout.name!r} with {len(layout.joints)}"
        )
    rng = np.random.default_rng(seed)
    streams = [np.random.default_rng(s) for s in rng.integers(2**63, size=n_views + 1)]
    occluded = _occluded_views(n_frames, n_views, noise, streams[0])
    views = [_one_view(true[:, i], occluded[:, i], noise, layout, streams[i + 1]) for i in range(n_views)]
    return np.stack(views, axis=1)


def _occluded_views(
    n_frames: int, n_views: int, noise: DetectionNoise, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which views have an occluder in which frame, (T, M)."""
    count = n_views if noise.occluded_views is None else noise.occluded_views
    if count > n_views:
        raise InvalidInputError(f"noise.occluded_views: expected at most {n_views} (views), got {count}")
    n_blocks = -(-n_frames // noise.occluder_frames)
    rank = rng.random((n_blocks, n_views)).argsort(axis=1).argsort(axis=1)
    chosen: NDArray[np.bool_] = np.repeat(rank < count, noise.occluder_frames, axis=0)[:n_frames]
    return chosen


def _one_view(
    true: FloatArray,
    occluded: NDArray[np.bool_],
    noise: DetectionNoise,
    layout: SkeletonLike | None,
    rng: np.random.Generator,
) -> FloatArray:
    """Turn the true projections (T, N, 2) of one view into detections (T, N, 3)."""
    shape = true.shape[:2]
    factors = np.ones(shape[1]) if layout is None else np.array([_joint_factor(j) for j in layout.joints])
    pixels = true + noise.sigma_px * factors[:, None] * _effects.jitter(true.shape, noise.correlation, rng)
    confidence = rng.beta(18.0, 2.0, size=shape)

    outlier = rng.random(shape) < noise.outlier_rate
    length = rng.exponential(noise.outlier_px, size=shape)
    pixels += np.where(outlier, length, 0.0)[..., None] * _effects.directions(shape, rng)
    confidence = np.where(outlier, rng.beta(6.0, 4.0, size=shape), confidence)

    if layout is not None:
        for chain in _effects.one_sided_chains(layout.left_right, layout.limbs):
            _effects.swap(pixels, confidence, chain, _happens(noise.limb_swap_rate, shape[0], rng))
        _effects.swap(pixels, confidence, layout.left_right, _happens(noise.view_swap_rate, shape[0], rng))
    hidden, guess = _hidden_guess(true, noise, rng)
    hidden &= occluded[:, None]
    pixels = np.where(hidden[..., None], guess, pixels)
    confidence = np.where(hidden, rng.beta(4.0, 6.0, size=shape), confidence)

    miss_rate = np.where(hidden, noise.hidden_missing_rate, noise.miss_rate)
    missing = (rng.random(shape) < miss_rate) | np.isnan(pixels).any(axis=-1)
    pixels[missing] = np.nan
    confidence[missing] = 0.0
    return np.concatenate([pixels, confidence[..., None]], axis=-1)


def _happens(rate: float, n_frames: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """In which frames (T,) an event of that probability happens."""
    return np.asarray(rng.random(n_frames) < rate)


def _joint_factor(joint: str) -> float:
    name = joint.lower()
    return next((factor for part, factor in _JOINT_FACTORS if part in name), 1.0)


def _hidden_guess(
    true: FloatArray, noise: DetectionNoise, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Joints (T, N) that an occluder hides, and the pixels (T, N, 2) where a detector would report them."""
    shape = true.shape[:2]
    centres, radii = _effects.discs(true, noise.n_discs, noise.disc_radius, noise.occluder_frames, rng)
    hidden, centre, radius = _effects.covering_disc(true, centres, radii)
    guess = centre + radius[..., None] * _effects.on_disc(shape, rng)
    other = true[np.arange(shape[0])[:, None], rng.integers(shape[1], size=shape)]
    near_other = other + noise.sigma_px * rng.standard_normal(true.shape)
    drawn = (rng.random(shape) < noise.hidden_drawn_rate) & ~np.isnan(other).any(axis=-1)
    return hidden, np.where(drawn[..., None], near_other, guess)
