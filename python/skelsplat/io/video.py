"""Videos and folders of images: which is whose camera's, frames in, frames out, one in memory at a time."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._atomic import atomic_path, atomic_write, opening
from skelsplat._budget import read_bytes
from skelsplat._optional import opencv, require
from skelsplat.exceptions import DatasetError, InvalidInputError, MissingPackageError
from skelsplat.io._files import VIDEO_SUFFIXES, natural
from skelsplat.io.detections._frames import frame_files
from skelsplat.io.detections._match import Candidates, cameras_called, match_by_name, match_by_order

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
Image = npt.NDArray[np.uint8]
Size = tuple[int, int]

# H.264, which browsers and slides play; OpenCV's wheels have no encoder for it. A frame is 10 ms.
_CODEC, _SPEED, _QUALITY = "libx264", "veryfast", "20"
_FIRST = {"movflags": "faststart"}  # its index before the frames: it plays while it loads
# Most frames per second and parts of one that MP4 states exactly: 30000/1001 and the like.
_PARTS = 1001
_PLAIN = 226  # level of a plain frame: light, as dark limbs are drawn on it
_BORDER = 0.002  # of its longer side
_CHOOSE = "or draw only the cameras that have one (cameras=)"


def find_videos(
    path: str | os.PathLike[str],
    names: Sequence[str],
    *,
    cameras: Collection[str] = (),
    order: str | Sequence[str] | None = None,
) -> dict[str, Path]:
    """Return the video, or the folder of images, of every camera, in the order of `names`.

    A path is a folder with one video, or one folder of images, per camera; what fits no camera is left alone.
    Or it is one video or folder of images, whose camera is the chosen one, or the one of its name. `cameras`
    are the cameras that are wanted; empty for all. `order` is the file or folder of each wanted camera, or
    "sorted", instead of matching by name. A chosen camera that is not there and an `order` that does not fit
    are an `InvalidInputError`; a path without videos and a wanted camera without one a `DatasetError`.
    """
    root = Path(path)
    meant = cameras_called(cameras, names, "cameras")
    wanted = [name for name in names if not meant or name in meant]
    kind, found = _entries(root)
    if root in found.values():
        return {_camera_of(root, kind, names, wanted): root}
    texts = {label: _name_of(path, kind) for label, path in found.items()}
    if order is not None:
        labels = match_by_order(Candidates(root, kind, texts), wanted, order)
    else:
        every = Candidates(root, kind, texts, idle=texts.keys())
        labels = match_by_name(every, names, optional=names if cameras else (), otherwise=_CHOOSE)
    missing = [name for name in wanted if name not in labels]
    if missing:
        expected = f"a {kind} for every chosen camera ({kind}s: {', '.join(found)})"
        raise DatasetError(root, "content", expected, f"none for {', '.join(missing)}")
    return {name: found[labels[name]] for name in wanted}


def videos_of(paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> dict[str, Path]:
    """Return the videos, or folders of images, by camera, which has the name of the file or folder.

    A path is one of them, or a folder of them. A path without videos is a `DatasetError`, two of one name are
    an `InvalidInputError`.
    """
    several = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    found: dict[str, Path] = {}
    for root in map(Path, several):
        kind, entries = _entries(root)
        for path in entries.values():
            camera = _name_of(path, kind)
            if camera in found:
                expected = "videos with different names, those of their cameras"
                raise InvalidInputError(f"videos: expected {expected}, got {found[camera]} and {path}")
            found[camera] = path
    return dict(sorted(found.items(), key=lambda item: natural(item[0])))


def _entries(root: Path) -> tuple[str, dict[str, Path]]:
    """Return what may belong to cameras and whether these are files or folders; `root` alone if it is one."""
    if root.is_file():
        return "file", {root.name: root}
    with opening(root, "a readable folder or video", "content"):
        there = sorted(path for path in root.iterdir() if not path.name.startswith("."))
    videos = {path.name: path for path in there if path.suffix.lower() in VIDEO_SUFFIXES and path.is_file()}
    if videos:
        return "file", videos
    if images_in(root):
        return "folder", {root.name: root}
    folders = {path.name: path for path in there if path.is_dir() and images_in(path)}
    if not folders:
        expected = f"videos ({', '.join(VIDEO_SUFFIXES)}) or folders of images ({', '.join(IMAGE_SUFFIXES)})"
        raise DatasetError(root, "content", expected, ", ".join(path.name for path in there[:9]) or "nothing")
    return "folder", folders


def _camera_of(root: Path, kind: str, names: Sequence[str], wanted: Sequence[str]) -> str:
    """Return the camera of a single video: the only one that is wanted, or the one of its name."""
    if len(wanted) == 1:
        return wanted[0]
    one = Candidates(root, kind, {root.name: _name_of(root, kind)})
    try:
        labels = match_by_name(one, names, optional=names)
    except DatasetError as error:
        expected = f"the chosen one of {', '.join(wanted)} this {kind} is of"
        raise DatasetError(root, kind, expected, "none, and its name does not say") from error
    return next(iter(labels))


def _name_of(path: Path, kind: str) -> str:
    place = path.absolute()  # "." has no name
    return place.stem if kind == "file" else place.name


@dataclass(frozen=True)
class FrameSource:
    """Where a camera's frames come from."""

    path: Path
    size: Size  # width and height of the first frame, as it is decoded
    rate: float | None  # frames per second, if the source says so
    first: int  # the camera's own numbers of its frames
    last: int  # of a video what its header says
    # files of a folder by the frame's number, ascending; none for a video
    images: Mapping[int, Path] = field(default_factory=dict)
    rotation: int = 0  # degrees by which a video's frames are turned to be upright, as its metadata say

    def frames(self, first: int, last: int) -> Iterator[tuple[int, Image]]:
        """Yield (number, image (H, W, 3), blue first) of the frames `first` to `last` that can be read.

        An image of another size than the first is a `DatasetError`.
        """
        paths = ((number, path) for number, path in self.images.items() if first <= number <= last)
        images = ((number, _read_image(path)) for number, path in paths)
        for number, image in images if self.images else self._of_video(first, last):
            if image is None:
                continue
            if _size(image) != self.size:
                expected = f"{self.size[0]}×{self.size[1]} like the others"
                path = self.images.get(number, self.path)
                raise DatasetError(path, f"frame {number}", expected, f"{image.shape[1]}×{image.shape[0]}")
            yield number, image

    def _of_video(self, first: int, last: int) -> Iterator[tuple[int, Image | None]]:
        with _capture(self.path) as capture:
            for number in range(self.first, last + 1):
                # what comes before is decoded and thrown away: seeking is not exact in all formats
                good, image = capture.read() if number >= first else (capture.grab(), None)
                if not good:
                    return
                yield number, image


