"""Simulated occluders: discs over the body, the same for every detector that looks at the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skelsplat._arrays import Array, Mask, corners, generator
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic.memory import Numbers
from skelsplat.synthetic.noise import DetectionNoise


@dataclass(frozen=True, slots=True, eq=False)
class Occluders:
    """D discs in each of M views and T frames.

    Attributes
    ----------
    centres : (T, M, D, 2) px
    radii : (T, M, D) px
    views : (T, M) bool
        Views in which the discs are there.
    """

    centres: Array
    radii: Array
    views: Mask

    def hidden(self, pixels: Array) -> Mask:
        """Which joints (T, M, N) a disc hides, by their true projections (T, M, N, 2)."""
        views = [
            covering_disc(pixels[:, i], self.centres[:, i], self.radii[:, i])[0]
            for i in range(pixels.shape[1])
        ]
        return np.asarray(np.stack(views, axis=1) & self.views[..., None])


def draw_occluders(pixels: Array, noise: DetectionNoise, seed: int | np.random.Generator) -> Occluders:
    """Draw the discs that `noise` describes over bodies with true projections (T, M, N, 2)."""
    first, *streams = streams_of(seed, pixels.shape[1])
    views, stays = occluded_views(pixels.shape[0], pixels.shape[1], noise, first)
    discs = [draw_discs(pixels[:, i], noise, stays[:, i], stream) for i, stream in enumerate(streams)]
    centres, radii = (np.stack(part, axis=1) for part in zip(*discs, strict=True))
    return Occluders(centres, radii, views)


def streams_of(seed: int | np.random.Generator, n_views: int) -> list[np.random.Generator]:
    """Return random numbers for all views together, and for each."""
    seeds = generator(seed).integers(2**63, size=n_views + 1)
    return [np.random.default_rng(one) for one in seeds]


def occluded_views(
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


def draw_discs(
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


def covering_disc(pixels: Array, centres: Array, radii: Array) -> tuple[Mask, Array, Array]:
    """Which joints a disc hides (T, N), and the nearest disc's centre (T, N, 2) and radius (T, N)."""
    distance = np.linalg.norm(pixels[:, :, None] - centres[:, None], axis=-1)
    depth = np.where(np.isnan(distance), np.inf, distance / np.maximum(radii[:, None], 1e-12))
    nearest = depth.argmin(axis=-1)
    frame = np.arange(len(pixels))[:, None]
    hidden: Mask = depth.min(axis=-1) <= 1.0
    return hidden, centres[frame, nearest], radii[frame, nearest]
