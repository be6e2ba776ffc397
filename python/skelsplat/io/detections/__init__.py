"""2D detections: one reader for all tools' files, found by content or by name, to one `DetectionSet`.

A format is a look at a file's beginning and readers from a folder or file of one camera, or from a file of
all, to views: functions and a row in `FORMATS`. Cameras, frames, joints and missing values are the same for
all and live here. What is wrong with a file is a `DatasetError` with its path and field, what is wrong with
an argument an `InvalidInputError`.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io.detections._format import View
from skelsplat.io.detections._frames import FRAME_MODES, FrameMode, check_offsets
from skelsplat.io.detections._joints import arranged, check_mapping, places_of
from skelsplat.io.detections._layout import choose_layout, read_layout
from skelsplat.io.detections._match import camera_called, cameras_called
from skelsplat.io.detections._registry import FORMATS, Matching, find_format, open_sources
from skelsplat.io.detections._skeleton import Skeleton, read_skeleton

__all__ = [
    "FORMATS",
    "DetectionSet",
    "Skeleton",
    "camera_called",
    "cameras_called",
    "read_detections",
    "read_layout",
    "read_openpose",
    "read_skeleton",
]

# pixels of a whole view that all lie within this are parts of the image's size
_NORMALISED = 1.5


@dataclass(frozen=True)
class DetectionSet:
    """All people found in all frames of all cameras.

    Attributes
    ----------
    people : (T, M, P, K, 3)
        x and y in pixels of the original image, confidence in [0, 1]. NaN: a joint that was not detected,
        also one at exactly (0, 0) if a camera has several, and a place in P where nobody stands. The order of
        people in a frame is the detector's: place p is nobody's identity.
    frames : (T,) int
        Frame numbers, ascending.
    camera_names : tuple of str
        The M cameras, in the order they were asked for.
    sources : tuple of Path or None
        The folder or file of each camera; None for a camera without detections.
    layout : str
        Name of the joint layout of the K joints.
    skeleton : Layout
        The layout itself, which may be that of a file.
    format : str
        Name of the format that they were read from.
    labels : tuple of str or None
        The folder, file or place in the file of each camera, as ``order`` of `read_detections` takes it.
    uneven : bool
        Cameras have different frames in the files, which ``frames="strict"`` refuses.
    frame_rate : float or None
        Frames per second, if the files state one, the same for all cameras.
    """

    people: npt.NDArray[np.float64]
    frames: Index
    camera_names: tuple[str, ...]
    sources: tuple[Path | None, ...]
    layout: str
    skeleton: sk.Layout
    format: str = ""
    labels: tuple[str | None, ...] = ()
    uneven: bool = False
    frame_rate: float | None = None

    @property
    def people_per_frame(self) -> Index:
        """Number of people with at least one joint, (T, M)."""
        there = np.isfinite(self.people[..., 0]).any(axis=-1)
        count: Index = there.sum(axis=-1, dtype=np.int64)
        return count


def read_detections(
    path: str | os.PathLike[str],
    cameras: sk.CameraRig | Sequence[sk.Camera] | Sequence[str],
    *,
    layout: str | os.PathLike[str] | sk.Layout | None = None,
    format: str | None = None,
    frames: FrameMode = "strict",
    offsets: Mapping[str, int] | None = None,
    order: str | Sequence[str] | None = None,
    mapping: Mapping[str, str | int | None] | None = None,
    sequence: str | None = None,
    allow_missing: bool = False,
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
        left out only if the files name exactly the joints of one built-in layout, or the number of joints is
        that of one detector alone (21, 33, 133, 136); other counts do not say which they are.
    format : str, optional
        A key of `FORMATS`; found from the files when left out.
    frames : {"strict", "intersection", "union"}
        ``strict`` asks for the same frame numbers for all cameras, ``intersection`` reads those that all
        have, ``union`` reads every frame and leaves gaps as missing detections. AlphaPose, COCO and plain csv
        do not list frames without people; there ``strict`` reads every frame that is listed for any camera.
    offsets : dict, optional
        By camera, frames to add to its numbers: ``{"cam2": 3}`` if that camera started 3 frames late. The
        frame numbers of the result count in the common time, in which ``strict`` asks for the same numbers
        from the latest beginning to the earliest end, and reads these. Cameras may be written as
        loosely as their folders: ``cam2`` for ``cam_02``.
    order : sequence of str or "sorted", optional
        The folder, file, or place in the file of each camera, in the order of `cameras`, instead of matching
        by name, written as loosely. ``"sorted"``: the first in natural order belongs to the first camera.
    mapping : dict, optional
        Where names or places differ: joint of the layout → name in the file, or place in it from 0, or None
        for a joint that the file lacks.
    sequence : str, optional
        Which sequence of a file that has several (VideoPose3D): ``"S9/Directions 1"``.
    allow_missing : bool
        Accept cameras without detections; theirs are missing.
    without : collection of str
        Names of `cameras` that are left out, written as loosely as in `offsets`: their detections may be
        there or not, are not read, and have no place in the result. `order` and `offsets` may name them or
        not.

    Returns
    -------
    DetectionSet
        ``people`` (T, M, P, N, 3), P the largest number of people in any image (at least 1).

    Raises
    ------
    InvalidInputError
        If `layout` is missing or does not decide (the message names those that fit), or another argument is
        unknown.
    DatasetError
        If a folder or file is missing, malformed, or fits no camera; names the file and the field.
    MissingPackageError
        If the format needs a package that is not installed.
    """
    one_of("frames", frames, FRAME_MODES)
    names = _camera_names(cameras, ordered=order is not None)
    shifts = check_offsets(offsets, names)
    left_out = cameras_called(without, names, "without")
    root = Path(path)
    form = find_format(root, format)
    sources = open_sources(root, form, Matching(names, order, allow_missing, left_out), sequence)
    names = [name for name in names if name not in left_out]
    numbers = sources.shared(frames, shifts)
    chosen = choose_layout(layout, sources.views.values(), root)
    joints = check_mapping(mapping, chosen)
    read = {
        name: _read_view(view, numbers - shifts[name], chosen, joints) for name, view in sources.views.items()
    }
    rates = {view.rate for view in sources.views.values()}
    return DetectionSet(
        people=_stack([read.get(name, []) for name in names], len(numbers), chosen.n_joints),
        frames=numbers,
        camera_names=tuple(names),
        sources=tuple(sources.views[name].path if name in sources.views else None for name in names),
        layout=chosen.name,
        skeleton=chosen,
        format=form.name,
        labels=tuple(sources.labels[name] for name in names),
        uneven=sources.uneven,
        frame_rate=rates.pop() if len(rates) == 1 else None,
    )