@dataclass(frozen=True)
class PlainFrames(FrameSource):
    """Light grey frames with a border, where there is no video: of the numbers in ``numbers``."""

    numbers: tuple[int, ...] = ()  # ascending

    @classmethod
    def of(cls, path: Path, size: Size, numbers: Iterable[int]) -> PlainFrames:
        """Return frames of these numbers; ``path`` is the folder that errors name."""
        kept = tuple(map(int, numbers))
        return cls(path, size, None, kept[0], kept[-1], numbers=kept)

    def frames(self, first: int, last: int) -> Iterator[tuple[int, Image]]:
        """Yield (number, image (H, W, 3)) of the frames `first` to `last`."""
        edge = max(1, round(_BORDER * max(self.size)))
        plain = np.full((self.size[1], self.size[0], 3), _PLAIN - 40, dtype=np.uint8)
        plain[edge:-edge, edge:-edge] = _PLAIN
        for number in self.numbers:
            if first <= number <= last:
                yield number, plain.copy()


def open_source(path: Path, first_frame: int = 0) -> FrameSource:
    """Open a video, whose first frame has the number `first_frame`, or a folder of images.

    Images are numbered by the last integer in their names. Frames are turned upright as the file's metadata
    says, as detectors that read with OpenCV do. What cannot be read, and an image whose name has no number or
    that of another, is a `DatasetError`.
    """
    if path.is_dir():
        return _open_images(path)
    with _capture(path) as capture:
        good, image = capture.read()
        if not good:
            raise DatasetError(path, "video", "frames that can be decoded", "none")
        rate = float(capture.get(opencv().CAP_PROP_FPS))
        count = max(1, int(capture.get(opencv().CAP_PROP_FRAME_COUNT)))
        turned = int(capture.get(opencv().CAP_PROP_ORIENTATION_META)) % 360
    known = rate if math.isfinite(rate) and rate > 0 else None
    return FrameSource(path, _size(image), known, first_frame, first_frame + count - 1, rotation=turned)


