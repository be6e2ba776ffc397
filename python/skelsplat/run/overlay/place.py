"""Where the pixels of the calibrated image lie on a video's frames, and on what is drawn of them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._opencv import opencv
from skelsplat.exceptions import DatasetError
from skelsplat.io.video import Image, Size

_SAME_SHAPE = 0.005  # of the ratio of width to height
_PADDING_PX = 16  # codecs fill up to blocks of 16


def fit_size(path: Path, name: str, size: Size, expected: Size) -> Array:
    """Return the scale (2,) from the camera's image to a video's frames; warn if that is doubtful.

    Equal sizes fit. A difference of at most 16 px is what codecs fill up or cut off, at the right and lower
    border: what is drawn stays where it is. Images of the same shape are copies in another size.

    Raises
    ------
    DatasetError
        If the sizes have nothing to do with each other, or width and height are exchanged.
    """
    (width, height), (wide, high) = size, expected
    ones = np.ones(2)
    if size == expected:
        return ones
    if size == (high, wide):
        wanted = f"{wide}×{high} like the camera {name}"
        advice = "is the video turned (a phone's metadata), or the calibration that of turned images?"
        raise DatasetError(path, "size", wanted, f"{width}×{height}, width and height exchanged; {advice}")
    if abs(width - wide) <= _PADDING_PX and abs(height - high) <= _PADDING_PX:
        remark = f"{path}: {width}×{height}, but the camera {name} has {wide}×{high}: drawn without scaling"
        warnings.warn(remark, UserWarning, stacklevel=2)
        return ones
    scale = np.array([width / wide, height / high])
    if abs(scale[0] / scale[1] - 1) <= _SAME_SHAPE:
        return scale
    wanted = f"{wide}×{high} like the camera {name}, or a copy of it in another size"
    raise DatasetError(path, "size", wanted, f"{width}×{height}")


@dataclass(frozen=True)
class Place:
    """From a video's frame to what is drawn on.

    Parameters
    ----------
    fit : (2,)
        Scale from the calibrated image to the frame.
    size : (width, height)
        Of what is cut out of the frame.
    zoom
        Scale from that to the output.
    """

    fit: Array
    size: Size
    zoom: float = 1.0

    @property
    def output(self) -> Size:
        """Width and height of the output."""
        return max(1, round(self.size[0] * self.zoom)), max(1, round(self.size[1] * self.zoom))

    def cut(self, image: Image, corner: tuple[int, int]) -> Image:
        """Return the part of ``image`` with this upper left corner (x, y) in the size of the output."""
        (left, top), (width, height) = corner, self.size
        part = image[top : top + height, left : left + width]
        if self.output == self.size:
            return part.copy()
        method = opencv().INTER_AREA if self.zoom < 1 else opencv().INTER_LINEAR
        resized: Image = opencv().resize(part, self.output, interpolation=method)
        return resized

    def transform(self, corner: tuple[int, int]) -> tuple[Array, Array]:
        """Return scale and shift, (2,) each, from the calibrated image's pixels to those of the output.

        A resize by s maps u to (u + ½)·s − ½ (docs/conventions.md).
        """
        zoom = np.array(self.output) / np.array(self.size)
        scale: Array = self.fit * zoom
        return scale, scale / 2 - 0.5 - np.array(corner) * zoom
