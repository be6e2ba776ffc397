"""Frames into a video or into a folder of images; each file is whole or not there."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat._opencv import opencv
from skelsplat.exceptions import DatasetError
from skelsplat.io._atomic import atomic_path, atomic_write

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from skelsplat.io.video._source import Image

# The only fast encoder in OpenCV's wheels that MP4 takes; H.264 is not in them.
_CODEC = "mp4v"


class Mp4Sink:
    """An MP4 video, MPEG-4 part 2, that appears under its name when the block ends without an exception.

    A width or height that is odd is made even by repeating the last column or row.

    Parameters
    ----------
    path : Path
    rate : float
        Frames per second.

    Attributes
    ----------
    path : Path
    count : int
        Frames written so far. A video without any is not written.
    size : (width, height)
        Of the frames as they are written.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self.path = path
        self.count = 0
        self.size = (0, 0)
        self._rate = rate
        self._temporary: Path | None = None
        self._writer: Any = None
        self._stack = ExitStack()

    def __enter__(self) -> Mp4Sink:
        return self

    def write(self, number: int, image: Image) -> None:
        """Append a frame; all have the size of the first.

        Raises
        ------
        DatasetError
            If the video cannot be written.
        """
        del number  # a video counts by itself
        even = np.pad(image, [(0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)], mode="edge")
        if self._writer is None:
            self._open(even)
        self._writer.write(even)
        self.count += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.release()
        if error is not None:
            self._stack.__exit__(kind, error, trace)
            return
        with self._stack:
            if self._temporary is not None:
                self._check(self._temporary)

    def _open(self, image: Image) -> None:
        self._temporary = self._stack.enter_context(atomic_path(self.path, ".mp4"))
        size = image.shape[1], image.shape[0]
        code = opencv().VideoWriter_fourcc(*_CODEC)
        writer = opencv().VideoWriter(str(self._temporary), opencv().CAP_FFMPEG, code, self._rate, size)
        if not writer.isOpened():
            expected = f"an {_CODEC} video of {size[0]}×{size[1]} at {self._rate:g} per second to be written"
            raise DatasetError(self.path, "output", expected, "a refusal of OpenCV")
        self._writer, self.size = writer, size

    def _check(self, temporary: Path) -> None:
        """Read the header back: a full disk is no error to OpenCV's writer."""
        capture = opencv().VideoCapture(str(temporary), opencv().CAP_FFMPEG)
        count = int(capture.get(opencv().CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
        capture.release()
        if count != self.count:
            raise DatasetError(self.path, "output", f"{self.count} frames to be written", f"{count}")


class PngSink:
    """A folder of PNG files, named by the frame's number.

    Parameters
    ----------
    path : Path
        The folder; made with the first frame.

    Attributes
    ----------
    path : Path
    count : int
        Frames written so far.
    size : (width, height)
        Of the last frame.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.count = 0
        self.size = (0, 0)

    def __enter__(self) -> PngSink:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def write(self, number: int, image: Image) -> None:
        """Write a frame.

        Raises
        ------
        DatasetError
            If it cannot be written.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        _, data = opencv().imencode(".png", image)
        with atomic_write(self.path / f"{number:06d}.png", durable=False) as stream:
            stream.write(data.tobytes())
        self.count += 1
        self.size = image.shape[1], image.shape[0]
