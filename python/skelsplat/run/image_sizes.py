"""Whether detections and videos are of images of the calibration's size, as far as files state it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._words import listed
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io.detections import Opened

Size = tuple[int, int]

_SAME_SHAPE = 0.005  # of the ratio of width to height
_PADDING_PX = 16  # codecs fill up to blocks of 16
_SAME_IMAGES = "run the detector on images like those of the calibration, or calibrate with images like these"


def resizing(old: Size, new: Size) -> Array | None:
    """Return the factors (2,) from images of a size to those of another; None if neither is a copy.

    Up to 16 px of the larger image are what codecs fill up or cut off, at the right and lower border: then
    the factor is the ratio of the other side, the simpler fraction (540×960 and 1088×1920: 2).
    """
    if new == old[::-1] != old:
        return None
    if all(abs(a - b) <= _PADDING_PX for a, b in zip(old, new, strict=True)):
        return np.ones(2)
    factors: Array = np.array(new) / np.array(old)
    if abs(factors[0] / factors[1] - 1) <= _SAME_SHAPE:
        return factors
    ratio = min(map(Fraction, new, old), key=lambda one: one.numerator * one.denominator)
    padding = np.abs(np.array(new) - np.array(old) * float(ratio)) / min(float(ratio), 1.0)
    return np.full(2, float(ratio)) if padding.max() <= _PADDING_PX else None


def in_calibrated_pixels(found: Opened, sizes: Mapping[str, Size], cropped: Collection[str] = ()) -> Opened:
    """Return detections in pixels of images of these sizes, resized with a warning if files state another.

    Of the ``cropped`` cameras, the size is the largest that their images can have.
    """
    factors: dict[str, Array] = {}
    differing: dict[tuple[Size, Size, bool], list[str]] = {}
    for name, size in found.sizes.items():
        whole, is_crop = sizes[name], name in cropped
        factor = None if is_crop else resizing(size, whole)
        small = all(np.array(size) <= np.array(whole) + _PADDING_PX)
        if not (small if is_crop else factor is not None and all(factor == 1.0)):
            differing.setdefault((size, whole, is_crop), []).append(name)
            if factor is not None:
                factors[name] = factor
    for (size, whole, is_crop), names in differing.items():
        numbers: dict[str, Any] = {"size": list(size), "size_of_camera": list(whole), "cropped": is_crop}
        own, crop = "its" if len(names) == 1 else "their", "a crop of at most " if is_crop else ""
        images = f"Detections of {listed(names)} come from images of {size[0]}×{size[1]} px, but {own} "
        images += f"calibration is for {crop}{whole[0]}×{whole[1]}"
        if names[0] in factors:
            numbers["factor"] = float(factors[names[0]].mean())
            what = f": assuming copies in another size, they are multiplied by {numbers['factor']:.4g}. If "
            what += f"the images are cropped instead, {_SAME_IMAGES}"
        else:
            turned = "width and height exchanged (is a phone's video turned?)"
            shape = turned if size == whole[::-1] else "which has another shape"
            what = f", {shape}: they are used as they are, and poses are probably wrong. To correct this, "
            what += _SAME_IMAGES
        sentence = f"{images}{what}."
        warn(Finding("image_sizes_differ", "warning", Subject(tuple(names)), numbers, sentence=sentence))
    return replace(found, factors=factors)
