"""Whether detections and videos are of images of the calibration's size, as far as files state it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

import skelsplat as sk
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

    Images of the same shape are copies in another size. Up to 16 px of the larger image are what codecs fill
    up or cut off, at the right and lower border: then the factor is the ratio of the other side, the simpler
    fraction (540×960 and 1088×1920: 2). Images with width and height exchanged are no copies.
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


def in_calibrated_pixels(found: Opened, rig: sk.CameraRig, cropped: Collection[str] = ()) -> Opened:
    """Return detections in pixels of the cameras' images, resized where the files state another size.

    Of the ``cropped`` cameras, the rig's size is the largest that their images can have.

    Warns
    -----
    FindingWarning
        Of detections that are resized, and of those from images that are no copy of the calibration's.
    """
    factors: dict[str, Array] = {}
    differing: dict[tuple[Size, Size, bool], list[str]] = {}
    for name, size in found.sizes.items():
        whole, is_crop = rig[name].size, name in cropped
        if is_crop and all(np.array(size) <= np.array(whole) + _PADDING_PX):
            continue
        factor = None if is_crop else resizing(size, whole)
        if factor is None or (factor != 1.0).any():
            differing.setdefault((size, whole, is_crop), []).append(name)
        if factor is not None and (factor != 1.0).any():
            factors[name] = factor
    for (size, whole, is_crop), names in differing.items():
        numbers: dict[str, Any] = {"size": list(size), "size_of_camera": list(whole), "cropped": is_crop}
        own, crop = "its" if len(names) == 1 else "their", "a crop of at most " * is_crop
        images = f"Detections of {listed(names)} come from images of {size[0]}×{size[1]} px, but {own} "
        images += f"calibration is for {crop}{whole[0]}×{whole[1]}"
        if names[0] in factors:
            scale = float(factors[names[0]].mean())
            finding = Finding(
                "image_sizes_differ",
                "warning",
                Subject(cameras=tuple(names)),
                {**numbers, "factor": scale},
                sentence=f"{images}: assuming copies in another size, they are multiplied by {scale:.4g}. "
                f"If the images are cropped instead, {_SAME_IMAGES}.",
            )
        else:
            turned = "width and height exchanged (is a phone's video turned?)"
            finding = Finding(
                "image_sizes_differ",
                "warning",
                Subject(cameras=tuple(names)),
                numbers,
                sentence=f"{images}, {turned if size == whole[::-1] else 'which has another shape'}: they "
                f"are used as they are, and poses are probably wrong. To correct this, {_SAME_IMAGES}.",
            )
        warn(finding)
    return replace(found, factors=factors)
