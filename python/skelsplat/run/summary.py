"""Counts and errors of a refined sequence, without ground truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
# what counts detections in a `Group`, and of what there are shares
_SHARED = ("down_weighted", "rejected")
_COUNTS = (*("used", "left_out", "missing", "not_chosen"), *("down_weighted", "rejected", "swapped", "poor"))


Group = dict[str, Any]
"""The detections of one camera or of one joint over all frames, as in ``report.json`` but with NaN for null.

``before_px`` and ``after_px`` are medians over the same detections; ``used`` + ``left_out`` + ``missing`` is
their number. ``not_chosen`` ones are among the missing; ``down_weighted`` (the ``rejected`` among them),
``swapped`` and ``poor`` ones are among the used. `skelsplat.run.report.MEANINGS` explains them.
"""


def _group(name: str, part: Mapping[str, npt.NDArray[Any]]) -> Group:
    """Count detections by what `summarise` knows of each: (T, M, N), or a part of them."""
    used = np.isfinite(part["after"])
    missing = ~part["there"] & ~used
    both = used & np.isfinite(part["before"])
    before, after = part["before"][both], part["after"][both]
    weights = part["weight"][np.isfinite(part["weight"])]
    counted = {
        "name": name,
        "before_px": finite_median(before),
        "after_px": finite_median(after),
        "p90_before_px": _percentile(before, 90),
        "p90_after_px": _percentile(after, 90),
        "used": int(used.sum()),
        "left_out": int((part["there"] & ~used).sum()),
        "missing": int(missing.sum()),
        "not_chosen": int((missing & part["unmatched"]).sum()),
        "down_weighted": int((weights < DOWN_WEIGHTED).sum()),
        "rejected": int((weights < sk.REJECTED_WEIGHT).sum()),
        "swapped": int(part["swapped"].sum()),
        "mean_weight": float(weights.mean()) if weights.size else float("nan"),
        "poor": int(part["poor"].sum()),
    }
    return _with_shares(counted)


def _with_shares(group: Group) -> Group:
    """Return the same with two counts as parts of the detections used."""
    shares = {
        f"{name}_share": group[name] / group["used"] if group["used"] else float("nan") for name in _SHARED
    }
    return {**group, **shares}


def _in_all(group: Group, parts: Sequence[Group]) -> Group:
    """Return the same with the counts and the mean weight of all parts of the recording."""
    sums: Group = {name: sum(part[name] for part in parts) for name in _COUNTS}
    weights = [part["mean_weight"] * part["used"] for part in parts if part["used"]]
    sums["mean_weight"] = sum(weights) / sums["used"] if weights else float("nan")
    return _with_shares({**group, **sums})


# Fields of `Statistics` that parts of a recording add up to.
COUNTED = ("cameras", "joints", "total", "stop_reasons", "statuses")


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
    cameras: list[Group]
    joints: list[Group]
    total: Group
    stop_reasons: dict[str, int]  # number of frames
    statuses: dict[str, int]  # number of joints, over all frames

    @property
    def decimals(self) -> int:
        """How many decimals lengths in mm are written with: one, more if the error bars are below 1 mm."""
        return decimals(finite_median(self.error_bar_mm))

    def with_counts_of(self, parts: Sequence[Mapping[str, Any]]) -> Statistics:
        """Return the same with the counts of all parts of the recording, by the names of `COUNTED`."""

        def groups(name: str) -> list[Group]:
            every = zip(*(part[name] for part in parts), strict=True)
            return [_in_all(own, same) for own, same in zip(getattr(self, name), every, strict=True)]

        def count(name: str) -> dict[str, int]:
            return dict(sum((Counter(part[name]) for part in parts), Counter[str]()).most_common())

        total = _in_all(self.total, [part["total"] for part in parts])
        stops, statuses = count("stop_reasons"), count("statuses")
        own = replace(self, cameras=groups("cameras"), joints=groups("joints"), total=total)
        return replace(own, stop_reasons=stops, statuses=statuses)


def summarise(inputs: Inputs, outcome: Outcome, replaced: Mask | None = None) -> Statistics:
    """Count and measure a refined sequence against its detections; joints ``replaced`` (T, N) have no bar."""
    result, mm = outcome.result, inputs.rig.mm_per_unit
    poor_px = np.array([POOR_SHARE * np.hypot(*camera.size) for camera in inputs.rig])
    every = _of_detections(inputs, outcome, poor_px)

    def group(name: str, part: Any) -> Group:
        return _group(name, {key: values[part] for key, values in every.items()})

    used, rejected = np.isfinite(every["after"]), every["weight"] < sk.REJECTED_WEIGHT
    projected = _projected(result.pose, inputs, outcome)
    seen, swapped = inputs.detections[..., :2], np.asarray(result.swapped)
    residual = residuals(seen, projected, swapped, inputs.layout.left_right)
    residual = np.where(used[..., None], residual, np.nan)
    views_used = (used & ~rejected).sum(axis=1)
    variance = np.trace(result.uncertainty, axis1=-2, axis2=-1) / 3
    moved = np.linalg.norm(np.asarray(result.pose) - outcome.start, axis=-1) * mm
    bar, scatter = np.sqrt(variance + result.joint_bias**2) * mm, np.sqrt(variance) * mm
    if replaced is not None:
        bar, scatter = (np.where(replaced, np.nan, values) for values in (bar, scatter))
    cameras = [
        {**group(name, np.s_[:, i]), "poor_above_px": float(poor_px[i])}
        for i, name in enumerate(inputs.rig.names)
    ]
    joints = [
        {**group(name, np.s_[..., j]), **_of_joint(views_used[:, j], moved[:, j], bar[:, j], scatter[:, j])}
        for j, name in enumerate(inputs.layout.joints)
    ]
    return Statistics(
        error_before=every["before"],
        error_after=every["after"],
        residual=residual,
        shifts=camera_shifts(residual),
        rejected=rejected,
        views_used=views_used,
        moved_mm=moved,
        error_bar_mm=bar,
        scatter_mm=scatter,
        noise_mm=finite_median(result.noise) * mm,
        noise_px=finite_median(np.asarray(result.noise) / _pixel_sizes(inputs, outcome)),
        cameras=cameras,
        joints=joints,
        total=group("all", ...),
        stop_reasons=_count(result.stop_reason),
        statuses=_count(result.joint_status),
    )


def _of_detections(inputs: Inputs, outcome: Outcome, poor_px: Array) -> dict[str, npt.NDArray[Any]]:
    """Return what is known of each detection, (T, M, N)."""
    result, seen = outcome.result, inputs.detections
    after = np.asarray(result.reprojection_error)
    used = np.isfinite(after)
    before = np.linalg.norm(_projected(outcome.start, inputs, outcome) - seen[..., :2], axis=-1)
    return {
        "before": np.where(used, before, np.nan),
        "after": after,
        "there": np.isfinite(seen[..., :2]).all(axis=-1) & (seen[..., 2] > 0),
        "unmatched": np.broadcast_to(inputs.unmatched[..., None], used.shape),
        "weight": np.where(used, np.asarray(result.view_weights), np.nan),
        "swapped": used & np.asarray(result.swapped),
        "poor": used & (after > poor_px[:, None]),
    }


def _of_joint(views: Index, moved: Array, bar: Array, scatter: Array) -> Group:
    """Return what an entry of a joint has besides its counts, from its values in every frame (T,)."""
    return {
        "views_used_median": float(np.median(views)),
        "views_used_min": int(views.min()),
        "moved_median_mm": finite_median(moved),
        "error_bar_median_mm": finite_median(bar),
        "error_bar_max_mm": finite_max(bar),
        "scatter_median_mm": finite_median(scatter),
        "scatter_max_mm": finite_max(scatter),
    }


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

    Of (T, M, N), NaN where no detection was used.
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
