"""Simulated errors: a model of what a keypoint detector does wrong, and errors of 3D poses.

Nothing here has seen an image. For every view on its own, true projections become detections in this order:

1. *Jitter*: normal, standard deviation `sigma_px` × a factor of the joint (wrists more than shoulders).
2. *Outliers*: with probability `outlier_rate` a joint moves by an exponentially distributed length of mean
   `outlier_px` in a random direction.
3. *Left-right swaps*: of one limb's chain (`limb_swap_rate` per limb and frame) or of everything in the view
   (`view_swap_rate` per frame). The confidence does not know.
4. *Occluders*: in `occluded_views` views discs lie over the body. A joint inside a disc is missing with
   probability `hidden_missing_rate`; else it is detected at a wrong place: uniformly in the disc, or, with
   probability `hidden_drawn_rate`, near another joint.
5. *Misses*: with probability `miss_rate` a joint is not detected. A joint outside the image never is.

Without `memory` every frame is drawn by itself. With it all of this lasts, and rates are shares of the time.
A comparison of methods that smooth needs it: white noise flatters them. Measured on real recordings at 25 and
60 Hz (residuals against a smoothed 3D), a third of the variance of a detector's errors is white, a quarter
has a memory of 0.2 to 0.5 s, and two fifths do not change within seconds. Durations are in seconds, so that
another frame rate samples the same process.
Confidence is about 0.9 for a visible joint, 0.6 for an outlier, 0.4 for a hidden one, 0 for a missing one.

The presets are chosen so that unweighted DLT on the `human36m_like` rig errs within 20 % of the simulated
detections of DESIGN §3 (mm, theirs second): good 21.7, 22.4; noisy 24.6, 25.5; occluded(2) 53.0, 49.7;
occluded(3) 66.1, 64.9; occluded(3, hard=True) 196.8, 198.0 (``pytest tests/synthetic -k design``). Those with
memory are chosen so that `skelsplat.refine`, frame by frame and without confidences, errs about as in the
recordings of DESIGN §7: recording 16.5, 16.5; recording_occluded(2) 26.1, 27.3; recording_occluded(3) 37.8,
36.8; recording_occluded(3, heavy=True) 113.1, 120.0 (``python benchmarks/sequences.py --methods frames``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import Array, generator, numbers, positive
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig, mm_per_unit
from skelsplat.exceptions import InvalidInputError

# Size of people in the images for which the presets are made: focal length, px, over distance, mm.
SIZE_IN_ROOM = 1147.0 / 5300.0


def stream(*key: int) -> np.random.Generator:
    """Random numbers that belong to `key`: the seed, the places in the set, what they are for."""
    return np.random.default_rng(key)


Numbers = NDArray[np.int64]
Range = tuple[float, float]


def check_range(settings: object, low: float, high: float, *names: str) -> None:
    """Raise `InvalidInputError` unless these settings are finite numbers from `low` to `high`."""
    for name in names:
        value = getattr(settings, name)
        if not (np.isfinite(value) and low <= value <= high):
            raise InvalidInputError(f"{name}: expected a number from {low} to {high}, got {value!r}")


@dataclass(frozen=True, kw_only=True)
class Memory:
    """How long errors last; ranges are uniform, in seconds. `frame_rate` is that of the poses."""

    frame_rate: float = 30.0

    slow_share: ClassVar = 0.25  # of the jitter's variance, which varies slowly
    constant_share: ClassVar = 0.4  # of the jitter's variance, which does not vary; the rest is white
    slow_s: ClassVar[Range] = (0.2, 0.5)  # time constant τ of a joint: its autocorrelation is exp(−t/τ)
    burst_s: ClassVar[Range] = (0.1, 0.5)  # an outlier or a miss
    swap_s: ClassVar[Range] = (0.2, 1.0)
    occluder_s: ClassVar[Range] = (0.5, 2.0)  # an occluder in a view
    guess_s: ClassVar[Range] = (0.2, 1.0)  # the wrong guess of a hidden joint at its place in the disc

    def __post_init__(self) -> None:
        positive("frame_rate", self.frame_rate)

    def jitter(self, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        """Draw noise of unit variance (T, N, 2): a white, a slow and a constant part."""
        white = 1.0 - self.slow_share - self.constant_share
        noise: Array = np.sqrt(white) * rng.standard_normal(shape)
        noise += np.sqrt(self.slow_share) * self.slow(shape, rng)
        noise += np.sqrt(self.constant_share) * rng.standard_normal(shape[1:])
        return noise

    def slow(self, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        """Draw a stationary Ornstein-Uhlenbeck process of unit variance (T, N, 2)."""
        seconds = rng.uniform(*self.slow_s, size=(shape[1], 1))
        keep = np.exp(-1.0 / (self.frame_rate * seconds))
        fresh = np.sqrt(1.0 - keep**2)
        noise = rng.standard_normal(shape)
        for frame in range(1, shape[0]):
            noise[frame] = keep * noise[frame - 1] + fresh * noise[frame]
        return noise

    def episodes(
        self, n_frames: int, n_series: int, rate: float, seconds: Range, rng: np.random.Generator
    ) -> Numbers:
        """Draw when something lasts, in `n_series` independent series (T, n_series).

        0 = not at that time, else the number of the episode, from 1. A share `rate` of the time is inside
        an episode, from the first frame to the last.
        """
        stays = np.zeros((n_frames, n_series), dtype=np.int64)
        number = 0
        for k in range(n_series if rate > 0 else 0):
            for begin, end in _intervals(n_frames / self.frame_rate, rate, seconds, rng):
                number += 1
                first, stop = np.ceil([begin * self.frame_rate, end * self.frame_rate]).astype(int)
                stays[first:stop, k] = number
        return stays

    def occluded(self, n_frames: int, n_views: int, count: int, rng: np.random.Generator) -> Numbers:
        """Draw in which views there is an occluder (T, M): 0 = none, else the number of its stay, from 1.

        At every time it is `count` views. An occluder that has stayed long enough moves to any view that has
        none, or to another place in its own; the occluders move independently of each other.
        """
        stays = np.zeros((n_frames, n_views), dtype=np.int64)
        where = rng.permutation(n_views)[:count]
        now, until = np.zeros(count), np.array([_rest_of_stay(self.occluder_s, rng) for _ in range(count)])
        number = 0
        while count and now.min() < n_frames / self.frame_rate:
            k = int(now.argmin())
            if now[k] > 0:
                others = np.delete(where, k)
                where[k] = rng.choice(np.setdiff1d(np.arange(n_views), others))
                until[k] = now[k] + rng.uniform(*self.occluder_s)
            number += 1
            first, stop = np.ceil([now[k] * self.frame_rate, until[k] * self.frame_rate]).astype(int)
            stays[first:stop, where[k]] = number
            now[k] = until[k]
        return stays


def _intervals(
    length: float, rate: float, seconds: Range, rng: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Yield begin and end, s, of episodes with exponential gaps; a recording may begin inside one."""
    gap = (seconds[0] + seconds[1]) / 2 * (1.0 - rate) / rate
    now = 0.0
    if rng.random() < rate:
        now = _rest_of_stay(seconds, rng)
        yield 0.0, now
    while (now := now + rng.exponential(gap)) < length:
        end = now + rng.uniform(*seconds)
        yield now, end
        now = end


