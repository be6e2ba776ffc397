"""Cameras and the detections of the person by whom they are judged, and how well the cameras agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, median
from skelsplat.cameras import altered

# frames that are judged, spread over the recording; more tell nothing new
_FRAMES = 120
# frames on which whole rigs are compared
_FEW_FRAMES = 30
# Share of the diagonal (20 px of 1200 by 1200) that poor detections are off; cameras that miss each other by
# more are worth a search.
POOR = 0.012


@dataclass(frozen=True)
class Scene:
    """What a hypothesis changes: cameras in mm, and detections."""

    cameras: tuple[sk.Camera, ...]
    detections: Array  # (T, M, N, 2) pixels of all frames; NaN where missing
    frames: Index  # (T,) ascending
    shifts: tuple[int, ...]  # frame f of the scene is frame f + shift of a camera's own count

    @property
    def views(self) -> int:
        """Number of cameras M."""
        return len(self.cameras)

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
        return np.stack([self.seen(view) for view in range(self.views)], axis=1)

    @cached_property
    def _points(self) -> dict[int, Array]:
        """What `points_without` has returned, by view."""
        return {}

    def points_without(self, view: int) -> Array:
        """Triangulate the judged frames robustly without one camera, (J, N, 3) mm; NaN where unknown."""
        if view not in self._points:
            self._points[view] = self._triangulated_without(view)
        return self._points[view]

    def _triangulated_without(self, view: int) -> Array:
        others = [i for i in range(self.views) if i != view]
        cameras = [self.cameras[i] for i in others]
        return np.asarray(sk.triangulate(self.judged_detections[:, others], cameras))

    @cached_property
    def residuals(self) -> Array:
        """Distances in px of each camera's detections from where the others place the joints, (M, J, N).

        One other camera does not say where a joint is: two are compared with the points between them.
        """
        if self.views == 2:
            points = np.asarray(sk.triangulate(self.judged_detections, self.cameras, method="dlt"))
            return np.stack([self.distances(view, points) for view in range(2)])
        return np.stack([self.residuals_of(view) for view in range(self.views)])

    def residuals_of(self, view: int) -> Array:
        """Return one camera's `residuals` (J, N), without computing those of the others."""
        return self.residuals[view] if self.views == 2 else self.distances(view, self.points_without(view))

    @cached_property
    def left_out(self) -> Array:
        """Medians of `residuals`, (M,) px."""
        return np.array([median(distances) for distances in self.residuals])

    def left_out_halves(self, view: int) -> tuple[float, float]:
        """Medians of one camera's `residuals` in the first and the second half of the recording, px."""
        middle, own = (len(self.judged) + 1) // 2, self.residuals_of(view)
        return median(own[:middle]), median(own[middle:])

    @cached_property
    def disagreement(self) -> float:
        """Mean of `left_out` over the cameras that have anything in common with the others, px.

        Infinite if none has.
        """
        known = self.left_out[np.isfinite(self.left_out)]
        return float(known.mean()) if known.size else float("inf")

    def error(self, view: int, points: Array, shift: int | None = None) -> float:
        """Median distance of a camera's detections from projected points, px; NaN without any in common."""
        return median(self.distances(view, points, shift))

    def distances(self, view: int, points: Array, shift: int | None = None) -> Array:
        """Distances (J, N) of a camera's detections from projected points (J, N, 3), px."""
        pixels = np.asarray(sk.project(points, [self.cameras[view]]))[0]
        offset: Array = np.linalg.norm(self.seen(view, shift) - pixels, axis=-1)
        # a point behind the camera is as wrong as can be
        behind = np.isnan(pixels[..., 0]) & np.isfinite(points[..., 0])
        return np.where(behind, np.hypot(*self.cameras[view].size), offset)

    @property
    def gross_px(self) -> float:
        """The mean disagreement in px from which a search is worth it: more than that of poor detections."""
        return POOR * float(np.mean([np.hypot(*camera.size) for camera in self.cameras]))

    @property
    def is_gross(self) -> bool:
        """Whether the cameras disagree by more than poor detections do."""
        return bool(self.disagreement > self.gross_px)

    @property
    def names(self) -> list[str]:
        """Names of the cameras."""
        return named(self.cameras)

    def with_camera(self, view: int, camera: sk.Camera) -> Scene:
        """Return the scene with one camera exchanged for another calibration of it."""
        cameras = list(self.cameras)
        cameras[view] = camera
        return self._changed(view, cameras=tuple(cameras))

    def with_detections(self, view: int, detections: Array) -> Scene:
        """Return the scene with one camera's detections (T, N, 2) exchanged."""
        changed = self.detections.copy()
        changed[:, view] = detections
        return self._changed(view, detections=changed)

    def with_shift(self, view: int, shift: int) -> Scene:
        """Return the scene with one camera's frames counted differently."""
        shifts = list(self.shifts)
        shifts[view] = shift
        return self._changed(view, shifts=tuple(shifts))

    def _changed(self, view: int, **changes: Any) -> Scene:
        """Return the scene with a change of one camera, without which the points stay what they are."""
        scene = replace(self, **changes)
        if view in self._points:
            scene._points[view] = self._points[view]
        return scene


def in_mm(rig: sk.CameraRig) -> tuple[sk.Camera, ...]:
    """Cameras of a rig with lengths in mm, and with names."""
    return tuple(
        altered(camera, t=np.asarray(camera.t) * rig.mm_per_unit, name=name)
        for camera, name in zip(rig, rig.names, strict=True)
    )


def scene_of(cameras: Sequence[sk.Camera], detections: Array, frames: Index) -> Scene:
    """Return the scene of cameras that all count frames alike."""
    return Scene(tuple(cameras), detections, frames, (0,) * len(cameras))


def named(cameras: Sequence[sk.Camera]) -> list[str]:
    """Names of cameras; their number where one has none."""
    return [camera.name if camera.name is not None else str(i) for i, camera in enumerate(cameras)]


def some_frames(count: int, most: int = _FEW_FRAMES) -> Index:
    """Places of a few frames, spread over the recording."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))
