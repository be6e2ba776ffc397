"""The single effects of which `skelsplat.synthetic.noise` is made, for one view.

Shapes: pixels (T, N, 2), confidence (T, N); missing = NaN pixels and confidence 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def jitter(shape: tuple[int, ...], correlation: float, rng: np.random.Generator) -> FloatArray:
    """Draw unit normal noise (T, …), so correlated from one frame to the next (stationary AR(1))."""
    noise = rng.standard_normal(shape)
    if correlation > 0:
        fresh = np.sqrt(1.0 - correlation**2)
        for frame in range(1, shape[0]):
            noise[frame] = correlation * noise[frame - 1] + fresh * noise[frame]
    return noise


def on_disc(shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Draw points (…, 2) uniformly in the unit disc."""
    radius = np.sqrt(rng.random(shape))
    return radius[..., None] * directions(shape, rng)


def directions(shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Draw unit vectors (…, 2) of uniform direction."""
    angle = rng.uniform(0.0, 2 * np.pi, size=shape)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def swap(
    pixels: FloatArray, confidence: FloatArray, pairs: Sequence[tuple[int, int]], frames: BoolArray
) -> None:
    """Exchange left and right of `pairs` in the frames (T,) marked, in place."""
    for left, right in pairs:
        for array in (pixels, confidence):
            array[frames, left], array[frames, right] = array[frames, right], array[frames, left]


def one_sided_chains(
    left_right: Sequence[tuple[int, int]], limbs: Sequence[tuple[int, int]]
) -> list[list[tuple[int, int]]]:
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


def body_box(pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower corner and size (T, 2) px of the box round the joints of each frame; zeros where none is seen."""
    seen = ~np.isnan(pixels)
    any_seen = seen.any(axis=1)
    low = np.where(any_seen, np.where(seen, pixels, np.inf).min(axis=1), 0.0)
    high = np.where(any_seen, np.where(seen, pixels, -np.inf).max(axis=1), 0.0)
    return low, high - low


def discs(
    pixels: FloatArray, n_discs: int, radius_range: tuple[float, float], hold: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Occluders over the body: centres (T, D, 2) px uniform in its box, radii (T, D) px.

    Radii are uniform in `radius_range` × the box's longer side. Place and size relative to the box stay for
    `hold` frames.
    """
    n_frames = len(pixels)
    n_blocks = -(-n_frames // hold)
    where = np.repeat(rng.random((n_blocks, n_discs, 2)), hold, axis=0)[:n_frames]
    share = np.repeat(rng.uniform(*radius_range, size=(n_blocks, n_discs)), hold, axis=0)[:n_frames]
    low, size = body_box(pixels)
    centres: FloatArray = low[:, None] + where * size[:, None]
    return centres, share * size.max(axis=-1, keepdims=True)


def covering_disc(
    pixels: FloatArray, centres: FloatArray, radii: FloatArray
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Which joints a disc hides (T, N), and the nearest disc's centre (T, N, 2) and radius (T, N)."""
    distance = np.linalg.norm(pixels[:, :, None] - centres[:, None], axis=-1)
    depth = np.where(np.isnan(distance), np.inf, distance / np.maximum(radii[:, None], 1e-12))
    nearest = depth.argmin(axis=-1)
    frame = np.arange(len(pixels))[:, None]
    hidden: BoolArray = depth.min(axis=-1) <= 1.0
    return hidden, centres[frame, nearest], radii[frame, nearest]
