"""Frames into a video or into a folder of images; each file is whole or not there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from skelsplat._opencv import opencv
from skelsplat.exceptions import DatasetError
from skelsplat.io._atomic import atomic_path, atomic_write
from skelsplat.io.video._source import Image

# The only fast encoder in OpenCV's wheels that MP4 takes; H.264 is not in them.
_CODEC = "mp4v"


class FrameSink(ABC):
    """Where frames go, in a ``with`` block.

    Attributes
    ----------
    path : Path
    count : int
        Frames written so far.
    size : (width, height)
        Of the last frame as it was written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.count = 0
        self.size = (0, 0)

    def __enter__(self) -> FrameSink:
        return self

    @abstractmethod
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    @abstractmethod
    def write(self, number: int, image: Image) -> None:
        """Write a frame, or raise `DatasetError`."""


class Mp4Sink(FrameSink):
    """An MP4 video, MPEG-4 part 2, that appears under its name when the block ends without an exception.

    All frames have the size of the first; a width or height that is odd is made even by repeating the last
    column or row. A video without frames is not written. `rate` is in frames per second.
    """

    def __init__(self, path: Path, rate: float) -> None:
        super().__init__(path)
        self._rate = rate
        self._temporary: Path | None = None
        self._writer: Any = None
        self._stack = ExitStack()

    def write(self, number: int, image: Image) -> None:
        """Append a frame; a video counts by itself."""
        del number
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


class PngSink(FrameSink):
    """A folder of PNG files, named by the frame's number; it is made with the first frame."""

    def write(self, number: int, image: Image) -> None:
        """Write a frame to a file of its own."""
        self.path.mkdir(parents=True, exist_ok=True)
        _, data = opencv().imencode(".png", image)
        with atomic_write(self.path / f"{number:06d}.png", durable=False) as stream:
            stream.write(data.tobytes())
        self.count += 1
        self.size = image.shape[1], image.shape[0]

    def __exit__(self, *_: object) -> None:
        return None
