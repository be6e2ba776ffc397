"""How far the projected truth lies from the detections: as given, and if something were exchanged."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skelsplat._arrays import median
from skelsplat._skelsplat import Camera, Layout, project
from skelsplat.cameras import CameraRig, altered
from skelsplat.datasets._model import FloatArray, Take

_FRAMES = 24
_LENS_PX = 15.0
"""Views farther off than this have another fault than the lens."""


@dataclass(frozen=True)
class Sample:
    """A few frames of a take, evenly spread."""

    take: Take
    truth: FloatArray  # (t, N, 3)
    pixels: FloatArray  # (t, M, N, 2): Detections; NaN where missing
    projected: FloatArray  # (t, M, N, 2): The truth in all views

    def error(self) -> float:
        """Median distance of truth and detections, px."""
        return median(distance(self.projected, self.pixels))

    def best_quarter(self, view: int) -> float:
        """How far the nearer quarter of a view's detections lies from the truth at most, px; NaN without any.

        Unlike the median it stays small where an occluder hides most of the person.
        """
        values = distance(self.projected[:, view], self.pixels[:, view])
        finite = values[np.isfinite(values)]
        return float(np.quantile(finite, 0.25)) if finite.size else float("nan")

    def reprojected(self, rig: CameraRig) -> Sample:
        """Return the same frames seen by other cameras."""
        return Sample(self.take, self.truth, self.pixels, seen(self.truth, rig))


def sample(take: Take) -> Sample:
    """Choose up to 24 frames of a take and project their truth."""
    chosen = np.unique(np.linspace(0, len(take) - 1, min(_FRAMES, len(take))).astype(np.int64))
    truth = np.ascontiguousarray(take.truth[chosen])
    shape = (len(chosen), len(take.rig), truth.shape[1], 2)
    pixels = np.full(shape, np.nan) if take.detections is None else take.detections[chosen][..., :2]
    return Sample(take, truth, pixels, seen(truth, take.rig))


def seen(truth: FloatArray, rig: CameraRig) -> FloatArray:
    """Project (t, N, 3) to (t, M, N, 2)."""
    return np.asarray(project(truth, rig), dtype=np.float64).swapaxes(0, 1)


def distance(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return ‖a − b‖ over the last axis."""
    return np.asarray(np.linalg.norm(a - b, axis=-1))


def exchanged_sides(layout: Layout) -> NDArray[np.int64]:
    """Return the joint order (N,) with left and right exchanged."""
    order = np.arange(layout.n_joints)
    for left, right in layout.left_right:
        order[[left, right]] = right, left
    return order


def sides(item: Sample, layout: Layout, view: int | slice = slice(None)) -> tuple[float, float]:
    """Return the median error of paired joints as given, and with left and right exchanged."""
    order = exchanged_sides(layout)
    paired = order != np.arange(len(order))
    projected, pixels = item.projected[:, view], item.pixels[:, view]
    given = median(distance(projected, pixels)[..., paired])
    return given, median(distance(projected[..., order, :], pixels)[..., paired])


def joint_distances(item: Sample) -> FloatArray:
    """Return the median distance of each projected joint from each detected one, (N, N)."""
    return _medians(distance(item.projected[..., :, None, :], item.pixels[..., None, :, :]), (0, 1))


@dataclass(frozen=True)
class ViewError:
    """Medians of a camera over all takes, px; NaN without detections."""

    camera: str
    as_given: float  # distance of the projected truth from the detections
    sides_exchanged: float  # the same with left and right exchanged, of the joints that have a side
    best_other_camera: float  # the same if the detections were those of the other camera that fits best


def view_errors(samples: list[Sample], layout: Layout) -> tuple[ViewError, ...]:
    """Return the errors of every camera, in the order of the first take that has it."""
    rows: dict[str, list[tuple[float, float, float]]] = {}
    for item in samples:
        for view, (name, distances) in enumerate(zip(item.take.rig.names, view_distances(item), strict=True)):
            others = np.delete(distances, view)
            nearest = float(np.min(others[np.isfinite(others)], initial=np.inf))
            row = (float(distances[view]), sides(item, layout, slice(view, view + 1))[1], nearest)
            rows.setdefault(name, []).append(row)
    medians = {name: [median(column) for column in np.array(values).T] for name, values in rows.items()}
    return tuple(ViewError(name, *values) for name, values in medians.items())


def view_distances(item: Sample) -> FloatArray:
    """Return the median distance of each view's detections from the projection into each camera, (M, M)."""
    return _medians(distance(item.projected[:, None, :], item.pixels[:, :, None]), (0, 3))


def mean_over(tables: list[FloatArray]) -> FloatArray:
    """Return the median of tables of the same shape, without NaN."""
    return _medians(np.stack(tables), (0,))


def _medians(values: FloatArray, axis: tuple[int, ...]) -> FloatArray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # an empty slice is NaN, which is meant
        return np.asarray(np.nanmedian(values, axis=axis))


@dataclass
class LensFit:
    """Least squares of the share s in residual = s · (other lens − given lens), summed over samples.

    s is 0 if the given lens is right and 1 if the other one is.
    """

    own: float = 0.0
    product: float = 0.0
    residual: float = 0.0
    count: int = 0

    def add(self, item: Sample, view: int, other: Callable[[Camera], Camera]) -> None:
        """Add one view of a sample."""
        camera = other(item.take.rig[view])
        changed = seen(item.truth, CameraRig([camera], item.take.rig.unit))[:, 0]
        step = changed - item.projected[:, view]
        residual = item.pixels[:, view] - item.projected[:, view]
        length = np.linalg.norm(residual, axis=-1)
        if not median(length) <= _LENS_PX:
            return
        near = length <= 3.0 * median(length) + 1e-9  # outliers say nothing about the lens
        near &= np.isfinite(step).all(axis=-1)
        self.own += float((step[near] ** 2).sum())
        self.product += float((step[near] * residual[near]).sum())
        self.residual += float((residual[near] ** 2).sum())
        self.count += 2 * int(near.sum())

    @property
    def misfit(self) -> float:
        """Sum of squared residuals of the other lens."""
        return self.residual - 2.0 * self.product + self.own

    def other_is_right(self) -> bool:
        """Whether s is nearer to 1 than to 0, by four standard errors of it."""
        if self.count < 8 or self.own <= 1e-12:
            return False
        share = self.product / self.own
        rest = max(self.residual - share * self.product, 0.0)
        return share - 4.0 * float(np.sqrt(rest / self.count / self.own)) > 0.5


def with_exchanged_tangential(camera: Camera) -> Camera:
    """Return the camera with p1 and p2 exchanged."""
    coefficients = np.array(camera.distortion)
    coefficients[[2, 3]] = coefficients[[3, 2]]
    return altered(camera, distortion=coefficients)
