"""The line of text in an image's corner: camera and frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.viz.overlay._colours import DARK, LIGHT
from skelsplat.viz.overlay._sizes import Sizes
from skelsplat.viz.overlay._text import draw_text, text_mask

if TYPE_CHECKING:
    import numpy.typing as npt

    Image = npt.NDArray[np.uint8]

_OPAQUE = 0.6


def draw_label(image: Image, text: str) -> None:
    """Write ``text`` into the upper left corner of ``image`` on a darkened ground, in place."""
    size = Sizes.of(image.shape[1], image.shape[0]).text
    mask, pad = text_mask(text, size), size // 3
    place = image[: mask.shape[0] + 2 * pad, : mask.shape[1] + 4 * pad]
    place[:] = np.rint((1 - _OPAQUE) * place + _OPAQUE * np.array(DARK)).astype(np.uint8)
    draw_text(image, 2 * pad, pad, mask, LIGHT)
