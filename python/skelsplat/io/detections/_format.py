"""What a format of detections is, and what its reader hands over before joints and cameras are matched."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skelsplat._arrays import FARTHEST, Array, Index
from skelsplat._skelsplat import HIGHEST_CONFIDENCE
from skelsplat.exceptions import DatasetError


@dataclass(frozen=True)
class View:
    """What one camera saw."""

    path: Path  # the file, or the folder of a format with a file per frame
    frames: Index  # ascending
    # from ascending places in `frames` to the people in each; may read files. A person's joints (K, 3) are x,
    # y in px and confidence in (0, 1], NaN where one was not detected; of nobody in a place, K = 0
    people: Callable[[Index], Iterable[Iterable[Array]]]
    joints: tuple[str, ...] | None = None  # names of the K joints, if the format has them
    edges: tuple[tuple[int, int], ...] = ()  # places of joints that the file connects
    # the names confirm a fixed order (MMPose); otherwise they alone say what a joint is (DeepLabCut, SLEAP)
    own_order: bool = False
    sparse: bool = False  # frames in which nobody was found are not listed
    rate: float | None = None  # frames per second, if the file states it
    size: tuple[int, int] | None = None  # width and height of the images, if the file states them
    fractions: bool = False  # x and y are parts of the image's width and height

    def in_pixels(self, size: tuple[int, int] | None) -> View:
        """Return the view in pixels of images of this size, if it is known."""
        if not self.fractions or size is None:
            return self

        def people(places: Index) -> Iterable[Iterable[Array]]:
            frames = self.people(places)
            return ([one * [*size, 1.0] for one in frame] for frame in frames)

        return replace(self, people=people, fractions=False)


class Recording(NamedTuple):
    """All views in one file, by label: the camera's name if `named`, else only the place in the file."""

    views: Mapping[str, View]
    named: bool


@dataclass(frozen=True)
class DetectionFormat:
    """A registered format; of `files`, `folder` and `recording` there are those in which it comes."""

    name: str
    suffixes: tuple[str, ...]
    matches: Callable[[Path], bool]  # by a look at a file's beginning; never raises
    # read the one file of each camera; the folder of one, with a file per frame; one file of all cameras, of
    # which the second argument names a sequence, or is None
    files: Callable[[Mapping[str, Path]], Mapping[str, View]] | None = None
    folder: Callable[[Path], View] | None = None
    recording: Callable[[Path, str | None], Recording] | None = None
    sequences: bool = False  # a recording may have several
    added: str | None = None  # regular expression for what the tool adds to a camera's name in that of a file

    def camera_part(self, stem: str) -> str:
        """Return the stem of a file's name without what the tool added."""
        return re.sub(self.added, "", stem) or stem if self.added else stem


def each(read: Callable[[Path], View]) -> Callable[[Mapping[str, Path]], Mapping[str, View]]:
    """Return what reads the files of all cameras one by one."""
    return lambda paths: {camera: read(path) for camera, path in paths.items()}


# what other programs call the confidence
_OTHER_NAMES = frozenset(("conf", "confidences", "likelihood", "prob", "probability", "score", "scores"))
# pixels of a view that nearly all lie within this are parts of the image's size; joints may be beyond it
NORMALISED, NEARLY_ALL = 1.5, 0.9
# no map's peak on average, but a percentage
_PERCENT = 20.0


def refuse_other_names(path: Path, field: str, names: Iterable[str]) -> None:
    """Raise `DatasetError` if there seem to be confidences under another name: without any, all are sure."""
    odd = sorted(name for name in names if name.lower() in _OTHER_NAMES)
    if odd:
        raise DatasetError(path, field, "confidences under the name confidence, or none", odd[0])


def joints_of(
    path: Path, where: str, xy: Array, confidence: Array | None, *, clip: bool, first: int = 0
) -> Array:
    """Join pixels (…, 2) and confidence (…) to (…, 3) with NaN for missing; rows count from ``first``.

    A joint without finite pixels or confidence, or with a confidence of 0, is missing; one slightly above 1
    counts as 1. With `clip`, any score above 1 does, and one below 0 as missing: maxima of heat maps and
    SimCC are no probabilities. Without pixels a confidence does not count, whatever it is.
    """
    if np.isinf(xy).any():
        raise DatasetError(path, where, "pixels, NaN for missing", "an infinite number")
    placed = np.isfinite(xy).all(axis=-1)
    sure = np.ones(xy.shape[:-1]) if confidence is None else np.array(confidence, dtype=np.float64)
    if clip:
        scores = sure[placed & np.isfinite(sure)]
        median = np.median(np.minimum(scores, FARTHEST)) if scores.size else 0.0
        if median > _PERCENT:
            actual = f"a median of {median:.3g}; divide percentages by 100"
            raise DatasetError(path, where, "confidences in [0, 1]", actual)
        sure = np.clip(sure, 0.0, 1.0)
    sure[(sure > 1.0) & (sure <= HIGHEST_CONFIDENCE)] = 1.0
    wrong = ((sure < 0.0) | (sure > 1.0)) & placed
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        shown = [first + place[0], *place[1:]]
        raise DatasetError(path, f"{where}{shown}", "a confidence in [0, 1]", f"{sure[place]:g}")
    joined = np.concatenate([xy, sure[..., None]], axis=-1)
    joined[~np.isfinite(joined).all(axis=-1) | (sure == 0.0)] = np.nan
    return joined


def rows_view(path: Path, frames: Index, read: Callable[[int, int], Array]) -> View:
    """Return the view of arrays (t, P, K, 3), which are read from a first to before an end."""

    def people(places: Index) -> Iterable[Array]:
        return read(int(places[0]), int(places[-1]) + 1)[places - places[0]] if len(places) else ()

    return View(path, frames, people)


def array_view(path: Path, people: Array, frames: Index | None = None) -> View:
    """Return the view of an array (T, P, K, 3); frames count from 0 unless given."""
    return View(path, np.arange(len(people)) if frames is None else frames, people.__getitem__)


def frame_view(path: Path, frames: Iterable[int], read: Callable[[int], Iterable[Array]]) -> View:
    """Return the view of people who are read, or looked up, by the number of their frame."""
    numbers = np.array(sorted(frames), dtype=np.int64)
    return View(path, numbers, lambda places: [read(number) for number in numbers[places].tolist()])