@contextmanager
def _capture(path: Path) -> Iterator[Any]:
    """Open a video for reading and close it again."""
    if not path.is_file():
        raise DatasetError(path, "video", "a readable file", "no such file")
    capture = opencv().VideoCapture(str(path), opencv().CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise DatasetError(path, "video", "a video that OpenCV can read", "none (is it damaged?)")
        capture.set(opencv().CAP_PROP_ORIENTATION_AUTO, 1)  # not the default of every version
        yield capture
    finally:
        capture.release()


def _open_images(folder: Path) -> FrameSource:
    suffixes = sorted({path.suffix for path in images_in(folder)})
    if len(suffixes) > 1:
        raise DatasetError(folder, "images", "files of one format", ", ".join(suffixes))
    files = frame_files(folder, f"*{suffixes[0] if suffixes else '.png'}", "one image per frame")
    for path in files.values():
        image = _read_image(path)
        if image is not None:
            return FrameSource(folder, _size(image), None, min(files), max(files), files)
    raise DatasetError(folder, "images", "images that OpenCV can read", f"{len(files)} that it cannot")


def images_in(folder: Path) -> list[Path]:
    """Return the images in a folder, by name."""
    try:
        shown = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    except OSError:
        return []
    return sorted(path for path in shown if not path.name.startswith("."))


def _read_image(path: Path) -> Image | None:
    """Return an image, or None for a file that is none."""
    data = np.frombuffer(read_bytes(path), dtype=np.uint8)  # imread cannot open every path on Windows
    if not data.size:
        return None
    try:
        image: Image | None = opencv().imdecode(data, opencv().IMREAD_COLOR)
    except opencv().error:  # more pixels than are decoded
        return None
    return image


def _size(image: Image) -> Size:
    return image.shape[1], image.shape[0]


class FrameSink:
    """Where frames go: PNG files in a folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.count = 0  # frames written so far
        self.size = (0, 0)  # width and height of the last frame as it was written

    def write(self, number: int, image: Image) -> None:
        """Write a frame, or raise `DatasetError`."""
        self.path.mkdir(parents=True, exist_ok=True)
        _, data = opencv().imencode(".png", image)
        with atomic_write(self.path / f"{number:06d}.png", durable=False) as stream:
            stream.write(data.tobytes())
        self.count, self.size = self.count + 1, _size(image)


class _Mp4Sink(FrameSink):
    """A video, which counts frames by itself."""

    def __init__(self, path: Path, rate: float, stack: ExitStack, comment: str) -> None:
        super().__init__(path)
        self._comment = comment
        self._rate, self._stack = Fraction(rate).limit_denominator(_PARTS), stack
        self._av = require("av", "videos", "video")
        self._video: Any = None

    def write(self, number: int, image: Image) -> None:
        del number
        even = np.pad(image, [(0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)], mode="edge")
        if self._video is None:
            self._open(_size(even))
        for packet in self._stream.encode(self._av.VideoFrame.from_ndarray(even, format="bgr24")):
            self._video.mux(packet)
        self.count += 1

    def _open(self, size: Size) -> None:
        temporary = self._stack.enter_context(atomic_path(self.path, ".mp4"))
        self._video = self._stack.enter_context(self._av.open(str(temporary), "w", options=_FIRST))
        self._video.metadata["comment"] = self._comment
        options = {"preset": _SPEED, "crf": _QUALITY}
        self._stream = self._video.add_stream(_CODEC, rate=self._rate, options=options)
        self._stream.width, self._stream.height = self.size = size
        self._stream.pix_fmt = "yuv420p"

    def close(self) -> None:
        """Write what the encoder still holds."""
        if self._video is not None:
            for packet in self._stream.encode():
                self._video.mux(packet)
            self._video.close()


@contextmanager
def open_sink(path: Path, rate: float | None, comment: str = "") -> Iterator[FrameSink]:
    """Open a video of `rate` frames per second for writing, or without a rate a folder of PNG files.

    The video, MP4 in H.264, appears under its name when the block ends without an exception; `comment_of`
    returns its ``comment``. All its frames have the size of the first; a width or height that is odd is made
    even by repeating the last column or row. One without frames is not written. PNG files are named by the
    frame's number; each is whole or not there, and their folder is made with the first.
    """
    if rate is None:
        yield FrameSink(path)
        return
    with ExitStack() as stack:
        sink = _Mp4Sink(path, rate, stack, comment)
        yield sink
        sink.close()


def comment_of(path: Path) -> str:
    """Return the comment in a video; nothing if it has none, or cannot be read."""
    with suppress(MissingPackageError):
        av = require("av", "videos", "video")
        with suppress(av.FFmpegError, OSError), av.open(str(path)) as video:
            return str(video.metadata.get("comment", ""))
    return ""
