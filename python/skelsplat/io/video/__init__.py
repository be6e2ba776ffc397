"""Videos and folders of images: which is whose camera's, frames in, frames out, one in memory at a time."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from pathlib import Path

from skelsplat._atomic import opening
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import VIDEO_SUFFIXES, natural
from skelsplat.io.detections._match import Candidates, cameras_called, match_by_name, match_by_order
from skelsplat.io.video._frames import IMAGE_SUFFIXES, images_in
from skelsplat.io.video._frames import FrameSource as FrameSource
from skelsplat.io.video._frames import Image as Image
from skelsplat.io.video._frames import PlainFrames as PlainFrames
from skelsplat.io.video._frames import Size as Size
from skelsplat.io.video._frames import open_sink as open_sink
from skelsplat.io.video._frames import open_source as open_source

_CHOOSE = "or draw only the cameras that have one (chosen=)"


def find_videos(
    path: str | os.PathLike[str],
    names: Sequence[str],
    *,
    chosen: Collection[str] = (),
    order: str | Sequence[str] | None = None,
) -> dict[str, Path]:
    """Return the video, or the folder of images, of every camera, in the order of `names`.

    A path is a folder with one video, or one folder of images, per camera; what fits no camera is left alone.
    Or it is one video or folder of images, whose camera is the chosen one, or the one of its name. `chosen`
    are the cameras that are wanted; empty for all. `order` is the file or folder of each wanted camera, or
    "sorted", instead of matching by name. A chosen camera that is not there and an `order` that does not fit
    are an `InvalidInputError`; a path without videos and a wanted camera without one a `DatasetError`.
    """
    root = Path(path)
    meant = cameras_called(chosen, names, "cameras")
    wanted = [name for name in names if not meant or name in meant]
    kind, found = _entries(root)
    if root in found.values():
        return {_camera_of(root, kind, names, wanted): root}
    texts = {label: _name_of(path, kind) for label, path in found.items()}
    if order is not None:
        labels = match_by_order(Candidates(root, kind, texts), wanted, order)
    else:
        every = Candidates(root, kind, texts, idle=texts.keys())
        labels = match_by_name(every, names, optional=names if chosen else (), otherwise=_CHOOSE)
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
