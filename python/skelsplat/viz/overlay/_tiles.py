"""Several cameras' images in one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skelsplat.viz.overlay._marks import Image

Size = tuple[int, int]

_ASPECT = 16 / 9  # of a screen


@dataclass(frozen=True)
class Tiling:
    """Equal cells in rows, one per image, each image in the middle of its cell."""

    columns: int  # cells in a row
    cell: Size  # (width, height) of the largest images
    count: int  # number of images

    @property
    def size(self) -> Size:
        """Width and height of the whole."""
        return self.columns * self.cell[0], -(-self.count // self.columns) * self.cell[1]

    def join(self, images: Sequence[Image]) -> Image:
        """Return the images, none larger than a cell, in one."""
        width, height = self.cell
        whole = np.zeros((*self.size[::-1], 3), dtype=np.uint8)
        for place, image in enumerate(images):
            row, column = divmod(place, self.columns)
            top = row * height + (height - image.shape[0]) // 2
            left = column * width + (width - image.shape[1]) // 2
            whole[top : top + image.shape[0], left : left + image.shape[1]] = image
        return whole


def tiling(sizes: Sequence[Size]) -> Tiling:
    """Return the tiling that shows images of these sizes largest on a screen, with few cells empty."""
    cell = max(width for width, _ in sizes), max(height for _, height in sizes)
    every = [Tiling(columns, cell, len(sizes)) for columns in range(1, len(sizes) + 1)]
    return max(every, key=lambda one: (min(_ASPECT / one.size[0], 1 / one.size[1]), -math.prod(one.size)))


def blank_tile(size: Size) -> Image:
    """Return an empty image of a size (width, height)."""
    return np.full((size[1], size[0], 3), 40, dtype=np.uint8)
