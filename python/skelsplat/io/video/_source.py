"""Frames of one camera, from a video or from a folder of images, one after the other."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._opencv import opencv
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import opening
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.video._find import images_in

Image = npt.NDArray[np.uint8]
Size = tuple[int, int]


@dataclass(frozen=True)
class FrameSource(ABC):
    """Where a camera's frames come from.

    Attributes
    ----------
    path : Path
    size : (width, height)
        Of the first frame, as it is decoded.
    rate : float or None
        Frames per second, if the source says so.
    first, last : int
        The camera's own numbers of its frames; the last of a video is what its header says.
    """

    path: Path
    size: Size
    rate: float | None
    first: int
    last: int

    @abstractmethod
    def frames(self, first: int, last: int) -> Iterator[tuple[int, Image]]:
        """Yield (number, image (H, W, 3), blue first) of the frames `first` to `last` that can be read.

        Raises
        ------
        DatasetError
            If an image has another size than the first.
        """

    def _checked(self, image: Image, path: Path, number: int) -> Image:
        if _size(image) != self.size:
            expected = f"{self.size[0]}×{self.size[1]} like the others"
            raise DatasetError(path, f"frame {number}", expected, f"{image.shape[1]}×{image.shape[0]}")
        return image


def open_source(path: Path, first_frame: int = 0) -> FrameSource:
    """Open a video, whose first frame has the number `first_frame`, or a folder of images.

    Images are numbered by the last integer in their names. Frames are turned upright as the file's metadata
    says, as detectors that read with OpenCV do.

    Raises
    ------
    DatasetError
        If it cannot be read, or an image's name has no number or that of another.
    MissingPackageError
        If OpenCV is not installed.
    """
    return _open_images(path) if path.is_dir() else _open_video(path, first_frame)


class _Video(FrameSource):
    def frames(self, first: int, last: int) -> Iterator[tuple[int, Image]]:
        with _capture(self.path) as capture:
            for number in range(self.first, last + 1):
                if number < first:  # decoded and thrown away: seeking is not exact in all formats
                    if not capture.grab():
                        return
                    continue
                good, image = capture.read()
                if not good:
                    return
                yield number, self._checked(image, self.path, number)


@dataclass(frozen=True)
class _Images(FrameSource):
    files: dict[int, Path]

    def frames(self, first: int, last: int) -> Iterator[tuple[int, Image]]:
        for number, path in self.files.items():
            image = _read_image(path) if first <= number <= last else None
            if image is not None:
                yield number, self._checked(image, path, number)


@contextmanager
def _capture(path: Path) -> Iterator[Any]:
    """Open a video for reading and close it again."""
    if not path.is_file():
        raise DatasetError(path, "video", "a readable file", "no such file")
    capture = opencv().VideoCapture(str(path), opencv().CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise DatasetError(path, "video", "a video that OpenCV can read", "none (is it damaged?)")
        yield capture
    finally:
        capture.release()


def _open_video(path: Path, first_frame: int) -> _Video:
    with _capture(path) as capture:
        good, image = capture.read()
        if not good:
            raise DatasetError(path, "video", "frames that can be decoded", "none")
        rate = float(capture.get(opencv().CAP_PROP_FPS))
        count = max(1, int(capture.get(opencv().CAP_PROP_FRAME_COUNT)))
    known = rate if math.isfinite(rate) and rate > 0 else None
    return _Video(path, _size(image), known, first_frame, first_frame + count - 1)


def _open_images(folder: Path) -> _Images:
    suffixes = sorted({path.suffix for path in images_in(folder)})
    if len(suffixes) > 1:
        raise DatasetError(folder, "images", "files of one format", ", ".join(suffixes))
    files = frame_files(folder, f"*{suffixes[0] if suffixes else '.png'}", "one image per frame")
    for path in files.values():
        image = _read_image(path)
        if image is not None:
            return _Images(folder, _size(image), None, min(files), max(files), files)
    raise DatasetError(folder, "images", "images that OpenCV can read", f"{len(files)} that it cannot")


def _read_image(path: Path) -> Image | None:
    """Return an image, or None for a file that is none."""
    with opening(path, field="image"):
        data = np.fromfile(path, dtype=np.uint8)  # imread cannot open every path on Windows
    if not data.size:
        return None
    image: Image | None = opencv().imdecode(data, opencv().IMREAD_COLOR)
    return image


def _size(image: Image) -> Size:
    return image.shape[1], image.shape[0]
