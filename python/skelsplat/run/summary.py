"""Counts and errors of a refined sequence, without ground truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import Array, Index, Mask, medians
from skelsplat._words import decimals
from skelsplat.run.displaced import Shifts, camera_shifts, residuals
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome, rig_as_used

# A detection is called poor beyond this share of the image's diagonal: 22 px at 1920 × 1080, some 40 mm on a
# person who fills the longer side.
POOR_SHARE = 0.01
# A detection is called down-weighted below a weight of one half. With the kernel twice as wide as
# the noise that is 3.3 standard deviations from the joint, which one in 250 sound detections exceeds.
DOWN_WEIGHTED = 0.5
# the fields of `Group` that count detections
_COUNTS = (*("used", "left_out", "missing", "not_chosen"), *("down_weighted", "rejected", "swapped", "poor"))


@dataclass(frozen=True)
class Group:
    """The detections of one camera or of one joint over all frames.

    ``before_px`` and ``after_px`` are medians over the same detections (NaN without any); ``used`` +
    ``left_out`` + ``missing`` is their number. Left out are those below the least confidence and those of
    joints that have no position. ``not_chosen`` ones are among the missing: people are detected in the
    view and another, but none here matches. ``down_weighted`` (the ``rejected`` among them), ``swapped``
    and ``poor`` ones are among the used, and ``mean_weight`` is their mean weight k.
    """

    name: str
    before_px: float
    after_px: float
    p90_before_px: float
    p90_after_px: float
    used: int
    left_out: int
    missing: int
    not_chosen: int
    down_weighted: int
    rejected: int
    swapped: int
    mean_weight: float
    poor: int

    @property
    def rejected_share(self) -> float:
        """Part of the used detections that is rejected; 0 without any."""
        return self.rejected / self.used if self.used else 0.0

    @property
    def down_weighted_share(self) -> float:
        """Part of the used detections that is down-weighted; 0 without any."""
        return self.down_weighted / self.used if self.used else 0.0

    @classmethod
    def of(cls, name: str, part: Mapping[str, npt.NDArray[Any]]) -> Group:
        """Count detections by what `summarise` knows of each: (T, M, N), or a part of them."""
        used = np.isfinite(part["after"])
        missing = ~part["there"] & ~used
        both = used & np.isfinite(part["before"])
        before, after = part["before"][both], part["after"][both]
        weights = part["weight"][np.isfinite(part["weight"])]
        return cls(
            name=name,
            before_px=finite_median(before),
            after_px=finite_median(after),
            p90_before_px=_percentile(before, 90),
            p90_after_px=_percentile(after, 90),
            used=int(used.sum()),
            left_out=int((part["there"] & ~used).sum()),
            missing=int(missing.sum()),
            not_chosen=int((missing & part["unmatched"]).sum()),
            down_weighted=int((weights < DOWN_WEIGHTED).sum()),
            rejected=int((weights < sk.REJECTED_WEIGHT).sum()),
            swapped=int(part["swapped"].sum()),
            mean_weight=float(weights.mean()) if weights.size else float("nan"),
            poor=int(part["poor"].sum()),
        )

    def with_counts_of(self, parts: Sequence[Group]) -> Group:
        """Return the same with the counts and the mean weight of all parts of the recording."""
        sums: dict[str, Any] = {name: sum(getattr(part, name) for part in parts) for name in _COUNTS}
        weights = [part.mean_weight * part.used for part in parts if part.used]
        sums["mean_weight"] = sum(weights) / sums["used"] if weights else float("nan")
        return replace(self, **sums)

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> Group:
        """Return the group of an entry of ``report.json``; null is NaN."""
        held = {part.name: entry[part.name] for part in fields(cls)}
        filled: dict[str, Any] = {k: float("nan") if value is None else value for k, value in held.items()}
        return cls(**filled)


@dataclass(frozen=True)
class Statistics:
    """The numbers of the table, the report and the figures.

    Attributes
    ----------
    error_before, error_after : (T, M, N)
        Reprojection errors in px, NaN for detections that were not used.
    residual : (T, M, N, 2)
        Detection − projection in px of the joint that it was used for, NaN for detections that were not used.
    shifts : Shifts
        How far and in which direction every camera's detections are off the pose.
    rejected : (T, M, N)
        Detections that are used and rejected.
    views_used : (T, N)
        Number of views whose detection of the joint is used and not rejected.
    moved_mm : (T, N)
        Distance of each refined joint from its start, in mm.
    error_bar_mm, scatter_mm : (T, N)
        Standard deviation of each joint, the root mean square over the axes, in mm: against an anatomical
        joint, and between recordings of the same pose. Whether a joint or frame is unusual is judged from the
        scatter.
    noise_mm, noise_px : float
        Standard deviation of the detections' noise, median over the frames: across the ray, and in the image.
    poor_px : (M,)
        The error beyond which a detection of this camera is called poor.
    cameras, joints : list of Group
    total : Group
    stop_reasons, statuses : dict
        Number of frames per stop reason; number of joints (over all frames) per status.
    """

    error_before: Array
    error_after: Array
    residual: Array
    shifts: Shifts
    rejected: Mask
    views_used: Index
    moved_mm: Array
    error_bar_mm: Array
    scatter_mm: Array
    noise_mm: float
    noise_px: float
    poor_px: Array
    cameras: list[Group]
    joints: list[Group]
    total: Group
    stop_reasons: dict[str, int]
    statuses: dict[str, int]

    @property
    def decimals(self) -> int:
        """How many decimals lengths in mm are written with: one, more if the error bars are below 1 mm."""
        return decimals(finite_median(self.error_bar_mm))

    def without_bars(self, where: Mask) -> Statistics:
        """Return the same without the error bars where (T, N) holds, as of positions that were replaced."""
        bar, scatter = (np.where(where, np.nan, mm) for mm in (self.error_bar_mm, self.scatter_mm))
        return replace(self, error_bar_mm=bar, scatter_mm=scatter)

    def with_counts_of(self, parts: Sequence[Statistics]) -> Statistics:
        """Return the same with the counts of all parts of the recording, of which it is a sample."""
        cameras, joints = (
            [
                own.with_counts_of(every)
                for own, *every in zip(*(getattr(one, key) for one in (self, *parts)), strict=True)
            ]
            for key in ("cameras", "joints")
        )
        stops, statuses = (
            dict(sum((Counter(getattr(part, key)) for part in parts), Counter()).most_common())
            for key in ("stop_reasons", "statuses")
        )
        total = self.total.with_counts_of([part.total for part in parts])
        return replace(
            self, cameras=cameras, joints=joints, total=total, stop_reasons=stops, statuses=statuses
        )

    def counts(self) -> Statistics:
        """Return the same without the arrays that have all frames."""
        nothing = np.empty(0)
        names = ("error_before", "error_after", "residual", "moved_mm", "error_bar_mm", "scatter_mm")
        arrays: dict[str, Any] = dict.fromkeys((*names, "rejected", "views_used"), nothing)
        return replace(self, **arrays)

    def with_groups_of(self, errors: Mapping[str, Any]) -> Statistics:
        """Return the same with the groups of a report's ``reprojection_error``."""
        cameras, joints = ([Group.from_dict(one) for one in errors[key]] for key in ("cameras", "joints"))
        return replace(self, cameras=cameras, joints=joints, total=Group.from_dict(errors["all"]))


