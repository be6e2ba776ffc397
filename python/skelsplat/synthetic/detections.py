"""Simulated 2D detections of known 3D joints; `skelsplat.synthetic.noise` says by what model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import layouts
from skelsplat._arrays import Array, Mask, corners, generator, numbers
from skelsplat._skelsplat import Camera, Layout, project
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic.noise import DetectionNoise, Numbers

Pairs = Sequence[tuple[int, int]]

# Factor on the jitter by what a joint's name contains: small, fast and loosely dressed joints are harder.
_JOINT_FACTORS = {
    1.3: ("wri", "toe", "heel"),
    1.2: ("ank",),
    1.1: ("elb", "hip", "pelvis"),
    0.7: ("nose", "eye"),
    0.8: ("head", "neck", "thorax"),
}

# Standard deviation of the drift of a wrong guess with memory, as a share of the disc's radius.
_GUESS_DRIFT = 0.1


def simulate_detections(
    points: ArrayLike,
    cameras: CameraRig | Sequence[Camera],
    *,
    noise: DetectionNoise,
    layout: str | Layout | None = "h36m17",
    seed: int | np.random.Generator = 0,
) -> Array:
    """Simulate what a 2D keypoint detector reports for known 3D joints.

    Takes true joints (T, N, 3) or (N, 3) in the rig's unit, and returns (T, M, N, 3) or (M, N, 3): pixel u, v
    and confidence in [0, 1]; missing = NaN, NaN, 0. `layout` has the joints' names and sides; None = all
    joints alike and nothing to swap. Views are independent of each other, and the same whatever cameras
    follow; only which views are occluded depends on M.
    """
    world = numbers(points, "points")
    if world.ndim not in (2, 3) or world.shape[-1] != 3:
        raise InvalidInputError(f"points: expected shape (T, N, 3) or (N, 3), got {world.shape}")
    frames = world if world.ndim == 3 else world[None]
    skeleton = layouts.get(layout) if isinstance(layout, str) else layout
    if skeleton is not None and skeleton.n_joints != world.shape[-2]:
        given = f"{skeleton.name!r} with {skeleton.n_joints}"
        raise InvalidInputError(f"layout: expected one of {world.shape[-2]} joints, got {given}")
    out = corrupt(true_pixels(frames, cameras), noise, skeleton, seed)
    return out if world.ndim == 3 else out[0]


def true_pixels(points: Array, cameras: CameraRig | Sequence[Camera]) -> Array:
    """Projections (T, M, N, 2) of joints (T, N, 3); NaN outside the image."""
    pixels = np.moveaxis(np.asarray(project(points, cameras)), 0, 1)
    limits = np.array([camera.size for camera in cameras], dtype=np.float64)[:, None] - 0.5
    inside = np.all((pixels >= -0.5) & (pixels < limits), axis=-1)
    return np.where(inside[..., None], pixels, np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Occluders:
    """Discs over the body, the same for every detector that looks at the images: D per view and frame."""

    centres: Array  # (T, M, D, 2) px
    radii: Array  # (T, M, D) px
    views: Mask  # (T, M): in which the discs are there

    def hidden(self, pixels: Array) -> Mask:
        """Which joints (T, M, N) a disc hides, by their true projections (T, M, N, 2)."""
        each = [np.moveaxis(one, 1, 0) for one in (pixels, self.centres, self.radii)]
        views = [_covering_disc(*one)[0] for one in zip(*each, strict=True)]
        return np.asarray(np.stack(views, axis=1) & self.views[..., None])


def draw_occluders(pixels: Array, noise: DetectionNoise, seed: int | np.random.Generator) -> Occluders:
    """Draw the discs that `noise` describes over bodies with true projections (T, M, N, 2)."""
    first, *streams = _streams_of(seed, pixels.shape[1])
    views, stays = _occluded_views(pixels.shape[0], pixels.shape[1], noise, first)
    discs = [_draw_discs(pixels[:, i], noise, stays[:, i], stream) for i, stream in enumerate(streams)]
    centres, radii = (np.stack(part, axis=1) for part in zip(*discs, strict=True))
    return Occluders(centres, radii, views)


def _streams_of(seed: int | np.random.Generator, n_views: int) -> list[np.random.Generator]:
    """Return random numbers for all views together, and for each."""
    return [np.random.default_rng(one) for one in generator(seed).integers(2**63, size=n_views + 1)]


def _occluded_views(
    n_frames: int, n_views: int, noise: DetectionNoise, rng: np.random.Generator
) -> tuple[Mask, Numbers]:
    """Which views have an occluder in which frame, (T, M), and the number of its stay there, from 0."""
    count = n_views if noise.occluded_views is None else noise.occluded_views
    if count > n_views:
        raise InvalidInputError(f"noise.occluded_views: expected at most {n_views} (views), got {count}")
    if noise.memory is not None:
        numbers = noise.memory.occluded(n_frames, n_views, count, rng)
        stays = [np.unique(one, return_inverse=True)[1] for one in numbers.T]
        return numbers > 0, np.stack(stays, axis=1)
    rank = rng.random((n_frames, n_views)).argsort(axis=1).argsort(axis=1)
    return rank < count, np.repeat(np.arange(n_frames)[:, None], n_views, axis=1)


def _draw_discs(
    pixels: Array, noise: DetectionNoise, stays: Numbers, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Occluders over the body in one view: centres (T, D, 2) px uniform in its box, radii (T, D) px.

    Place and size relative to the box stay the same in all frames with the same number in `stays` (T,).
    """
    n_stays = int(stays.max(initial=-1)) + 1
    where = rng.random((n_stays, noise.n_discs, 2))[stays]
    share = rng.uniform(*noise.disc_radius, size=(n_stays, noise.n_discs))[stays]
    low, high = corners(pixels)
    low, high = (np.where(low <= high, end, 0.0) for end in (low, high))  # where no joint is seen
    size = high - low
    centres: Array = low[:, None] + where * size[:, None]
    return centres, share * size.max(axis=-1, keepdims=True)


