"""2D detections: one reader for all tools' files, found by content or by name, to one `DetectionSet`.

A format is a look at a file's beginning and readers from a folder or file of one camera, or from a file of
all, to views: functions and a row in `FORMATS`. Cameras, frames, joints and missing values are the same for
all. What is wrong with a file is a `DatasetError` with its path and field, what is wrong with an argument an
`InvalidInputError`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import skelsplat as sk
from skelsplat._budget import within_memory
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.io._files import natural
from skelsplat.io.detections._format import View
from skelsplat.io.detections._frames import (
    FRAME_MODES,
    FrameMode,
    check_offsets,
    check_rates,
    clocks_of,
    shared_frames,
)
from skelsplat.io.detections._joints import Skeleton, check_mapping, choose_layout, read_layout, read_skeleton
from skelsplat.io.detections._match import (
    Candidates,
    camera_called,
    cameras_called,
    is_among,
    match_by_name,
    match_by_order,
)
from skelsplat.io.detections._opened import DetectionSet, Opened
from skelsplat.io.detections._registry import FORMATS, find_format, offered

__all__ = [
    "FORMATS",
    "DetectionSet",
    "Opened",
    "Rates",
    "Skeleton",
    "View",
    "camera_called",
    "camera_labels",
    "cameras_called",
    "is_among",
    "open_detections",
    "read_detections",
    "read_layout",
    "read_skeleton",
    "sights",
]

Rates = float | Mapping[str, float] | None
"""Frames per second of all cameras, or by camera; None: as files state them."""


def read_detections(
    path: str | os.PathLike[str],
    cameras: sk.CameraRig | Sequence[sk.Camera] | Sequence[str],
    *,
    layout: str | os.PathLike[str] | sk.Layout | None = None,
    format: str | None = None,
    frames: FrameMode = "strict",
    offsets: Mapping[str, float] | None = None,
    fps: Rates = None,
    order: str | Sequence[str] | None = None,
    mapping: Mapping[str, str | int | None] | None = None,
    sequence: str | None = None,
    without: Collection[str] = (),
) -> DetectionSet:
    """Read the 2D detections of all cameras, whichever tool wrote them.

    Parameters
    ----------
    path : path
        A folder with one folder or one file per camera, named like it; or one file of all cameras. The
        page on file formats says what each tool writes.
    cameras : CameraRig, sequence of Camera or of names
        Gives the views and their order. Cameras must have names, unless `order` is given.
    layout : str, path or Layout
        What the N joints are, as `read_layout` takes it; ``"file"``: those that the files name. It may be
        left out if the files name exactly the joints of one built-in layout, or have as many as one detector
        alone (21, 33, 133, 136).
    format : str, optional
        A key of `FORMATS`; found from the files when left out.
    frames : {"strict", "intersection", "union"}
        ``strict`` asks for the same frame numbers for all cameras, ``intersection`` reads those that all
        have, ``union`` every frame. AlphaPose, COCO and plain csv do not list frames without people; there
        ``strict`` reads every frame that is listed for any camera.
    offsets : dict, optional
        By camera, frames to add to its numbers: ``{"cam2": 3}`` if that camera started 3 frames late, in the
        common time of the result, in which ``strict`` asks for the same numbers from the latest beginning to
        the earliest end. For parts of a frame, joints are moved in a straight line towards their place in the
        next or previous frame; those that it lacks, or that jump, stay. Cameras may be written as loosely as
        their folders: ``cam2`` for ``cam_02``. In place of the `clocks` of a `CameraRig`, which are taken
        off otherwise.
    fps : float or dict, optional
        Frames per second of all cameras, or by camera; by default as the files state them. Where they differ,
        the frames of the result are those of the slowest camera, and the joints of others are moved as for
        parts of a frame; offsets and `clocks` are in frames of their camera.
    order : sequence of str or "sorted", optional
        The folder, file, or place in the file of each camera, in the order of `cameras`, instead of matching
        by name, written as loosely. ``"sorted"``: the first in natural order belongs to the first camera.
    mapping : dict, optional
        Where names or places differ: joint of the layout → name in the file, or place in it from 0, or None
        for a joint that the file lacks.
    sequence : str, optional
        Which sequence of a file that has several (VideoPose3D): ``"S9/Directions 1"``.
    without : collection of str
        Names of `cameras` that are left out, written as loosely: their detections may be there or not, and
        `order` and `offsets` may name them or not.

    Returns
    -------
    DetectionSet
        ``people`` (T, M, P, N, 3), P the largest number of people in any image (at least 1).

    Raises
    ------
    InvalidInputError
        If an argument is unknown, or `layout` is missing (the message names those that fit).
    DatasetError
        If a folder or file is missing, malformed, without frames, or fits no camera; names it and the field.
    MissingPackageError
        If the format needs a package that is not installed.
    """
    return open_detections(
        path,
        cameras,
        layout=layout,
        format=format,
        frames=frames,
        offsets=offsets,
        fps=fps,
        order=order,
        mapping=mapping,
        sequence=sequence,
        without=without,
    ).read()


def camera_labels(
    path: str | os.PathLike[str], *, format: str | None = None, sequence: str | None = None
) -> dict[str, str]:
    """Return the cameras that detections name: name → folder, file or place in the file, in natural order."""
    root = Path(path)
    with within_memory(root):
        there, _ = offered(root, find_format(root, format), sequence)
    return _by_name(there)


def sights(
    path: str | os.PathLike[str], *, format: str | None = None, sequence: str | None = None
) -> dict[str, View]:
    """Return what each camera saw that detections name, whether or not a layout and frames fit."""
    root = Path(path)
    with within_memory(root):
        there, read = offered(root, find_format(root, format), sequence)
        return dict(read(_by_name(there)))


def _by_name(there: Candidates) -> dict[str, str]:
    labels = sorted(there.busy, key=natural)
    names = {there.texts[label].removesuffix("_json"): label for label in labels}
    return names if len(names) == len(labels) else {label: label for label in labels}


def open_detections(
    path: str | os.PathLike[str],
    cameras: sk.CameraRig | Sequence[sk.Camera] | Sequence[str],
    *,
    layout: str | os.PathLike[str] | sk.Layout | None = None,
    format: str | None = None,
    frames: FrameMode = "strict",
    offsets: Mapping[str, float] | None = None,
    fps: Rates = None,
    order: str | Sequence[str] | None = None,
    mapping: Mapping[str, str | int | None] | None = None,
    sequence: str | None = None,
    without: Collection[str] = (),
    unread: Collection[str] = (),
    rates_of: Callable[[Mapping[str, View]], Mapping[str, float]] = lambda _: {},
) -> Opened:
    """Open the detections of all cameras to read them in stretches; parameters as of `read_detections`.

    Cameras that are ``unread`` are left out as well: the calibration has them, but they could not be read.
    Those that only the detections have are left out by their names there. ``rates_of`` tells the frame rates
    of videos if nothing else does.
    """
    one_of("frames", frames, FRAME_MODES)
    names = [*_camera_names(cameras, ordered=order is not None), *unread]
    shifts = check_offsets(offsets, names, cameras.clocks if isinstance(cameras, sk.CameraRig) else {})
    root, advice = Path(path), "without= leaves out cameras"
    with within_memory(root):
        form = find_format(root, format)
        there, read = offered(root, form, sequence)
        if order is None:
            texts = there.texts.values()
            names += [one for one in without if is_among(one, texts) and not is_among(one, names)]
        left_out = (*cameras_called(without, names, "without"), *unread)
        kept = tuple(name for name in names if name not in left_out)
        if order is None:
            labels = match_by_name(there, names, optional=left_out, otherwise=advice)
        else:
            labels = match_by_order(there, names, order, left_out=left_out, otherwise=advice)
        labels = {name: labels[name] for name in kept}
        sizes = {
            name: one.size for name, one in zip(names, cameras, strict=False) if isinstance(one, sk.Camera)
        }
        views = {name: view.in_pixels(sizes.get(name)) for name, view in read(labels).items()}
        rates, stated = check_rates(fps, names, views, rates_of)
        clocks = clocks_of(views, shifts, rates)
        numbers = shared_frames(root, there.kind, views, labels, frames, clocks)
        chosen = choose_layout(layout, views.values(), root, form.name)
    joints = check_mapping(mapping, chosen)
    return Opened(root, views, labels, numbers, shifts, clocks, rates, stated, chosen, joints, form.name)


def _camera_names(cameras: Sequence[sk.Camera] | Sequence[str], *, ordered: bool) -> list[str]:
    """Names of the cameras; in a stated order those without one are called by their number."""
    names = [camera if isinstance(camera, str) else camera.name for camera in cameras]
    names = [name or str(place) for place, name in enumerate(names)] if ordered else names
    named = [name for name in names if name]
    if isinstance(cameras, str) or not named or len(set(named)) < len(names):
        raise InvalidInputError(f"cameras: expected cameras with different names, got {names}")
    return named
