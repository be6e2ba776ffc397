"""What every detection reader returns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class DetectionSet:
    """All people found in all frames of all cameras.

    Attributes
    ----------
    people : (T, M, P, K, 3)
        x and y in pixels of the original image, confidence in [0, 1]. A joint that was not detected, and a
        place in P where nobody stands, is NaN. The order of people in a frame is the detector's: place p is
        nobody's identity.
    frames : (T,) int
        Frame numbers, ascending.
    camera_names : tuple of str
        The M cameras, in the order they were asked for.
    sources : tuple of Path or None
        The folder or file of each camera; None for a camera without detections.
    layout : str
        Name of the joint layout of the K joints.
    format : str
        Name of the format that they were read from.
    labels : tuple of str or None
        The folder, file or place in the file of each camera, as ``order`` of `read_detections` takes it.
    uneven : bool
        Cameras have different frames in the files, which ``frames="strict"`` refuses.
    """

    people: npt.NDArray[np.float64]
    frames: npt.NDArray[np.int64]
    camera_names: tuple[str, ...]
    sources: tuple[Path | None, ...]
    layout: str
    format: str = ""
    labels: tuple[str | None, ...] = ()
    uneven: bool = False

    @property
    def people_per_frame(self) -> npt.NDArray[np.int64]:
        """Number of people with at least one joint, (T, M)."""
        there = np.isfinite(self.people[..., 0]).any(axis=-1)
        count: npt.NDArray[np.int64] = there.sum(axis=-1, dtype=np.int64)
        return count