def summarise(inputs: Inputs, outcome: Outcome) -> Statistics:
    """Count and measure a refined sequence against its own detections."""
    result, mm = outcome.result, inputs.rig.mm_per_unit
    after = np.asarray(result.reprojection_error)
    used = np.isfinite(after)
    start_error = np.linalg.norm(
        _projected(outcome.start, inputs, outcome) - inputs.detections[..., :2], axis=-1
    )
    before = np.where(used, start_error, np.nan)
    poor_px = np.array([POOR_SHARE * np.hypot(*camera.size) for camera in inputs.rig])
    every = {
        "before": before,
        "after": after,
        "there": np.isfinite(inputs.detections[..., :2]).all(axis=-1) & (inputs.detections[..., 2] > 0),
        "unmatched": np.broadcast_to(inputs.unmatched[..., None], used.shape),
        "weight": np.where(used, result.view_weights, np.nan),
        "swapped": used & np.asarray(result.swapped),
        "poor": used & (after > poor_px[:, None]),
    }

    def group(name: str, part: Any) -> Group:
        return Group.of(name, {key: values[part] for key, values in every.items()})

    residual = np.where(used[..., None], _residuals(inputs, outcome), np.nan)
    rejected = every["weight"] < sk.REJECTED_WEIGHT
    scatter = np.trace(result.uncertainty, axis1=-2, axis2=-1) / 3
    return Statistics(
        error_before=before,
        error_after=after,
        residual=residual,
        shifts=camera_shifts(residual),
        rejected=rejected,
        views_used=(used & ~rejected).sum(axis=1),
        moved_mm=np.linalg.norm(np.asarray(result.pose) - outcome.start, axis=-1) * mm,
        error_bar_mm=np.sqrt(scatter + result.joint_bias**2) * mm,
        scatter_mm=np.sqrt(scatter) * mm,
        noise_mm=finite_median(result.noise) * mm,
        noise_px=finite_median(np.asarray(result.noise) / _pixel_sizes(inputs, outcome)),
        poor_px=poor_px,
        cameras=[group(name, np.s_[:, i]) for i, name in enumerate(inputs.rig.names)],
        joints=[group(name, np.s_[..., j]) for j, name in enumerate(inputs.layout.joints)],
        total=group("all", ...),
        stop_reasons=_count(result.stop_reason),
        statuses=_count(result.joint_status),
    )


