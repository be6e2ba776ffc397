"""The detections of all cameras, opened: read at once or in stretches of frames, in the layout's joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import FARTHEST, Array, Index
from skelsplat._budget import afford, within_memory
from skelsplat._clocks import between, parted
from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import Person, View
from skelsplat.io.detections._frames import Sources
from skelsplat.io.detections._joints import arranged, places_of

# pixels of a view that nearly all lie within this are parts of the image's size; joints may be beyond it
_NORMALISED, _NEARLY_ALL = 1.5, 0.9
_STRETCH = 4096  # frames
_FAR = 2**62  # frames: further than any are apart
_SAME_RATE = 5e-4  # by which videos of one recording may differ in rate; 29.97 and 30 differ by twice that


def one_rate(rates: Mapping[str, float]) -> float | None:
    """Return the frame rate that all cameras have; None if they differ or there are none."""
    known = list(rates.values())
    return known[0] if known and 0.0 < max(known) <= (1 + _SAME_RATE) * min(known) else None


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
        Frames per second, if files state them, the same for all of their cameras.
    """

    people: npt.NDArray[np.float64] = field(repr=False)
    frames: Index = field(repr=False)
    camera_names: tuple[str, ...]
    sources: tuple[Path | None, ...] = field(repr=False)
    layout: str
    skeleton: sk.Layout = field(repr=False)
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


@dataclass(frozen=True)
class Opened:
    """The opened detections of M cameras: T frames, of which the joints are read when they are asked for."""

    views: Sources
    frames: Index
    camera_names: tuple[str, ...]
    shifts: Mapping[str, float]  # by camera, what was added to its frame numbers
    skeleton: sk.Layout
    joints: Mapping[str, str | int | None]  # as ``mapping`` of `read_detections`
    format: str
    # by camera, (2,) pixels that are read per pixel of its images; 1 for the others
    factors: Mapping[str, Array] = field(default_factory=dict)

    @property
    def sources(self) -> tuple[Path | None, ...]:
        """As of `DetectionSet`."""
        views = self.views.views
        return tuple(views[name].path if name in views else None for name in self.camera_names)

    @property
    def labels(self) -> tuple[str | None, ...]:
        """As of `DetectionSet`."""
        return tuple(self.views.labels[name] for name in self.camera_names)

    @property
    def frame_rate(self) -> float | None:
        """As of `DetectionSet`."""
        return one_rate(self.rates)

    @property
    def rates(self) -> dict[str, float]:
        """Frames per second, by camera, where the files state them."""
        return {name: view.rate for name, view in self.views.views.items() if view.rate is not None}

    @property
    def sizes(self) -> dict[str, tuple[int, int]]:
        """Width and height of the images, by camera, where the files state them."""
        return {name: view.size for name, view in self.views.views.items() if view.size is not None}

    def read(self) -> DetectionSet:
        """Read everything."""
        with within_memory(self.views.root):
            return self._read()

    def _read(self) -> DetectionSet:
        read: dict[str, list[list[Array]]] = {name: [] for name in self.views.views}
        for _, part in self._parts(_STRETCH):  # of a file of all cameras each part is read once
            for name, people in part.items():
                read[name] += people
        for people in read.values():
            _forget_zeros([person for one in people for person in one])
        return DetectionSet(
            people=self._resized(self._stack(read, len(self.frames))),
            frames=self.frames,
            camera_names=self.camera_names,
            sources=self.sources,
            layout=self.skeleton.name,
            skeleton=self.skeleton,
            format=self.format,
            labels=self.labels,
            uneven=self.views.uneven,
            frame_rate=self.frame_rate,
        )

    def stretches(self, size: int) -> Iterator[Array]:
        """Read so many frames at a time, (t, M, P, N, 3), P as many as there are; at the end raise as `read`.

        A joint at exactly (0, 0) is missing, even if it is the only one of its camera.
        """
        for steps, part in self._parts(size):
            stacked = self._stack(part, steps)
            stacked[(stacked[..., :2] == 0.0).all(axis=-1)] = np.nan
            yield self._resized(stacked)

    def _parts(self, size: int) -> Iterator[tuple[int, dict[str, list[list[Array]]]]]:
        """Yield the number of frames of a part, and their people by camera; at the end raise if no pixels."""
        views = self.views.views
        whole = {name: _Pixels(view) for name, view in views.items()}
        readers = {
            name: _Reader(view, self.skeleton, self.joints, self.shifts[name]) for name, view in views.items()
        }
        for first in range(0, len(self.frames), size):
            numbers = self.frames[first : first + size]
            part = {name: reader.read(numbers) for name, reader in readers.items()}
            for name, people in part.items():
                whole[name].add(people)
            yield len(numbers), part
        for pixels in whole.values():
            pixels.check()

    def _stack(self, read: Mapping[str, Sequence[Sequence[Array]]], steps: int) -> Array:
        """Join the views to (T, M, P, N, 3), padded with NaN."""
        views = [read.get(name, []) for name in self.camera_names]
        places = max([1, *(len(people) for view in views for people in view)])
        afford(self.views.root, "people", 24 * steps * len(views) * places * self.skeleton.n_joints)
        stacked = np.full((steps, len(views), places, self.skeleton.n_joints, 3), np.nan)
        for m, view in enumerate(views):
            for t, people in enumerate(view):
                for p, person in enumerate(people):
                    stacked[t, m, p] = person
        return stacked

    def _resized(self, people: Array) -> Array:
        """Apply the `factors` to pixels (T, M, P, N, 3), in place; integers are pixel centres."""
        for name, factor in self.factors.items():
            pixels = people[:, self.camera_names.index(name), ..., :2]
            pixels[...] = (pixels + 0.5) * factor - 0.5
        return people


