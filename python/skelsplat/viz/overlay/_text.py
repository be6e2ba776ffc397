"""Text on images, in the typeface of the other figures, and the label in an image's corner."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from skelsplat.viz.overlay._look import DARK, LIGHT, Sizes

if TYPE_CHECKING:
    import numpy.typing as npt

    from skelsplat.viz.overlay._look import Colour

    Image = npt.NDArray[np.uint8]
    Mask = npt.NDArray[np.uint8]

_OPAQUE = 0.6  # ground of a label


@lru_cache(maxsize=8)
def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)


@lru_cache(maxsize=64)
def text_mask(text: str, size: int) -> Mask:
    """Return one line of text ``size`` px high as coverage 0 to 255, (H, W); H is the same for all texts."""
    font = _font(size)
    ascent, descent = font.getmetrics()
    picture = Pillow.new("L", (max(1, round(font.getlength(text))), ascent + descent))
    ImageDraw.Draw(picture).text((0, 0), text, fill=255, font=font)
    return np.asarray(picture)


def draw_text(image: Image, left: int, top: int, mask: Mask, colour: Colour) -> None:
    """Blend a mask into ``image`` in ``colour``, in place; what reaches over the border is cut off."""
    place = image[max(top, 0) : top + mask.shape[0], max(left, 0) : left + mask.shape[1]]
    cover = mask[: place.shape[0], : place.shape[1], None] / 255.0
    place[:] = np.rint(place * (1 - cover) + np.array(colour) * cover).astype(np.uint8)


def draw_label(image: Image, text: str) -> None:
    """Write ``text`` into the upper left corner of ``image`` on a darkened ground, in place."""
    size = Sizes.of(image.shape[1], image.shape[0]).text
    mask, pad = text_mask(text, size), size // 3
    place = image[: mask.shape[0] + 2 * pad, : mask.shape[1] + 4 * pad]
    place[:] = np.rint((1 - _OPAQUE) * place + _OPAQUE * np.array(DARK)).astype(np.uint8)
    draw_text(image, 2 * pad, pad, mask, LIGHT)