def _rest_of_stay(seconds: Range, rng: np.random.Generator) -> float:
    """Draw what is left, s, of the episode in which a recording begins.

    A long episode is more likely to be met than a short one, in proportion to its duration.
    """
    low, high = seconds
    duration = np.sqrt(rng.uniform(low**2, high**2))
    return float(rng.uniform(0.0, duration))


@dataclass(frozen=True, kw_only=True)
class DetectionNoise:
    """Parameters of the simulated detector; the module's docstring says what each effect does.

    Rates are probabilities, lengths px. The default has jitter only. `occluded_views` None is all views;
    `disc_radius` is the range of the radius as a share of the longer side of the box round the body.
    """

    sigma_px: float = 4.0
    outlier_rate: float = 0.0
    outlier_px: float = 40.0
    limb_swap_rate: float = 0.0
    view_swap_rate: float = 0.0
    miss_rate: float = 0.0
    occluded_views: int | None = 0
    n_discs: int = 1
    disc_radius: Range = (0.1, 0.2)
    hidden_missing_rate: float = 0.0
    hidden_drawn_rate: float = 0.0
    memory: Memory | None = None

    def __post_init__(self) -> None:
        check_range(self, 0.0, np.inf, "sigma_px", "outlier_px")
        check_range(self, 0.0, 1.0, *(entry.name for entry in fields(self) if entry.name.endswith("_rate")))
        check_range(self, 1, np.inf, "n_discs")
        if self.occluded_views is not None:
            check_range(self, 0, np.inf, "occluded_views")
        low, high = self.disc_radius
        if not 0.0 <= low <= high < np.inf:
            raise InvalidInputError(f"disc_radius: expected 0 <= low <= high, got {self.disc_radius!r}")

    def scaled(self, factor: float) -> DetectionNoise:
        """Return the same detector for people who are `factor` times as large in the images."""
        return replace(self, sigma_px=factor * self.sigma_px, outlier_px=factor * self.outlier_px)

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
        return cls.good()._behind(n_views, (0.1, 0.22), heavy=hard)

    @classmethod
    def recording(cls, frame_rate: float = 30.0) -> DetectionNoise:
        """Simulate a detector on a recording of that many frames per second: its errors have a memory."""
        return cls(sigma_px=2.4, outlier_rate=0.03, outlier_px=28.0, memory=Memory(frame_rate=frame_rate))

    @classmethod
    def recording_occluded(
        cls, n_views: int | None, *, heavy: bool = False, frame_rate: float = 30.0
    ) -> DetectionNoise:
        """Simulate the detector of `recording` with occluders; `n_views` and `heavy` as in `occluded`."""
        return cls.recording(frame_rate)._behind(n_views, (0.13, 0.28), heavy=heavy)

    def _behind(self, n_views: int | None, radius: Range, *, heavy: bool) -> DetectionNoise:
        discs, radius, missing = (2, (0.16, 0.32), 0.0) if heavy else (1, radius, 0.1)
        return replace(
            self, occluded_views=n_views, n_discs=discs, disc_radius=radius, hidden_missing_rate=missing
        )


