"""Words on images: the label in a corner, and the strip below the image that explains the marks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from skelsplat._arrays import Array
from skelsplat._escape import escaped
from skelsplat.viz import _style
from skelsplat.viz._body import SIGMAS
from skelsplat.viz.overlay import _marks
from skelsplat.viz.overlay._draw import Shown, draw_detection, draw_joint, draw_limb, draw_swapped
from skelsplat.viz.overlay._marks import DARK, LIGHT, Colour, Image, Sizes

Symbol = Callable[[Image, Array], None]
Entry = tuple[str, Symbol]

_OPAQUE = 0.6  # ground of a label
_BRIGHT = 380  # of 765: a colour that dark letters are read on


@lru_cache(maxsize=64)
def text_mask(text: str, size: int) -> npt.NDArray[np.uint8]:
    """Return one line of text ``size`` px high as coverage 0 to 255, (H, W); H is the same for all texts."""
    font = ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)
    text = escaped(text)  # Pillow raises for control characters
    ascent, descent = font.getmetrics()
    picture = Pillow.new("L", (max(1, round(font.getlength(text))), ascent + descent))
    ImageDraw.Draw(picture).text((0, 0), text, fill=255, font=font)
    return np.asarray(picture)


def draw_text(image: Image, left: int, top: int, mask: npt.NDArray[np.uint8], colour: Colour) -> None:
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


def draw_name(image: Image, pose: Array, name: str, colour: str) -> None:
    """Write a person's name above the highest of their joints (N, 2) in the image, on their colour."""
    height, width = image.shape[:2]
    inside = pose[((pose >= 0) & (pose < [width, height])).all(axis=1)]  # False for NaN
    if not len(inside):
        return
    sizes = Sizes.of(width, height)
    mask, pad = text_mask(name, sizes.text), max(2, sizes.text // 4)
    tall, wide = mask.shape[0] + pad, mask.shape[1] + 2 * pad
    across, down = inside[np.argmin(inside[:, 1])]
    left = int(np.clip(across - wide / 2, 0, max(0, width - wide)))
    top = int(max(0, down - 2 * sizes.mark - tall))
    image[top : top + tall, left : left + wide] = _marks.bgr(colour)
    light = sum(_marks.bgr(colour)) > _BRIGHT
    draw_text(image, left + pad, top + pad // 2, mask, DARK if light else LIGHT)


def legend_strip(
    width: int, size: tuple[int, int], shown: Shown, people: Sequence[tuple[str, str]] = ()
) -> Image:
    """Return a strip (H, ``width``, 3) with an entry for every layer that is shown, in rows as needed.

    Its marks are as large as those on images of this ``size`` (width, height). ``people`` are names and
    colours of several.
    """
    sizes = Sizes.of(*size)
    unit, before = sizes.text, round(2.5 * sizes.text)  # height of text; room for a mark before it
    placed, left, row = [], unit, 0
    for text, symbol in _entries(sizes, shown, people):
        mask = text_mask(text, unit)
        length = before + mask.shape[1] + unit
        if left > unit and left + length > width:
            left, row = unit, row + 1
        placed.append((symbol, mask, left, (2 * row + 1) * unit))
        left += length
    strip = np.full((2 * unit * (row + 1) if placed else 0, width, 3), LIGHT, dtype=np.uint8)
    for symbol, mask, left, middle in placed:
        symbol(strip, np.array([left + unit, middle], dtype=float))
        draw_text(strip, left + before, middle - mask.shape[0] // 2, mask, DARK)
    return strip


def _entries(sizes: Sizes, shown: Shown, people: Sequence[tuple[str, str]]) -> list[Entry]:
    """Return words and marks: of the sides of the body, or of several people, and of the layers."""
    own = _style.MIDDLE if people else None
    middle, reach = _marks.bgr(_style.MIDDLE), np.array([sizes.text, 0.0])
    shape = np.diag([sizes.text / 2, sizes.text / 4]) ** 2 * (2 / SIGMAS) ** 2

    def limb(colour: Colour, *, solid: bool) -> Symbol:
        return lambda image, at: draw_limb(
            image, np.stack([at - reach, at + reach]), colour, sizes, solid=solid
        )

    def disc(weight: float, *, rejected: bool = False) -> Symbol:
        return lambda image, at: draw_detection(image, at, weight, sizes, rejected=rejected, own=own)

    entries: list[Entry] = []
    if shown.pose or people:
        groups = people or _style.SIDES.items()
        entries += [(name, limb(_marks.bgr(colour), solid=True)) for name, colour in groups]
    if shown.pose:
        hollow = partial(draw_joint, colour=middle, sizes=sizes, solid=False)
        entries.append(("weak, inferred or filled", hollow))
    if shown.ellipses:
        ellipse = partial(_marks.ellipse, covariance=shape, colour=middle, sigmas=SIGMAS, width=sizes.thin)
        entries.append((f"error ellipse, {SIGMAS:g} σ", ellipse))
    if shown.before:
        entries.append(("start", limb(_marks.BEFORE, solid=False)))
    if shown.detections:
        entries += [
            ("detection" + (" in the person's colour" if people else ""), disc(1.0)),
            (f"of weight {shown.rejected_below:g}", disc(shown.rejected_below)),
            ("rejected", disc(0.0, rejected=True)),
            ("not used", disc(np.nan)),
            ("left and right exchanged", partial(draw_swapped, sizes=sizes)),
        ]
    return entries
