"""The folders that the pages talk about: files of the sample in the form that each tool writes."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import skelsplat as sk
from skelsplat.io import sample

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

# what the pages need of the recording's 100 frames
FRAMES = 24


def prepare(page: str, folder: Path) -> None:
    """Put the files that `page` starts from into `folder`."""
    if page in PREPARED:
        PREPARED[page](folder)


def _readme(folder: Path) -> None:
    paths = _sample(folder)
    paths.detections.rename(folder / "pose")


def _sample(folder: Path) -> sample.SamplePaths:
    """The calibration and the first frames of the sample."""
    paths = sample.extract(folder)
    for camera in paths.detections.iterdir():
        for path in sorted(camera.iterdir())[FRAMES:]:
            path.unlink()
    return paths


PREPARED: dict[str, Callable[[Path], None]] = {
    "README.md": _readme,
}