# Standard deviation along the view's ray over that across it: depth is what a single view knows least.
_DEPTH_RATIO = 2.5
# Share of the variance common to all joints of a pose: the body as a whole is placed wrongly.
_COMMON_SHARE = 0.5


def _checked(points: ArrayLike, sigma_mm: float, most_axes: float = np.inf) -> Array:
    array = numbers(points, "points")
    if not 2 <= array.ndim <= most_axes or array.shape[-1] != 3:
        raise InvalidInputError(f"points: expected shape (..., N, 3), got {array.shape}")
    if not (np.isfinite(sigma_mm) and sigma_mm >= 0):
        raise InvalidInputError(f"sigma_mm: expected a finite number >= 0, got {sigma_mm!r}")
    return array


def perturb(points: ArrayLike, sigma_mm: float, *, seed: int | np.random.Generator = 0) -> Array:
    """Add independent normal noise of `sigma_mm` per axis to every joint of points (…, N, 3) mm."""
    array = _checked(points, sigma_mm)
    return array + sigma_mm * generator(seed).standard_normal(array.shape)


def monocular_poses(
    points: ArrayLike,
    cameras: CameraRig | Sequence[Camera],
    sigma_mm: float,
    *,
    seed: int | np.random.Generator = 0,
) -> Array:
    """Simulate one monocular 3D pose per view, in world coordinates.

    Normal errors, independent between views and frames, 2.5 times as large along the ray from the camera to
    the joint as across it; half of the variance is common to all joints of a pose (the body is placed wrongly
    as a whole), half is each joint's own. The root mean square error per axis is `sigma_mm`.

    Takes true joints (T, N, 3) or (N, 3) and returns poses (T, M, N, 3) or (M, N, 3), in the rig's unit.
    """
    array = _checked(points, sigma_mm, most_axes=3)
    truth = array[:, None] if array.ndim == 3 else array[None, None]
    sigma = sigma_mm / mm_per_unit(cameras)
    centres = np.array([-np.asarray(c.R).T @ np.asarray(c.t) for c in cameras])
    ray = truth - centres[None, :, None]
    ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True)

    rng = generator(seed)
    common = rng.standard_normal((*ray.shape[:2], 1, 3))
    own = rng.standard_normal(ray.shape)
    error = np.sqrt(_COMMON_SHARE) * common + np.sqrt(1.0 - _COMMON_SHARE) * own
    along = (error * ray).sum(axis=-1, keepdims=True) * ray
    # Two axes across and one along: 2·a² + (2.5·a)² = 3·sigma².
    across = sigma * np.sqrt(3.0 / (2.0 + _DEPTH_RATIO**2))
    poses: Array = truth + across * (error + (_DEPTH_RATIO - 1.0) * along)
    return poses if array.ndim == 3 else poses[0]
