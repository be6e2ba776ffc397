"""Words on images: the label in a corner, and the strip below the image that explains the marks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from skelsplat._arrays import Array
from skelsplat._escape import escaped
from skelsplat.viz import _style
from skelsplat.viz.overlay import _marks
from skelsplat.viz.overlay._draw import SIGMAS, Shown, draw_detection, draw_joint, draw_limb, draw_swapped
from skelsplat.viz.overlay._marks import DARK, LIGHT, Colour, Image, Sizes

Symbol = Callable[[Image, Array], None]
Entry = tuple[str, Symbol]

_OPAQUE = 0.6  # ground of a label
_BRIGHT = 380  # of 765: a colour that dark letters are read on


@lru_cache(maxsize=8)
def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)


@lru_cache(maxsize=64)
def text_mask(text: str, size: int) -> npt.NDArray[np.uint8]:
    """Return one line of text ``size`` px high as coverage 0 to 255, (H, W); H is the same for all texts."""
    font, text = _font(size), escaped(text)  # Pillow raises for control characters
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
    row_height = 2 * sizes.text
    rows = _rows(_entries(sizes, shown, people or _style.SIDES.items(), named=bool(people)), width, sizes)
    strip = np.full((row_height * len(rows), width, 3), _marks.LIGHT, dtype=np.uint8)
    for number, row in enumerate(rows):
        left, middle = sizes.text, (number + 0.5) * row_height
        for text, symbol in row:
            mask = text_mask(text, sizes.text)
            symbol(strip, np.array([left + sizes.text, middle]))
            top = round(middle - mask.shape[0] / 2)
            draw_text(strip, left + _symbol_width(sizes), top, mask, _marks.DARK)
            left += _entry_width(text, sizes)
    return strip


def _symbol_width(sizes: Sizes) -> int:
    return round(2.5 * sizes.text)


def _entry_width(text: str, sizes: Sizes) -> int:
    return _symbol_width(sizes) + int(text_mask(text, sizes.text).shape[1]) + sizes.text


def _rows(entries: Sequence[Entry], width: int, sizes: Sizes) -> list[list[Entry]]:
    """Break the entries into rows of at most ``width`` px; a single one may be longer."""
    rows: list[list[Entry]] = [[]]
    used = sizes.text
    for entry in entries:
        length = _entry_width(entry[0], sizes)
        if rows[-1] and used + length > width:
            rows.append([])
            used = sizes.text
        rows[-1].append(entry)
        used += length
    return [row for row in rows if row]


def _entries(sizes: Sizes, shown: Shown, groups: Iterable[tuple[str, str]], *, named: bool) -> list[Entry]:
    """Return the entries: ``groups`` are body sides, or ``named`` people, with their colours."""
    own = _style.MIDDLE if named else None
    middle, reach = _marks.bgr(_style.MIDDLE), np.array([sizes.text, 0.0])
    shape = np.diag([sizes.text / 2, sizes.text / 4]) ** 2 * (2 / SIGMAS) ** 2

    def limb(colour: Colour, *, solid: bool) -> Symbol:
        return lambda image, at: draw_limb(
            image, np.stack([at - reach, at + reach]), colour, sizes, solid=solid
        )

    def detection(weight: float, *, rejected: bool) -> Symbol:
        return lambda image, at: draw_detection(image, at, weight, sizes, rejected=rejected)

    def ellipse(image: Image, at: Array) -> None:
        _marks.ellipse(image, at, shape, middle, sigmas=SIGMAS, width=sizes.thin)

    of_whom = " in the person's colour" if named else ""
    entries: list[Entry] = []
    if shown.pose or named:
        entries += [(name, limb(_marks.bgr(colour), solid=True)) for name, colour in groups]
    if shown.pose:
        entries.append(
            ("weak, inferred or filled", lambda image, at: draw_joint(image, at, middle, sizes, solid=False))
        )
    if shown.ellipses:
        entries.append((f"error ellipse, {SIGMAS:g} σ", ellipse))
    if shown.before:
        entries.append(("start", limb(_marks.BEFORE, solid=False)))
    if shown.detections:
        entries += [
            (
                f"detection{of_whom}, weight {shown.rejected_below:g} to 1",
                _weights(shown.rejected_below, sizes, own),
            ),
            ("rejected", detection(0.0, rejected=True)),
            ("not used", detection(np.nan, rejected=False)),
            ("left and right exchanged", lambda image, at: draw_swapped(image, at, sizes)),
        ]
    return entries


def _weights(lowest: float, sizes: Sizes, own: str | None) -> Symbol:
    """Return a bar in the colours of the weights from ``lowest`` to 1, edged like the discs."""
    reach, high, edge = sizes.text, max(2, sizes.text // 4), max(1, round(sizes.edge))

    def draw(image: Image, at: Array) -> None:
        left, middle = round(float(at[0])) - reach, round(float(at[1]))
        colours = [_marks.weight_colour(weight, own) for weight in np.linspace(lowest, 1.0, 2 * reach)]
        framed = image[
            middle - high - edge : middle + high + edge, max(0, left - edge) : left + 2 * reach + edge
        ]
        framed[:] = _marks.DARK
        inner = image[middle - high : middle + high, left : left + 2 * reach]
        inner[:] = np.array(colours, dtype=np.uint8)[: inner.shape[1]]

    return draw
