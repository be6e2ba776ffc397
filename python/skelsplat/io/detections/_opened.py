"""The detections of all cameras, opened: read at once or in stretches of frames, in the layout's joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import FARTHEST, Array, Index, Mask
from skelsplat._budget import afford, within_memory
from skelsplat._clocks import Clock, between, common_rate
from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import NEARLY_ALL, NORMALISED, View
from skelsplat.io.detections._frames import is_uneven
from skelsplat.io.detections._joints import Joint, arranged, places_of

_STRETCH = 4096  # frames


@dataclass(frozen=True)
class DetectionSet:
    """All people found in all frames of all cameras.

    Attributes
    ----------
    people : (T, M, P, K, 3)
        x and y in pixels of the original image, confidence in [0, 1]; NaN where nobody stands, or a joint was
        not detected or is at exactly (0, 0), if a camera has several. Place p is nobody's identity.
    frames : (T,) int
        Frame numbers, ascending.
    camera_names, sources : tuple of str, of Path
        The M cameras, in the order they were asked for, and the folder or file of each.
    layout, skeleton : str, Layout
        Name of the joint layout of the K joints, and the layout itself, which may be that of a file.
    format : str
        Name of the format that they were read from.
    labels : tuple of str
        The folder, file or place in the file of each camera, as ``order`` of `read_detections` takes it.
    uneven : bool
        Cameras have different frames in the files, which ``frames="strict"`` refuses.
    frame_rate : float or None
        Frames per second, as given or stated by the files; those of the slowest camera if they differ.
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
        return np.asarray(there.sum(axis=-1), dtype=np.int64)