def is_biased(result: sk.Refinement) -> bool:
    """Say whether error bars contain a bias of the detector; without one, they are the scatter."""
    return bool((np.asarray(result.joint_bias) > 0).any())


def finite_median(values: npt.ArrayLike) -> float:
    """Return the median of the finite values, NaN if there is none."""
    return _percentile(np.asarray(values, dtype=np.float64), 50)


def frame_medians(values: Array) -> Array:
    """Return the median of what is finite in every frame of (T, …), NaN where there is nothing."""
    return medians(values.reshape(len(values), -1))


def error_maps(errors: Array, weights: Array) -> tuple[Array, Array]:
    """Return median error in px and share rejected, each (M + 1, N + 1); last row and column: over all.

    Of errors and weights (T, M, N) of the detections that were used; NaN where there is none.
    """
    _, views, joints = errors.shape
    median, share = np.full((2, views + 1, joints + 1), np.nan)
    for i in range(views + 1):
        for j in range(joints + 1):
            cell = np.s_[:, slice(None) if i == views else i, slice(None) if j == joints else j]
            error, weight = (values[np.isfinite(values)] for values in (errors[cell], weights[cell]))
            if len(error):
                median[i, j] = np.median(error)
            if len(weight):
                share[i, j] = np.mean(weight < sk.REJECTED_WEIGHT)
    return median, share


def finite_max(values: npt.ArrayLike) -> float:
    """Return the largest finite value, NaN if there is none."""
    return _percentile(np.asarray(values, dtype=np.float64), 100)


def _residuals(inputs: Inputs, outcome: Outcome) -> Array:
    """Return detection − refined pose in px, (T, M, N, 2)."""
    projected = _projected(outcome.result.pose, inputs, outcome)
    swapped = np.asarray(outcome.result.swapped)
    return residuals(inputs.detections[..., :2], projected, swapped, inputs.layout.left_right)


def _projected(pose: npt.ArrayLike, inputs: Inputs, outcome: Outcome) -> Array:
    """Return the pixels (T, M, N, 2) of a pose, with the lenses that were used."""
    rig = rig_as_used(inputs.rig, undistort=outcome.config.undistort)
    return np.moveaxis(np.asarray(sk.project(pose, rig)), 0, 1)


def _pixel_sizes(inputs: Inputs, outcome: Outcome) -> Array:
    """Return the mean size of a pixel at the joints of every frame, (T,), in the unit of the cameras."""
    pose = np.asarray(outcome.result.pose)
    ranges = np.stack([np.linalg.norm(pose - camera.centre, axis=-1) for camera in inputs.rig], axis=1)
    focal = np.array([(camera.K[0, 0] + camera.K[1, 1]) / 2 for camera in inputs.rig])
    seen = np.isfinite(outcome.result.reprojection_error)
    total = np.where(seen, ranges / focal[:, None], 0.0).sum(axis=(1, 2))
    count = seen.sum(axis=(1, 2))
    mean: Array = np.divide(total, count, out=np.full(len(pose), np.nan), where=count > 0)
    return mean


def _percentile(values: Array, share: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.percentile(finite, share)) if finite.size else float("nan")


def _count(labels: npt.ArrayLike) -> dict[str, int]:
    return dict(Counter(str(label) for label in np.asarray(labels).ravel()).most_common())
