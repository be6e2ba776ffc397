"""Cameras that repeat one image: detections that stay the same to the last bit while others move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat._words import listed
from skelsplat.findings import Finding, Remedy, Subject, warn

# Frames that are doubled where videos are brought to another frame rate repeat once or twice; noise differs
# in the last digits of every new image.
_REPEATS = 12
_OTHERS = 0.5  # part of the frames in which other cameras show something new


def frozen(detections: Array) -> Mask:
    """Return where each camera's detections (T, M, …, 2 | 3) are those of an older image, (T, M)."""
    count, views = detections.shape[:2]
    out = np.zeros((count, views), dtype=np.bool_)
    if count <= _REPEATS or views < 2:
        return out
    flat = detections.reshape(count, views, -1)
    pixels = detections[..., :2].reshape(count, views, -1)  # a confidence of 0 is no image
    there: Mask = np.asarray(np.isfinite(pixels).any(axis=2))
    both = there[1:] & there[:-1]
    same = both & ((flat[1:] == flat[:-1]) | (np.isnan(flat[1:]) & np.isnan(flat[:-1]))).all(axis=2)
    new = both & ~same
    for i in np.flatnonzero(same.sum(axis=0) >= _REPEATS):
        others = np.delete(new, i, axis=1).any(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], same[:, i], [False]])))
        for first, end in edges.reshape(-1, 2):
            if end - first >= _REPEATS and others[first:end].mean() >= _OTHERS:
                out[first + 1 : end + 1, i] = True
    return out


def without_frozen(detections: Array, repeated: Mask) -> Array:
    """Return the detections (T, M, …) without those of older images; NaN there."""
    if not repeated.any():
        return detections
    shape = (*repeated.shape, *(1,) * (detections.ndim - 2))
    cleared: Array = np.where(repeated.reshape(shape), np.nan, detections)
    return cleared


def of_new_images(detections: Array, names: Sequence[str]) -> Array:
    """Return the detections (T, M, …) `without_frozen`, with a warning of the cameras that repeat images."""
    repeated = frozen(detections)
    stopped = frozen_finding(names, repeated)
    if stopped is not None:
        warn(stopped)
    return without_frozen(detections, repeated)


def frozen_finding(names: Sequence[str], repeated: Mask, frames: Index | None = None) -> Finding | None:
    """Return the finding on cameras ``names`` that repeat images, in ``frames`` (T,); None if none does."""
    cameras = np.flatnonzero(repeated.any(axis=0)).tolist()
    if not cameras:
        return None
    counted = np.arange(len(repeated)) if frames is None else frames
    counts = repeated.sum(axis=0)[cameras].tolist()
    firsts = counted[repeated[:, cameras].argmax(axis=0)].tolist()
    which = [
        f"{names[i]} ({count:,} frames, from frame {first} on)"
        for i, count, first in zip(cameras, counts, firsts, strict=True)
    ]
    sentence = (
        f"The detections of {listed(which)} repeat one image while others move, and were left out there."
    )
    numbers = {"frames": counts, "first": firsts}
    remedy = (Remedy("without", None),) if len(names) > 2 else ()
    subject = Subject(tuple(names[i] for i in cameras))
    return Finding("camera_frozen", "warning", subject, numbers, remedy, sentence=sentence)
