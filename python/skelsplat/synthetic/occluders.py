"""Simulated occluders: discs over the body, the same for every detector that looks at the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import numbers
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import _effects
from skelsplat.synthetic.noise import DetectionNoise

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


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

    centres: FloatArray
    radii: FloatArray
    views: BoolArray

    def hidden(self, pixels: FloatArray) -> BoolArray:
        """Which joints (T, M, N) a disc hides, by their true projections (T, M, N, 2)."""
        views = [
            _effects.covering_disc(pixels[:, i], self.centres[:, i], self.radii[:, i])[0]
            for i in range(pixels.shape[1])
        ]
        return np.asarray(np.stack(views, axis=1) & self.views[..., None])


def draw_occluders(
    pixels: ArrayLike, *, noise: DetectionNoise, seed: int | np.random.Generator = 0
) -> Occluders:
    """Draw the discs that `noise` describes over bodies with these projections.

    Parameters
    ----------
    pixels : (T, M, N, 2) px
        True projections; NaN = not in the image.
    noise : DetectionNoise
        Of which `occluded_views`, `n_discs`, `disc_radius` and `occluder_frames` are used.
    seed : int or numpy Generator

    Raises
    ------
    InvalidInputError
        If the shape is another or more views are to be occluded than there are.
    """
    true = numbers(pixels, "pixels")
    if true.ndim != 4 or true.shape[-1] != 2:
        raise InvalidInputError(f"pixels: expected shape (T, M, N, 2), got {true.shape}")
    rng = np.random.default_rng(seed)
    streams = [np.random.default_rng(s) for s in rng.integers(2**63, size=true.shape[1] + 1)]
    views = occluded_views(true.shape[0], true.shape[1], noise, streams[0])
    discs = [
        _effects.discs(true[:, i], noise.n_discs, noise.disc_radius, noise.occluder_frames, stream)
        for i, stream in enumerate(streams[1:])
    ]
    centres, radii = (np.stack(part, axis=1) for part in zip(*discs, strict=True))
    return Occluders(centres, radii, views)


def occluded_views(n_frames: int, n_views: int, noise: DetectionNoise, rng: np.random.Generator) -> BoolArray:
    """Which views have an occluder in which frame, (T, M)."""
    count = n_views if noise.occluded_views is None else noise.occluded_views
    if count > n_views:
        raise InvalidInputError(f"noise.occluded_views: expected at most {n_views} (views), got {count}")
    n_blocks = -(-n_frames // noise.occluder_frames)
    rank = rng.random((n_blocks, n_views)).argsort(axis=1).argsort(axis=1)
    chosen: BoolArray = np.repeat(rank < count, noise.occluder_frames, axis=0)[:n_frames]
    return chosen
