"""Simulated recordings: what a data set with ground truth holds of one person, all of it made from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._arrays import Array, Mask
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig

GENERATOR_VERSION = 1
"""Raised whenever the same name, number and seed give other data than before."""

MONOCULAR_SIGMA_MM = 62.0
"""Error per axis of the simulated monocular poses; their fusion then errs 40 mm (mean per joint, 4 views)."""

# What the random streams of a recording are for. Occluders and detectors do not change the poses.
POSES, OCCLUDERS, MONOCULAR, DETECTORS = range(4)
# Boxes are drawn this much wider than the joints, as a share of their extent on each side.
_BOX_MARGIN = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One take of one person, T frames in M cameras, N joints.

    Attributes
    ----------
    key, subject, action : str
        `key` is unique and may contain a slash: ``"S9/Directions 1"``; `action` has no number.
    rig_name : str
        Of the rig in `RecordingSet.rigs`.
    frames : (T,) int64
    truth : (T, N, 3) mm
    boxes : (T, M, 4) px
        Left, top, right, bottom; NaN where no joint is in the image.
    detections : mapping of detector to (T, M, N, 3)
        Pixels and confidence; missing = NaN, NaN, 0.
    monocular : (T, M, N, 3) mm
        World poses, one per view.
    visible : (T, M, N) bool or None
        Joints in the image that no occluder hides; None without occluders.
    """

    key: str
    subject: str
    action: str
    rig_name: str
    frames: NDArray[np.int64]
    truth: Array
    boxes: Array
    detections: Mapping[str, Array]
    monocular: Array
    visible: Mask | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSet:
    """Recordings that share a layout and detectors.

    Attributes
    ----------
    name : str
    layout : Layout
    rigs : mapping of name to CameraRig
    recordings : tuple of Recording
    parameters : mapping
        All that the data follow from, for people to read: seed, detectors, generator's version.
    """

    name: str
    layout: Layout
    rigs: Mapping[str, CameraRig]
    recordings: tuple[Recording, ...]
    parameters: Mapping[str, Any]


def stream(*key: int) -> np.random.Generator:
    """Random numbers that belong to `key`: the seed, the places in the set, what they are for."""
    return np.random.default_rng(key)


def boxes(pixels: Array) -> Array:
    """Boxes (T, M, 4) round the joints (T, M, N, 2) in the image, with a margin."""
    seen = np.isfinite(pixels)
    low = np.where(seen, pixels, np.inf).min(axis=2)
    high = np.where(seen, pixels, -np.inf).max(axis=2)
    nobody = np.logical_not(seen.any(axis=(2, 3)))[..., None]
    low, high = (np.where(nobody, np.nan, edge) for edge in (low, high))
    margin = _BOX_MARGIN * (high - low)
    return np.concatenate([low - margin, high + margin], axis=-1)