def _covering_disc(pixels: Array, centres: Array, radii: Array) -> tuple[Mask, Array, Array]:
    """Which joints a disc hides (T, N), and the nearest disc's centre (T, N, 2) and radius (T, N)."""
    distance = np.linalg.norm(pixels[:, :, None] - centres[:, None], axis=-1)
    depth = np.where(np.isnan(distance), np.inf, distance / np.maximum(radii[:, None], 1e-12))
    nearest = depth.argmin(axis=-1)
    frame = np.arange(len(pixels))[:, None]
    hidden: Mask = depth.min(axis=-1) <= 1.0
    return hidden, centres[frame, nearest], radii[frame, nearest]


def corrupt(
    pixels: Array,
    noise: DetectionNoise,
    layout: Layout | None = None,
    seed: int | np.random.Generator = 0,
    occluders: Occluders | None = None,
) -> Array:
    """Turn true projections (T, M, N, 2) px, NaN = not in the image, into detections (T, M, N, 3).

    Without `occluders` their own are drawn.
    """
    n_frames, n_views = pixels.shape[:2]
    first, *streams = _streams_of(seed, n_views)
    if occluders is None:
        occluded, stays = _occluded_views(n_frames, n_views, noise, first)
    else:
        occluded = occluders.views
    views = []
    for i, stream in enumerate(streams):
        discs = stays[:, i] if occluders is None else (occluders.centres[:, i], occluders.radii[:, i])
        views.append(_one_view(pixels[:, i], occluded[:, i], noise, layout, stream, discs))
    return np.stack(views, axis=1)


def _one_view(
    true: Array,
    occluded: Mask,
    noise: DetectionNoise,
    layout: Layout | None,
    rng: np.random.Generator,
    discs: tuple[Array, Array] | Numbers,
) -> Array:
    """Turn the true projections (T, N, 2) of one view into detections (T, N, 3).

    `discs` are the occluders' centres and radii, or the numbers (T,) of the stays for which to draw them.
    """
    shape = true.shape[:2]
    factors = np.ones(shape[1]) if layout is None else np.array([_joint_factor(j) for j in layout.joints])
    unit = rng.standard_normal(true.shape) if noise.memory is None else noise.memory.jitter(true.shape, rng)
    pixels = true + noise.sigma_px * factors[:, None] * unit
    confidence = rng.beta(18.0, 2.0, size=shape)

    outlier, offset = _outliers(shape, noise, rng)
    pixels += offset
    confidence = np.where(outlier, rng.beta(6.0, 4.0, size=shape), confidence)

    if layout is not None:
        for chain in _one_sided_chains(layout.left_right, layout.limbs):
            _swap(pixels, confidence, chain, _swapped(noise.limb_swap_rate, shape[0], noise, rng))
        every = _swapped(noise.view_swap_rate, shape[0], noise, rng)
        _swap(pixels, confidence, layout.left_right, every)
    if not isinstance(discs, tuple):
        discs = _draw_discs(true, noise, discs, rng)
    hidden, guess = _hidden_guess(true, noise, rng, discs)
    hidden &= occluded[:, None]
    pixels = np.where(hidden[..., None], guess, pixels)
    confidence = np.where(hidden, rng.beta(4.0, 6.0, size=shape), confidence)

    missing = _missing(hidden, noise, rng) | np.isnan(pixels).any(axis=-1)
    pixels[missing] = np.nan
    confidence[missing] = 0.0
    return np.concatenate([pixels, confidence[..., None]], axis=-1)


def _joint_factor(joint: str) -> float:
    name = joint.lower()
    return next((factor for factor, parts in _JOINT_FACTORS.items() if any(p in name for p in parts)), 1.0)


