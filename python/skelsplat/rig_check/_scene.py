"""Cameras, the people by whose detections they are judged, and how well the cameras agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, median, medians
from skelsplat._who import GAP
from skelsplat.association import choose_person, extents, separate_people, take_people
from skelsplat.cameras import altered

_FRAMES = 120  # frames that are judged, spread over the recording; more tell nothing new
_FEW_FRAMES = 30  # frames on which whole rigs are compared
POOR = 0.012  # of the diagonal, 20 px of 1200 by 1200: poor detections are off so much
_LOST = 0.2  # a camera in which the chosen person is found in fewer frames is judged by whoever is there
_THREE = 3  # views: whom only two see may be a chance meeting of rays
_LEAST_FRAMES = 12  # someone seen in fewer frames tells nothing


@dataclass(frozen=True)
class Scene:
    """What a hypothesis changes: cameras in mm, and detections."""

    cameras: tuple[sk.Camera, ...]
    detections: Array  # (T, M, N, 2) pixels of all frames; NaN where missing
    frames: Index  # (T,) ascending
    shifts: tuple[int, ...]  # frame f of the scene is frame f + shift of a camera's own count

    @property
    def names(self) -> list[str]:
        """Names of the cameras."""
        return [str(camera.name) for camera in self.cameras]

    @cached_property
    def judged(self) -> Index:
        """Places in `frames` that are judged."""
        return some_frames(len(self.frames), _FRAMES)

    def seen(self, view: int, shift: int | None = None) -> Array:
        """Return one camera's detections at the judged frames, with its shift or another, (J, N, 2)."""
        wanted = self.frames[self.judged] + (self.shifts[view] if shift is None else shift)
        place = np.searchsorted(self.frames, wanted).clip(max=len(self.frames) - 1)
        there = self.frames[place] == wanted
        return np.where(there[:, None, None], self.detections[place, view], np.nan)

    @cached_property
    def judged_detections(self) -> Array:
        """Detections at the judged frames, shifts applied, (J, M, N, 2)."""
        return np.stack([self.seen(view) for view in range(len(self.cameras))], axis=1)

    @cached_property
    def _points(self) -> dict[int, Array]:
        """What `points_without` has returned, by view."""
        return {}

    def points_without(self, view: int) -> Array:
        """Triangulate the judged frames robustly without one camera, (J, N, 3) mm; NaN where unknown."""
        if view not in self._points:
            others = [i for i in range(len(self.cameras)) if i != view]
            cameras = [self.cameras[i] for i in others]
            self._points[view] = np.asarray(sk.triangulate(self.judged_detections[:, others], cameras))
        return self._points[view]

    @cached_property
    def _between(self) -> Array:
        """Points between all cameras, by plain triangulation, (J, N, 3) mm."""
        return np.asarray(sk.triangulate(self.judged_detections, self.cameras, method="dlt"))

    def residuals(self, view: int) -> Array:
        """Distances of detections from where the others, or both of two, place the joints, (J, N) px."""
        return self.distances(view, self._between if len(self.cameras) == 2 else self.points_without(view))

    @cached_property
    def left_out(self) -> Array:
        """Medians of `residuals`, (M,) px."""
        return np.array([median(self.residuals(view)) for view in range(len(self.cameras))])

    @cached_property
    def disagreement(self) -> float:
        """Mean of `left_out` over the cameras that have anything in common with others, px, or ∞."""
        known = self.left_out[np.isfinite(self.left_out)]
        return float(known.mean()) if known.size else float("inf")

    def distances(self, view: int, points: Array, shift: int | None = None) -> Array:
        """Distances (J, N) of a camera's detections from projected points (J, N, 3), px."""
        pixels = np.asarray(sk.project(points, [self.cameras[view]]))[0]
        seen = self.seen(view, shift)
        offset: Array = np.linalg.norm(seen - pixels, axis=-1)
        # a point behind the camera that the camera sees is as wrong as can be
        behind = np.isnan(pixels[..., 0]) & np.isfinite(points[..., 0]) & np.isfinite(seen[..., 0])
        return np.where(behind, np.hypot(*self.cameras[view].size), offset)

    @property
    def gross_px(self) -> float:
        """The mean disagreement in px from which a search is worth it: more than that of poor detections."""
        return POOR * float(np.mean([np.hypot(*camera.size) for camera in self.cameras]))

    @property
    def is_gross(self) -> bool:
        """Whether the cameras disagree by more than poor detections do."""
        return bool(self.disagreement > self.gross_px)

    def changed(
        self,
        view: int,
        *,
        camera: sk.Camera | None = None,
        seen: Array | None = None,
        shift: int | None = None,
    ) -> Scene:
        """Return the scene with one camera, its detections (T, N, 2) or its count of frames exchanged."""
        cameras, detections, shifts = list(self.cameras), self.detections, list(self.shifts)
        if camera is not None:
            cameras[view] = camera
        if seen is not None:
            detections = detections.copy()
            detections[:, view] = seen
        if shift is not None:
            shifts[view] = shift
        scene = Scene(tuple(cameras), detections, self.frames, tuple(shifts))
        if view in self._points:  # without this camera the points stay what they are
            scene._points[view] = self._points[view]
        return scene