def read_openpose(
    folder: str | os.PathLike[str],
    cameras: sk.CameraRig | Sequence[sk.Camera] | Sequence[str],
    *,
    layout: str | os.PathLike[str] | sk.Layout | None = None,
    frames: FrameMode = "strict",
    allow_missing: bool = False,
) -> DetectionSet:
    """Read OpenPose folders: `read_detections` with ``format="openpose"``."""
    rest: dict[str, Any] = {"layout": layout, "frames": frames, "allow_missing": allow_missing}
    return read_detections(folder, cameras, format="openpose", **rest)


def _camera_names(cameras: Sequence[sk.Camera] | Sequence[str], *, ordered: bool) -> list[str]:
    """Names of the cameras; in a stated order those without one are called by their number."""
    names = [camera if isinstance(camera, str) else camera.name for camera in cameras]
    if ordered:
        names = [name or str(place) for place, name in enumerate(names)]
    named = [name for name in names if name]
    if isinstance(cameras, str) or not named or len(set(named)) < len(names):
        raise InvalidInputError(f"cameras: expected cameras with different names, got {names}")
    return named


def _read_view(
    view: View, numbers: Index, layout: sk.Layout, mapping: Mapping[str, str | int | None]
) -> list[list[Array]]:
    """People (N, 3) of each of the camera's own frame numbers; nobody in a frame that it lacks."""
    places = places_of(view, layout, mapping)
    there = set(view.frames)
    read = [
        [arranged(person, layout, places, flat=view.flat) for person in view.people(number)]
        if number in there
        else []
        for number in numbers.tolist()
    ]
    everybody = [person for people in read for person in people]
    _check_pixels(view, everybody)
    _forget_zeros(everybody)
    return read


def _check_pixels(view: View, people: Sequence[Array]) -> None:
    """Raise if the view's coordinates are parts of the image's size instead of pixels."""
    if not people:
        return
    points = np.concatenate(people)[:, :2]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) > 1 and np.abs(points).max() <= _NORMALISED:
        actual = f"numbers from {points.min():.3g} to {points.max():.3g}, parts of the image's size"
        raise DatasetError(view.path, "keypoints", "pixels of the original image", actual)


def _forget_zeros(people: Sequence[Array]) -> None:
    """Make the joints of a camera that are at exactly (0, 0) missing, unless there is only one.

    YOLO writes so what it did not detect, with a confidence.
    """
    zeros = [(person[:, :2] == 0.0).all(axis=1) for person in people]
    if sum(int(zero.sum()) for zero in zeros) > 1:
        for person, zero in zip(people, zeros, strict=True):
            person[zero] = np.nan


def _stack(views: Sequence[Sequence[Sequence[Array]]], steps: int, n_joints: int) -> Array:
    """Join the views to (T, M, P, N, 3), padded with NaN."""
    places = max([1, *(len(people) for view in views for people in view)])
    stacked = np.full((steps, len(views), places, n_joints, 3), np.nan)
    for m, view in enumerate(views):
        for t, people in enumerate(view):
            for p, person in enumerate(people):
                stacked[t, m, p] = person
    return stacked
