"""Campus: several persons in a few cameras, 14 joints; `_shelf_campus` describes the files."""

from __future__ import annotations

from pathlib import Path

from skelsplat.datasets._model import Dataset
from skelsplat.datasets._registry import Survey
from skelsplat.datasets._shelf_campus import CAMPUS, read_scene, survey_scene

DESCRIPTION = "Campus: several persons in 3 cameras."


def read(root: Path, *, detector: str | None = None, detections: Path | str | None = None) -> Dataset:
    """Read Campus.

    Parameters
    ----------
    root : Path
    detector : str or None
        Name of the detector, as in ``2d_DETECTOR``; chosen as for Human3.6M when left out.
    detections : Path or None
        A folder of detections outside the root, in place of ``2d_DETECTOR/S0``.

    Raises
    ------
    DatasetError
        If a file is missing or malformed; names the file and the field.
    """
    return read_scene(CAMPUS, root, detector, detections)


def survey(root: Path, *, detector: str | None = None, detections: Path | str | None = None) -> Survey:
    """Say which files are there."""
    return survey_scene(CAMPUS, root, detector, detections)