@dataclass(frozen=True)
class Opened:
    """The opened detections of M cameras: T frames, of which the joints are read when they are asked for."""

    root: Path
    views: Mapping[str, View]  # by camera
    matched: Mapping[str, str]  # by camera, its folder, file or place in the file
    frames: Index
    offsets: Mapping[str, float]  # by camera, what was added to its frame numbers; 0 if not named
    clocks: Mapping[str, Clock]  # by camera
    rates: Mapping[str, float]  # by camera, frames per second, where they are known
    stated: str  # what states them: "files", "videos", or nothing if the user does, or if they are unknown
    skeleton: sk.Layout
    mapping: Mapping[str, Joint]  # as of `read_detections`
    format: str
    factors: Mapping[str, Array] = field(default_factory=dict)  # by camera (2,), of its pixels; else 1

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
        return is_uneven(self.views, self.clocks)

    @property
    def paces(self) -> dict[str, float]:
        """By camera, its frames in one of the recording, where it is not one."""
        return {name: clock.pace for name, clock in self.clocks.items() if clock.pace != 1.0}

    @property
    def frame_rate(self) -> float | None:
        """As of `DetectionSet`."""
        return common_rate([*self.rates.values()])[0] if self.rates else None

    @property
    def sizes(self) -> dict[str, tuple[int, int]]:
        """Width and height of the images, by camera, where the files state them."""
        return {name: view.size for name, view in self.views.items() if view.size is not None}

    def read(self) -> DetectionSet:
        """Read everything."""
        with within_memory(self.root):
            people = self._padded(list(self._parts(_STRETCH)), len(self.frames))
            zeros = (people[..., :2] == 0.0).all(axis=-1)
            # YOLO writes so what it did not detect, with a confidence; a single one may be a joint
            people[zeros & (zeros.sum(axis=(0, 2, 3)) > 1)[:, None, None]] = np.nan
        return DetectionSet(
            people=self._resized(people),
            frames=self.frames,
            camera_names=self.camera_names,
            sources=self.sources,
            layout=self.skeleton.name,
            skeleton=self.skeleton,
            format=self.format,
            labels=self.labels,
            uneven=self.uneven,
            frame_rate=self.frame_rate,
        )

    def stretches(self, size: int) -> Iterator[Array]:
        """Read so many frames at a time, (t, M, P, N, 3), P as many as there are; at the end raise as `read`.

        A joint at exactly (0, 0) is missing, even if it is the only one of its camera.
        """
        for people in self._parts(size):
            people[(people[..., :2] == 0.0).all(axis=-1)] = np.nan
            yield self._resized(people)

    def _parts(self, size: int) -> Iterator[Array]:
        """Yield the people of so many frames at a time; at the end raise if a view has no pixels."""
        cameras = self.views.items()
        readers = [_Reader(view, self.skeleton, self.mapping, self.clocks[name]) for name, view in cameras]
        counts = np.zeros((3, len(readers)), dtype=np.int64)
        for first in range(0, len(self.frames), size):
            numbers = self.frames[first : first + size]
            views = [reader.read(numbers) for reader in readers]
            most = max([1, *(len(people) for view in views for people in view)])
            people = np.full((len(numbers), len(views), most, self.skeleton.n_joints, 3), np.nan)
            for m, view in enumerate(views):
                for t, frame in enumerate(view):
                    for p, person in enumerate(frame):
                        people[t, m, p] = person
            counts += self._counted(people)
            yield people
        for source, (count, near, zeros) in zip(self.sources, counts.T.tolist(), strict=True):
            if count > 1 and (zeros == count or near - zeros >= max(NEARLY_ALL * (count - zeros), 1)):
                actual = f"numbers up to {NORMALISED:g}, parts of the image's size"
                raise DatasetError(source, "keypoints", "pixels of the original image", actual)

    def _counted(self, people: Array) -> Index:
        """Count by view joints, those within `NORMALISED` and those at (0, 0); raise if one is too far."""
        sizes = np.abs(people[..., :2]).max(axis=-1)
        if (sizes > FARTHEST).any():
            source = self.sources[np.argwhere(sizes > FARTHEST)[0][1]]
            expected = f"pixels within ±{FARTHEST:g}, or none where missing"
            raise DatasetError(source, "keypoints", expected, float(np.nanmax(sizes)))
        kinds = (np.isfinite(sizes), sizes <= NORMALISED, sizes == 0.0)
        return np.stack([kind.sum(axis=(0, 2, 3)) for kind in kinds])

    def _padded(self, parts: Sequence[Array], steps: int) -> Array:
        """Join parts of the frames to one array, of as many people as the part with the most."""
        most = max([1, *(part.shape[2] for part in parts)])
        shape = (steps, len(self.views), most, self.skeleton.n_joints, 3)
        afford(self.root, "people", 8 * math.prod(shape))
        people, first = np.full(shape, np.nan), 0
        for part in parts:
            people[first : first + len(part), :, : part.shape[2]] = part
            first += len(part)
        return people

    def _resized(self, people: Array) -> Array:
        """Apply the `factors` to pixels (T, M, P, N, 3), in place; integers are pixel centres."""
        for name, factor in self.factors.items():
            pixels = people[:, self.camera_names.index(name), ..., :2]
            pixels[...] = (pixels + 0.5) * factor - 0.5
        return people


class _Reader:
    """Reads the frames of a view by their numbers in the common time."""

    def __init__(self, view: View, skeleton: sk.Layout, mapping: Mapping[str, Joint], clock: Clock) -> None:
        self._view, self._skeleton, self._clock = view, skeleton, clock
        self._places = places_of(view, skeleton, mapping)

    def read(self, numbers: Index) -> list[list[Array]]:
        """People (N, 3) of each frame; nobody in one that the camera lacks."""
        known = self._view.frames
        there, own, beside, parts = self._clock.between(numbers, known)
        if (own == beside).all():
            return self._people(own, there)
        wanted = np.union1d(own[there], beside[there])
        read = dict(zip(wanted.tolist(), self._people(wanted, np.isin(wanted, known)), strict=True))
        pairs = zip(there.tolist(), own.tolist(), beside.tolist(), parts.tolist(), strict=True)
        return [
            (read[a] if a == b else between(read[a], read[b], part)) if has else []
            for has, a, b, part in pairs
        ]

    def _people(self, own: Index, there: Mask) -> list[list[Array]]:
        path = self._view.path
        found = iter(self._view.people(np.searchsorted(self._view.frames, own[there])))
        frames = (next(found) if known else () for known in there.tolist())
        return [[arranged(one, self._skeleton, self._places, path) for one in frame] for frame in frames]
