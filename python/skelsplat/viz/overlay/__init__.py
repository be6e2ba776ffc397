"""Detections, reprojected skeleton and error ellipses on a camera's image: arrays and image in, image out.

Integer coordinates are pixel centres. Images are (H, W, 3) uint8 in OpenCV's order of colours, blue first.
"""

from skelsplat.viz.overlay._draw import OverlayFrame, Shown, draw_overlay
from skelsplat.viz.overlay._tiles import Tiling, blank_tile, tiling
from skelsplat.viz.overlay._words import draw_label, draw_name, legend_strip

__all__ = [
    "OverlayFrame",
    "Shown",
    "Tiling",
    "blank_tile",
    "draw_label",
    "draw_name",
    "draw_overlay",
    "legend_strip",
    "tiling",
]