def in_mm(rig: sk.CameraRig) -> tuple[sk.Camera, ...]:
    """Cameras of a rig with lengths in mm, and with names."""
    named = zip(rig, rig.names, strict=True)
    return tuple(altered(one, t=np.asarray(one.t) * rig.mm_per_unit, name=name) for one, name in named)


def scene_of(cameras: Sequence[sk.Camera], detections: Array, frames: Index) -> Scene:
    """Return the scene of cameras that all count frames alike."""
    return Scene(tuple(cameras), detections, frames, (0,) * len(cameras))


def some_frames(count: int, most: int = _FEW_FRAMES) -> Index:
    """Places of a few frames, spread over the recording."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))


def judge(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Scene:
    """Return the scene of the person that is followed."""
    return scene_of(cameras, follow_person(cameras, people, layout)[..., :2], np.arange(len(people)))


def follow_person(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Array:
    """Return one person (T, M, N, 2 | 3); in a view that hardly sees them, perhaps wrong, who looks alike."""
    if people.shape[2] == 1 or len(cameras) < 2:
        return people[:, :, 0]
    chosen, index = choose_person(people, cameras, layout=layout)
    lost = _is_lost(people, index)
    if not lost.any():
        return chosen
    pixels = np.moveaxis(sk.project(sk.triangulate(chosen, cameras, method="dlt"), cameras), 0, 1)
    unlike = _unlike(people[..., :2], pixels[:, :, None])
    largest = extents(people).argmax(axis=2)
    alike = np.where(np.isfinite(unlike).any(axis=2), unlike.argmin(axis=2), largest)
    return np.where(lost[None, :, None, None], take_people(people, alike), chosen)


def _unlike(people: Array, pixels: Array) -> Array:
    """Return how much shapes in the image differ, wherever they are, (T, M, P) px; inf where unknown."""
    apart = people - pixels
    apart -= medians(np.moveaxis(apart, -1, -2))[..., None, :]
    return np.nan_to_num(medians(np.hypot(apart[..., 0], apart[..., 1])), nan=np.inf)


def _is_lost(people: Array, index: Index) -> Array:
    """Return the cameras (M,) that see people, but hardly ever this one."""
    there = np.isfinite(people[..., 0]).any(axis=(2, 3))
    lost: Array = (index >= 0).sum(axis=0) / np.maximum(there.sum(axis=0), 1) < _LOST
    return lost


def several(cameras: Sequence[sk.Camera], people: Array) -> bool:
    """Whether there are several people (T, M, P, N, 2 | 3) to be told apart, by more than two cameras."""
    return people.shape[2] > 1 and len(cameras) >= _THREE


def everybody(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[tuple[Array, ...], bool]:
    """Return everybody (T, M, N, 2 | 3) whom three views see, and whether one hardly sees the first."""
    index = separate_people(people, cameras, layout=layout)
    sure = np.where((index >= 0).sum(axis=2, keepdims=True) >= _THREE, index, -1)
    often = [one for one in sure[1:] if (one >= 0).any(axis=1).sum() >= _LEAST_FRAMES]
    found = tuple(take_people(people, one) for one in (index[0], *often))
    return found, bool(_is_lost(people, index[0]).any())


def followed(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> tuple[Array, ...]:
    """Return `everybody`; only `follow_person` if a camera, maybe a wrong one, hardly sees the first."""
    if several(cameras, people):
        found, lost = everybody(cameras, people, layout)
        if not lost:
            return found
    return (follow_person(cameras, people, layout),)


def scene_of_everybody(
    cameras: Sequence[sk.Camera], people: Array, frames: Index, layout: sk.Layout | None
) -> Scene:
    """Return the scene of everybody who is `followed`, one after another."""
    everyone = followed(cameras, people, layout)
    span = int(frames[-1] - frames[0]) + GAP
    numbers = np.concatenate([frames + k * span for k in range(len(everyone))])
    return scene_of(cameras, np.concatenate(everyone)[..., :2], numbers)