def _frames_of(view: View, known: Index, numbers: Index) -> list[Sequence[Person]]:
    """Return the people in each of the frame numbers, of which the camera has the ``known`` ones."""
    if not len(known):
        return [[] for _ in numbers]
    places = np.minimum(np.searchsorted(known, numbers), len(known) - 1)
    there = known[places] == numbers
    if view.stretch is None or not there.any():
        pairs = zip(numbers.tolist(), there.tolist(), strict=True)
        return [view.people(number) if known_ else [] for number, known_ in pairs]
    first, end = int(places[there][0]), int(places[there][-1]) + 1
    people = view.stretch(first, end)
    pairs = zip((places - first).tolist(), there.tolist(), strict=True)
    return [people[place] if known_ else [] for place, known_ in pairs]


class _Reader:
    """Reads a view frame after frame, each once."""

    def __init__(
        self, view: View, skeleton: sk.Layout, joints: Mapping[str, str | int | None], offset: float
    ) -> None:
        self._view, self._skeleton = view, skeleton
        self._places = places_of(view, skeleton, joints)
        self._known = np.asarray(view.frames, dtype=np.int64)
        self._whole, self._rest = parted(offset)
        # what was read last, by number: a stretch may begin beside it
        self._last: dict[int, list[Array]] = {}

    def read(self, numbers: Index) -> list[list[Array]]:
        """People (N, 3) of each frame number in common time; nobody in a frame that the camera lacks."""
        own = numbers - self._whole
        if not self._rest:
            return self._people(own)
        beside = self._beside(own)
        wanted = np.setdiff1d(np.union1d(own, beside), list(self._last))
        read = {**self._last, **dict(zip(wanted.tolist(), self._people(wanted), strict=True))}
        self._last = {number: read[number] for number in sorted(read)[-2:]}
        pairs = zip(own.tolist(), beside.tolist(), strict=True)
        return [between(read[a], read[b], abs(self._rest / (b - a))) if a != b else read[a] for a, b in pairs]

    def _beside(self, own: Index) -> Index:
        """Return the frame beside each, on the side of the offset's rest; itself where there is none."""
        step = int(np.diff(self._known).min(initial=_FAR))
        beside = own - step if self._rest > 0 else own + step
        return np.where(np.isin(beside, self._known), beside, own)

    def _people(self, own: Index) -> list[list[Array]]:
        return [
            [arranged(person, self._skeleton, self._places, flat=self._view.flat) for person in people]
            for people in _frames_of(self._view, self._known, own)
        ]


class _Pixels:
    """What the coordinates of a view, read in stretches, show: whether they are pixels."""

    def __init__(self, view: View) -> None:
        self._view, self._least, self._most = view, np.inf, -np.inf
        self._count, self._near, self._zeros = 0, 0, 0  # all, those within `_NORMALISED`, those at (0, 0)

    def add(self, people: Sequence[Sequence[Array]]) -> None:
        """Look at the people of further frames; raise if a coordinate is beyond `FARTHEST`."""
        everybody = [person for one in people for person in one]
        if everybody:
            points = np.concatenate(everybody)[:, :2]
            points = points[np.isfinite(points).all(axis=1)]
            self._count += len(points)
            self._near += int((np.abs(points) <= _NORMALISED).all(axis=1).sum())
            self._zeros += int((points == 0.0).all(axis=1).sum())
            self._least = min(self._least, points.min(initial=np.inf))
            self._most = max(self._most, points.max(initial=-np.inf))
            furthest = max(self._most, -self._least)
            if furthest > FARTHEST:
                expected = f"pixels within ±{FARTHEST:g}, or none where missing"
                raise DatasetError(self._view.path, "keypoints", expected, float(furthest))

    def check(self) -> None:
        """Raise if they are parts of the image's size instead of pixels."""
        placed, near = self._count - self._zeros, self._near - self._zeros
        if self._count > 1 and (placed == 0 or near >= max(_NEARLY_ALL * placed, 1)):
            actual = f"numbers from {self._least:.3g} to {self._most:.3g}, parts of the image's size"
            raise DatasetError(self._view.path, "keypoints", "pixels of the original image", actual)


def _forget_zeros(people: Sequence[Array]) -> None:
    """Make the joints of a camera that are at exactly (0, 0) missing, unless there is only one.

    YOLO writes so what it did not detect, with a confidence.
    """
    zeros = [(person[:, :2] == 0.0).all(axis=1) for person in people]
    if sum(int(zero.sum()) for zero in zeros) > 1:
        for person, zero in zip(people, zeros, strict=True):
            person[zero] = np.nan
