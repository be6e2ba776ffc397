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
        held: dict[str, Any] = {part.name: entry[part.name] for part in fields(cls)}
        missing = {name: float("nan") for name, value in held.items() if value is None}
        return cls(**{**held, **missing})


@dataclass(frozen=True)
class Statistics:
    """The numbers of the table, the report and the figures. Errors are NaN for detections not used."""

    error_before: Array  # (T, M, N) reprojection errors in px of the start,
    error_after: Array  # (T, M, N) and of the refined pose
    residual: Array  # (T, M, N, 2) detection − projection in px of the joint that it was used for
    shifts: Shifts  # how far, and in which direction, every camera's detections are off the pose
    rejected: Mask  # (T, M, N) detections that are used and rejected
    views_used: Index  # (T, N) views whose detection of the joint is used and not rejected
    moved_mm: Array  # (T, N) distance of each refined joint from its start
    # (T, N) standard deviation of each joint, the root mean square over the axes: against an anatomical
    # joint, and between recordings of the same pose; what is unusual is judged from the latter
    error_bar_mm: Array
    scatter_mm: Array
    noise_mm: float  # standard deviation of the detections' noise, median over the frames: across the ray,
    noise_px: float  # and in the image
    poor_px: Array  # (M,) the error beyond which a detection of this camera is called poor
    cameras: list[Group]
    joints: list[Group]
    total: Group
    stop_reasons: dict[str, int]  # number of frames
    statuses: dict[str, int]  # number of joints, over all frames

    @property
    def decimals(self) -> int:
        """How many decimals lengths in mm are written with: one, more if the error bars are below 1 mm."""
        return decimals(finite_median(self.error_bar_mm))

    def counts(self) -> Statistics:
        """Return the same without the arrays that have all frames."""
        names = ("error_before", "error_after", "residual", "moved_mm", "error_bar_mm", "scatter_mm")
        arrays: dict[str, Any] = dict.fromkeys((*names, "rejected", "views_used"), np.empty(0))
        return replace(self, **arrays)

    def with_counts_of(self, parts: Sequence[Statistics]) -> Statistics:
        """Return the same with the counts of all parts of the recording, of which it is a sample."""

        def groups(name: str) -> list[Group]:
            every = zip(*(getattr(part, name) for part in parts), strict=True)
            return [own.with_counts_of(same) for own, same in zip(getattr(self, name), every, strict=True)]

        def count(name: str) -> dict[str, int]:
            counters = (Counter(getattr(part, name)) for part in parts)
            return dict(sum(counters, Counter[str]()).most_common())

        return replace(
            self,
            cameras=groups("cameras"),
            joints=groups("joints"),
            total=self.total.with_counts_of([part.total for part in parts]),
            stop_reasons=count("stop_reasons"),
            statuses=count("statuses"),
        )

    def with_groups_of(self, errors: Mapping[str, Any]) -> Statistics:
        """Return the same with the groups of a report's ``reprojection_error``."""
        cameras, joints = ([Group.from_dict(one) for one in errors[key]] for key in ("cameras", "joints"))
        return replace(self, cameras=cameras, joints=joints, total=Group.from_dict(errors["all"]))


def summarise(inputs: Inputs, outcome: Outcome) -> Statistics:
    """Count and measure a refined sequence against its own detections."""
    result, mm, seen = outcome.result, inputs.rig.mm_per_unit, inputs.detections
    after, weights = np.asarray(result.reprojection_error), np.asarray(result.view_weights)
    used, swapped = np.isfinite(after), np.asarray(result.swapped)
    start_error = np.linalg.norm(_projected(outcome.start, inputs, outcome) - seen[..., :2], axis=-1)
    poor_px = np.array([POOR_SHARE * np.hypot(*camera.size) for camera in inputs.rig])
    every = {
        "before": np.where(used, start_error, np.nan),
        "after": after,
        "there": np.isfinite(seen[..., :2]).all(axis=-1) & (seen[..., 2] > 0),
        "unmatched": np.broadcast_to(inputs.unmatched[..., None], used.shape),
        "weight": np.where(used, weights, np.nan),
        "swapped": used & swapped,
        "poor": used & (after > poor_px[:, None]),
    }

    def group(name: str, part: Any) -> Group:
        return Group.of(name, {key: values[part] for key, values in every.items()})

    projected = _projected(result.pose, inputs, outcome)
    residual = residuals(seen[..., :2], projected, swapped, inputs.layout.left_right)
    residual = np.where(used[..., None], residual, np.nan)
    rejected = every["weight"] < sk.REJECTED_WEIGHT
    scatter = np.trace(result.uncertainty, axis1=-2, axis2=-1) / 3
    return Statistics(
        error_before=every["before"],
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


def finite_max(values: npt.ArrayLike) -> float:
    """Return the largest finite value, NaN if there is none."""
    return _percentile(np.asarray(values, dtype=np.float64), 100)


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
    total, count = np.where(seen, ranges / focal[:, None], 0.0).sum(axis=(1, 2)), seen.sum(axis=(1, 2))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _percentile(values: Array, share: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.percentile(finite, share)) if finite.size else float("nan")


def _count(labels: npt.ArrayLike) -> dict[str, int]:
    return dict(Counter(str(label) for label in np.asarray(labels).ravel()).most_common())
