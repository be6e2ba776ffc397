"""One frame: the image of a camera with what is known of the person in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skelsplat._arrays import Array, ArrayFields, Mask
from skelsplat.viz._body import SIGMAS, Skeleton
from skelsplat.viz.overlay import _marks
from skelsplat.viz.overlay._marks import Colour, Image, Sizes


@dataclass(frozen=True)
class OverlayFrame(ArrayFields):
    """What is drawn on one image, in its pixels; NaN where there is nothing."""

    pose: Array  # (N, 2) the refined joints where the camera sees them, lens distortion included
    covariances: Array  # (N, 2, 2) their error bars in the image, px²
    reliable: Mask  # (N,) joints drawn solid; the others are hollow, and their limbs dashed
    detections: Array  # (N, 2) as the detector gave them
    weights: Array  # (N,) how much each detection is trusted, in [0, 1]; NaN for one that was not used
    swapped: Mask  # (N,) detections that were taken for the joint on the other side of the body
    before: Array  # (N, 2) the pose that the refinement started from

    def moved(self, scale: Array, shift: Array) -> OverlayFrame:
        """Return the same frame on an image whose pixels are ``scale`` · pixel + ``shift``, both (2,)."""
        return replace(
            self,
            pose=self.pose * scale + shift,
            covariances=self.covariances * np.outer(scale, scale),
            detections=self.detections * scale + shift,
            before=self.before * scale + shift,
        )


@dataclass(frozen=True)
class Shown:
    """Which layers are drawn, and below which weight a detection counts as rejected."""

    rejected_below: float
    pose: bool = True
    ellipses: bool = True
    detections: bool = True
    before: bool = False


def draw_overlay(image: Image, frame: OverlayFrame, skeleton: Skeleton, shown: Shown) -> None:
    """Draw ``frame`` on ``image`` (H, W, 3), in place."""
    sizes = Sizes.of(image.shape[1], image.shape[0])
    if shown.before:
        for a, b in skeleton.limbs:
            draw_limb(image, frame.before[[a, b]], _marks.BEFORE, sizes, solid=False)
    if shown.ellipses:
        for j, covariance in enumerate(frame.covariances):
            colour = _side(skeleton, j)
            _marks.ellipse(image, frame.pose[j], covariance, colour, sigmas=SIGMAS, width=sizes.thin)
    if shown.pose:
        for a, b in skeleton.limbs:
            colour, ends = _marks.bgr(skeleton.limb_colour((a, b))), frame.pose[[a, b]]
            if frame.reliable[[a, b]].all():
                draw_limb(image, ends, colour, sizes, solid=True)
            else:
                _marks.dashed(image, ends, colour, sizes.thin, dash=sizes.mark)
    if shown.detections:
        for j in range(len(frame.detections)):
            _draw_detection(image, frame, j, skeleton, shown)
    if shown.pose:
        for j, joint in enumerate(frame.pose):
            draw_joint(image, joint, _side(skeleton, j), sizes, solid=bool(frame.reliable[j]))


def draw_limb(image: Image, ends: Array, colour: Colour, sizes: Sizes, *, solid: bool) -> None:
    """Draw a limb (2, 2) with an edge in a lighter colour, or a thin line without; nothing for NaN."""
    if solid:
        blue, green, red = ((own + light) // 2 for own, light in zip(colour, _marks.LIGHT, strict=True))
        _marks.line(image, ends, (blue, green, red), sizes.limb + 2)
    _marks.line(image, ends, colour, sizes.limb if solid else sizes.thin)


def draw_joint(image: Image, at: Array, colour: Colour, sizes: Sizes, *, solid: bool) -> None:
    """Draw a joint: a dot with a light edge, or a light square with an edge, as discs are detections."""
    if solid:
        _marks.dot(image, at, sizes.joint + sizes.edge, _marks.LIGHT)
        _marks.dot(image, at, sizes.joint, colour)
    else:
        _marks.polygon(image, at + (sizes.hollow + sizes.limb) * _marks.SQUARE, colour)
        _marks.polygon(image, at + sizes.hollow * _marks.SQUARE, _marks.LIGHT)


def draw_detection(
    image: Image, at: Array, weight: float, sizes: Sizes, *, rejected: bool, own: str | None = None
) -> None:
    """Draw a disc in the colour of its weight (grey for NaN), or a cross if it is rejected.

    With ``own``, the colour of a person, it is in this colour, paler for smaller weights.
    """
    if rejected:
        corners = at + sizes.mark / np.sqrt(2.0) * _marks.SQUARE
        for colour, width in ((_marks.LIGHT, sizes.limb + 2), (_marks.REJECTED, sizes.limb)):
            _marks.line(image, corners[::2], colour, width)
            _marks.line(image, corners[1::2], colour, width)
        return
    colour = _marks.BEFORE if np.isnan(weight) else _marks.weight_colour(weight, own)
    _marks.dot(image, at, sizes.mark + sizes.edge, _marks.DARK)
    _marks.dot(image, at, sizes.mark, colour)


def draw_swapped(image: Image, at: Array, sizes: Sizes) -> None:
    """Draw the diamond about a detection that was taken for the other side's joint."""
    _marks.polygon(image, at + 2.0 * sizes.mark * _marks.DIAMOND, _marks.SWAPPED, sizes.limb)


def _draw_detection(image: Image, frame: OverlayFrame, j: int, skeleton: Skeleton, shown: Shown) -> None:
    at, weight, sizes = frame.detections[j], float(frame.weights[j]), Sizes.of(image.shape[1], image.shape[0])
    rejected = weight < shown.rejected_below
    if rejected and not frame.swapped[j]:  # an exchanged one was meant for another joint
        _marks.line(image, np.stack([at, frame.pose[j]]), _marks.REJECTED, sizes.thin)
    draw_detection(image, at, weight, sizes, rejected=rejected, own=skeleton.own)
    if frame.swapped[j]:
        draw_swapped(image, at, sizes)


def _side(skeleton: Skeleton, joint: int) -> Colour:
    return _marks.bgr(skeleton.colour(joint))