def _outliers(shape: tuple[int, int], noise: DetectionNoise, rng: np.random.Generator) -> tuple[Mask, Array]:
    """Draw which joints (T, N) are outliers, and by how much (T, N, 2) px they are off."""
    memory = noise.memory
    if memory is None:
        outlier = rng.random(shape) < noise.outlier_rate
        length = rng.exponential(noise.outlier_px, size=shape)
        return outlier, np.where(outlier, length, 0.0)[..., None] * _directions(shape, rng)
    burst = memory.episodes(*shape, noise.outlier_rate, memory.burst_s, rng)
    count = burst.max(initial=0) + 1
    offset = rng.exponential(noise.outlier_px, size=(count, 1)) * _directions((count,), rng)
    offset[0] = 0.0  # outside the bursts
    return burst > 0, offset[burst]


def _directions(shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Draw unit vectors (…, 2) of uniform direction."""
    angle = rng.uniform(0.0, 2 * np.pi, size=shape)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _swap(pixels: Array, confidence: Array, pairs: Pairs, frames: Mask) -> None:
    """Exchange left and right of `pairs` in the frames (T,) marked, in place."""
    for left, right in pairs:
        for array in (pixels, confidence):
            array[frames, left], array[frames, right] = array[frames, right], array[frames, left]


def _one_sided_chains(left_right: Pairs, limbs: Pairs) -> list[list[tuple[int, int]]]:
    """Left-right pairs grouped into chains: pairs whose left joints the skeleton connects, such as an arm."""
    group = {left: k for k, (left, _) in enumerate(left_right)}
    for a, b in limbs:
        if a in group and b in group:
            kept, gone = group[a], group[b]
            group = {joint: kept if k == gone else k for joint, k in group.items()}
    chains: dict[int, list[tuple[int, int]]] = {}
    for left, right in left_right:
        chains.setdefault(group[left], []).append((left, right))
    return list(chains.values())


def _swapped(rate: float, n_frames: int, noise: DetectionNoise, rng: np.random.Generator) -> Mask:
    """Draw in which frames (T,) a swap of that rate happens."""
    if noise.memory is None:
        return np.asarray(rng.random(n_frames) < rate)
    return np.asarray(noise.memory.episodes(n_frames, 1, rate, noise.memory.swap_s, rng)[:, 0] > 0)


def _missing(hidden: Mask, noise: DetectionNoise, rng: np.random.Generator) -> Mask:
    """Draw which joints (T, N) are not detected, of which some are hidden."""
    memory = noise.memory
    if memory is None:
        rate = np.where(hidden, noise.hidden_missing_rate, noise.miss_rate)
        return np.asarray(rng.random(hidden.shape) < rate)
    n_frames, n_joints = hidden.shape
    seen = memory.episodes(n_frames, n_joints, noise.miss_rate, memory.burst_s, rng)
    behind = memory.episodes(n_frames, n_joints, noise.hidden_missing_rate, memory.guess_s, rng)
    return np.asarray(np.where(hidden, behind, seen) > 0)


def _hidden_guess(
    true: Array, noise: DetectionNoise, rng: np.random.Generator, discs: tuple[Array, Array]
) -> tuple[Mask, Array]:
    """Joints (T, N) that an occluder hides, and the pixels (T, N, 2) where a detector would report them.

    That is somewhere in the disc or near another joint, for every joint anew or, with memory, for a while.
    """
    memory, shape = noise.memory, (true.shape[0], true.shape[1])
    hidden, centre, radius = _covering_disc(true, *discs)
    held: Numbers = np.arange(shape[0] * shape[1]).reshape(shape)
    drawn_from: tuple[int, ...] = shape
    if memory is not None:
        held = memory.episodes(*shape, 1.0, memory.guess_s, rng)
        drawn_from = (int(held.max(initial=0)) + 1,)
    share = np.sqrt(rng.random(drawn_from))  # of the radius, for places uniform in the disc
    place = (share[..., None] * _directions(drawn_from, rng)).reshape(-1, 2)[held]
    joint = rng.integers(shape[1], size=drawn_from).ravel()[held]
    offset = rng.standard_normal((*drawn_from, 2)).reshape(-1, 2)[held]
    near_joint = (rng.random(drawn_from) < noise.hidden_drawn_rate).ravel()[held]
    if memory is not None:
        place = place + _GUESS_DRIFT * memory.slow(true.shape, rng)
    other = true[np.arange(shape[0])[:, None], joint]
    near_joint &= ~np.isnan(other).any(axis=-1)
    in_disc = centre + radius[..., None] * place
    guess = np.where(near_joint[..., None], other + noise.sigma_px * offset, in_disc)
    if memory is not None:
        guess += noise.sigma_px * rng.standard_normal(true.shape)
    return hidden, guess
