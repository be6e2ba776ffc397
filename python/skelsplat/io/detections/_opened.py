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
from skelsplat.io.detections._format import View
from skelsplat.io.detections._frames import is_uneven
from skelsplat.io.detections._joints import Joint, arranged, places_of

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
    sources : tuple of Path
        The folder or file of each camera.
    layout : str
        Name of the joint layout of the K joints.
    skeleton : Layout
        The layout itself, which may be that of a file.
    format : str
        Name of the format that they were read from.
    labels : tuple of str
        The folder, file or place in the file of each camera, as ``order`` of `read_detections` takes it.
    uneven : bool
        Cameras have different frames in the files, which ``frames="strict"`` refuses.
    frame_rate : float or None
        Frames per second, if files state them, the same for all of their cameras.
    """

    people: npt.NDArray[np.float64] = field(repr=False)
    frames: Index = field(repr=False)
    camera_names: tuple[str, ...]
    sources: tuple[Path, ...] = field(repr=False)
    layout: str
    skeleton: sk.Layout = field(repr=False)
    format: str = ""
    labels: tuple[str, ...] = ()
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

    root: Path
    views: Mapping[str, View]  # by camera
    matched: Mapping[str, str]  # by camera, its folder, file or place in the file
    frames: Index
    offsets: Mapping[str, float]  # by camera, what was added to its frame numbers
    skeleton: sk.Layout
    mapping: Mapping[str, Joint]  # as of `read_detections`
    format: str
    # by camera, (2,) pixels that are read per pixel of its images; 1 for the others
    factors: Mapping[str, Array] = field(default_factory=dict)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """As of `DetectionSet`."""
        return tuple(self.views)

    @property
    def sources(self) -> tuple[Path, ...]:
        """As of `DetectionSet`."""
        return tuple(view.path for view in self.views.values())

    @property
    def labels(self) -> tuple[str, ...]:
        """As of `DetectionSet`."""
        return tuple(self.matched.values())

    @property
    def uneven(self) -> bool:
        """As of `DetectionSet`."""
        return is_uneven(self.views)

    @property
    def rates(self) -> dict[str, float]:
        """Frames per second, by camera, where the files state them."""
        return {name: view.rate for name, view in self.views.items() if view.rate is not None}

    @property
    def sizes(self) -> dict[str, tuple[int, int]]:
        """Width and height of the images, by camera, where the files state them."""
        return {name: view.size for name, view in self.views.items() if view.size is not None}

    def read(self) -> DetectionSet:
        """Read everything."""
        with within_memory(self.root):
            read: dict[str, list[list[Array]]] = {name: [] for name in self.views}
            for _, part in self._parts(_STRETCH):  # of a file of all cameras each part is read once
                for name, people in part.items():
                    read[name] += people
            for people in read.values():
                _forget_zeros([person for one in people for person in one])
            stacked = self._resized(self._stack(read, len(self.frames)))
        return DetectionSet(
            people=stacked,
            frames=self.frames,
            camera_names=self.camera_names,
            sources=self.sources,
            layout=self.skeleton.name,
            skeleton=self.skeleton,
            format=self.format,
            labels=self.labels,
            uneven=self.uneven,
            frame_rate=one_rate(self.rates),
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
        readers = {
            name: _Reader(view, self.skeleton, self.mapping, self.offsets[name])
            for name, view in self.views.items()
        }
        for first in range(0, len(self.frames), size):
            numbers = self.frames[first : first + size]
            yield len(numbers), {name: reader.read(numbers) for name, reader in readers.items()}
        for reader in readers.values():
            reader.check()

    def _stack(self, read: Mapping[str, Sequence[Sequence[Array]]], steps: int) -> Array:
        """Join the views to (T, M, P, N, 3), padded with NaN."""
        views = [read[name] for name in self.camera_names]
        places = max([1, *(len(people) for view in views for people in view)])
        afford(self.root, "people", 24 * steps * len(views) * places * self.skeleton.n_joints)
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


class _Reader:
    """Reads a view in stretches of frames, and judges whether its coordinates are pixels."""

    def __init__(self, view: View, skeleton: sk.Layout, mapping: Mapping[str, Joint], offset: float) -> None:
        self._view, self._skeleton = view, skeleton
        self._places = places_of(view, skeleton, mapping)
        self._whole, self._rest = parted(offset)
        self._least, self._most = np.inf, -np.inf
        self._count, self._near, self._zeros = 0, 0, 0  # all, those within `_NORMALISED`, those at (0, 0)

    def read(self, numbers: Index) -> list[list[Array]]:
        """People (N, 3) of each frame number in common time; nobody in a frame that the camera lacks."""
        own = numbers - self._whole
        found = self._between(own) if self._rest else self._people(own)
        self._look_at([person for people in found for person in people])
        return found

    def _between(self, own: Index) -> list[list[Array]]:
        """People between each frame and the one beside it, on the side of the rest; else its own."""
        known = self._view.frames
        step = int(np.diff(known).min(initial=_FAR))
        beside = own - step if self._rest > 0 else own + step
        beside = np.where(np.isin(beside, known), beside, own)
        wanted = np.union1d(own, beside)
        read = dict(zip(wanted.tolist(), self._people(wanted), strict=True))
        pairs = zip(own.tolist(), beside.tolist(), strict=True)
        return [between(read[a], read[b], abs(self._rest / (b - a))) if a != b else read[a] for a, b in pairs]

    def _people(self, own: Index) -> list[list[Array]]:
        known = self._view.frames
        places = np.searchsorted(known, own)
        there = np.isin(own, known)
        found = iter(self._view.people(places[there]))
        return [
            [arranged(person, self._skeleton, self._places) for person in next(found)] if is_there else []
            for is_there in there.tolist()
        ]

    def _look_at(self, people: Sequence[Array]) -> None:
        """Count the coordinates of further people; raise if one is beyond `FARTHEST`."""
        if not people:
            return
        points = np.concatenate(people)[:, :2]
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
        """Raise if the coordinates are parts of the image's size instead of pixels."""
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
