"""The tables and key numbers of a run, as pages, notebooks and the console show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat._words import Table, length, number, percent, with_bar
from skelsplat.run.frames import problems_of
from skelsplat.run.report import MEANINGS
from skelsplat.run.summary import Group, finite_median, is_biased

if TYPE_CHECKING:
    from skelsplat.run._run import PeopleRun, Run
    from skelsplat.run.calibrate import Calibrated


WHY_RISEN = (
    "start → refined; it rises because the start follows wrong detections and noise as far as it can, which "
    "the refined pose does not"
)
_ERROR = "median reprojection error, start → refined"
# Head, meaning and cell of each column.
_Columns = Sequence[tuple[str, str, Callable[[Any], str]]]
_OF_GROUPS: _Columns = (
    ("median [px]", _ERROR, lambda one: _change(one["before_px"], one["after_px"])),
    (
        "90th percentile [px]",
        "of the reprojection error, start → refined",
        lambda one: _change(one["p90_before_px"], one["p90_after_px"]),
    ),
    ("used", "detections used", lambda one: f"{one['used']:,}"),
    ("missing", MEANINGS["missing"], lambda one: f"{one['missing']:,}"),
    ("not chosen", MEANINGS["not_chosen"], lambda one: f"{one['not_chosen']:,}"),
    ("left out", MEANINGS["left_out"], lambda one: f"{one['left_out']:,}"),
    ("down-weighted", MEANINGS["down_weighted"], lambda one: part_of(one["down_weighted"], one["used"])),
    ("rejected", MEANINGS["rejected"], lambda one: part_of(one["rejected"], one["used"])),
    ("weight", MEANINGS["mean_weight"], lambda one: number(one["mean_weight"], 2)),
    ("swapped", MEANINGS["swapped"], lambda one: f"{one['swapped']:,}"),
)
# of a camera as `skelsplat.run.cameras.numbers_of` has it
_OF_ADJUSTED: _Columns = (
    ("status", "what became of it", lambda one: str(one["status"])),
    ("turned by [°]", "± its error bar", lambda one: with_bar(_known(one["degrees"]), one["degrees_sigma"])),
    ("moved by [mm]", "± its error bar", lambda one: with_bar(_known(one["mm"]), one["mm_sigma"])),
    (
        "error [px]",
        "median distance from where the other cameras place the joints, before → after, in other frames",
        lambda one: _change(_known(one["before_px"]), _known(one["after_px"])),
    ),
)
_MEASURED: _Columns = (
    (
        "focal [%]",
        "change of the focal length",
        lambda one: _measured(one["focal"], one["focal_sigma"], 1, 100),
    ),
    ("clock [frames]", "offset", lambda one: _measured(one["clock_frames"], one["clock_sigma_frames"])),
)
# of a camera as `skelsplat.run.calibrate.Calibrated.cameras` has it
_OF_CALIBRATED: _Columns = (
    ("status", "whether it belongs to the rig", lambda one: one["status"].replace("_", " ")),
    (
        "error [px]",
        "median distance of the detections from the joints",
        lambda one: number(_known(one["error_px"])),
    ),
    (
        "explained",
        "within four times the noise",
        lambda one: "–" if one["explained"] is None else percent(one["explained"]),
    ),
    (
        "turn ± [°]",
        "one standard deviation, with the rig aligned as a whole",
        lambda one: number(_known(one["degrees_sigma"])),
    ),
    ("place ± [mm]", "likewise", lambda one: number(_known(one["mm_sigma"]), 0)),
)
_FOCAL: _Columns = (("focal length [px]", "± one standard deviation", lambda one: _barred(one, "focal_px")),)
_CLOCK: _Columns = (
    ("clock [frames]", "ahead of the first camera's", lambda one: _barred(one, "clock_frames", "+", 2)),
)
_OF_PEOPLE = (
    ("person", ""),
    ("frames", "from the first to the last in which two views see the person"),
    ("seen", "frames in which a view sees the person"),
    ("views", "median number of views that see the person"),
    ("error [px]", _ERROR),
    ("rejected", "part of the detections used that hardly affects the pose"),
    ("error bar [mm]", "median against an anatomical joint, one standard deviation per axis"),
    ("limbs", "range of the lengths of arms and legs frame by frame; large if two people are mixed"),
    ("problems", "frames with weak, missing or unusual joints"),
    ("warnings", "on this person, listed below"),
)


def of_cameras(run: Run) -> Table:
    """Return a row per camera, and one for all."""
    rows = [_cells(one) for one in run.statistics.cameras]
    return Table("Cameras", _heads("camera", _OF_GROUPS), rows, _cells(run.statistics.total))


def of_joints(run: Run) -> Table:
    """Return a row per joint."""
    digits, rows = run.statistics.decimals, []
    for one in run.statistics.joints:
        names = ("error_bar_median_mm", "scatter_median_mm", "moved_median_mm")
        bar, scatter, moved = (number(one[name], digits) for name in names)
        views = f"{one['views_used_median']:g} ({one['views_used_min']})"
        rows.append([*_cells(one), views, f"{bar} ({scatter})", moved])
    columns = [
        *_heads("joint", _OF_GROUPS),
        (f"views used, of {len(run.cameras)}", "with a detection used and not rejected: median (lowest)"),
        ("error bar [mm]", "standard deviation per axis against an anatomical joint (scatter, a part of it)"),
        ("moved [mm]", "median distance of the refined joint from its start"),
    ]
    return Table("Joints", columns, rows)


def of_adjusted(report: Mapping[str, Any]) -> Table:
    """Return what became of each camera that was to be adjusted; no rows without any."""
    adjusted = report.get("cameras_adjusted", ())
    measured = [column for column in _MEASURED if any(column[2](one) != "–" for one in adjusted)]
    columns = [*_OF_ADJUSTED[:-1], *measured, _OF_ADJUSTED[-1]]
    rows = [[one["camera"], *(cell(one) for *_, cell in columns)] for one in adjusted]
    return Table("Cameras, before and after they were adjusted", _heads("camera", columns), rows)


def of_calibrated(found: Calibrated) -> Table:
    """Return what was found about each camera."""
    clocks = any(one["clock_sigma_frames"] for one in found.cameras)
    columns = [*_OF_CALIBRATED, *(_FOCAL if found.focal else ()), *(_CLOCK if clocks else ())]
    rows = [[one["camera"], *(cell(one) for *_, cell in columns)] for one in found.cameras]
    return Table("Cameras", _heads("camera", columns), rows)


def _barred(one: Mapping[str, Any], name: str, sign: str = "", most: int = 4) -> str:
    """Return a camera's number with its error bar; a dash for what was not looked for."""
    sigma = one[name.replace("_", "_sigma_")]
    return with_bar(one[name], sigma, sign, most) if sigma else "–"


def _measured(value: float, sigma: float | None, usual: float = 0.0, scale: float = 1.0) -> str:
    """Return how far a value is from the usual one, with its error bar; a dash for what was not looked at."""
    change = scale * (value - usual)
    return with_bar(change, sigma and scale * sigma, "+") if sigma or round(change, 1) else "–"


def of_people(run: PeopleRun) -> Table:
    """Return a row per person."""
    rows = []
    for entry, one in zip(run.report["people"], run.people.values(), strict=True):
        total, limbs = one.statistics.total, entry["limb_range"]
        row = [
            f"person {entry['id']}",
            f"{entry['first_frame']}–{entry['last_frame']}",
            f"{sum(last - first + 1 for first, last in entry['seen']):,}",
            f"{entry['views_median']:g}",
            _change(total["before_px"], total["after_px"]),
            part_of(total["rejected"], total["used"]),
            length(finite_median(one.statistics.error_bar_mm)),
            "–" if limbs is None else f"{100 * limbs:.0f}%",
            f"{problem_frames(one):,}",
            str(len(one.findings)),
        ]
        rows.append(row)
    return Table("People", _OF_PEOPLE, rows)


def facts_of(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Return what was read and how, as (name, value)."""
    source, errors = report["input"], report["reprojection_error"]
    first, last, rate = source["first_frame"], source["last_frame"], source["frame_rate_hz"]
    span = f"{source['frames']:,}, {first} to {last}" if source["frames"] > 1 else f"1, frame {first}"
    detections = f"{source['detections']} ({source['format']})"
    files = [("calibration", f"{source['calibration']}"), ("detections", detections)]
    return [
        *(files if source["calibration"] is not None else []),
        ("layout", f"{source['layout']}, {len(errors['joints'])} joints"),
        ("cameras", str(len(errors["cameras"]))),
        ("frames", span),
        ("frame rate", "unknown" if rate is None else f"{rate:g} per second"),
        ("method", f"{report['settings']['method']}, {report['solution']['method']}"),
        ("unit of the calibration", source["unit"]),
        ("skelsplat", report["versions"]["skelsplat"]),
    ]


def key_numbers(run: Run) -> list[tuple[str, str, str]]:
    """Return the key numbers: name, value and remark."""
    statistics, (error, rejected, bar) = run.statistics, _numbers_of([run])
    if is_biased(run.result):
        scatter = number(finite_median(statistics.scatter_mm), statistics.decimals)
        bar = (*bar[:2], f"against anatomical joints; scatter {scatter} mm")
    noise = f"{number(statistics.noise_mm, statistics.decimals)} mm across the ray, estimated"
    problems = f"{problem_frames(run):,} of {len(run.inputs.in_all):,}"
    return [
        error,
        rejected,
        ("noise of the detections", f"{number(statistics.noise_px)} px", noise),
        bar,
        ("frames with a problem", problems, "weak, missing or unusual joints"),
    ]


def numbers_of_people(run: PeopleRun) -> list[tuple[str, str, str]]:
    """Return the key numbers of several people."""
    cameras = run.report["detections"]["cameras"]
    assigned, detected = (sum(camera[name] for camera in cameras) for name in ("assigned", "detected"))
    remark = f"of {detected:,} in all views, to the people above"
    return [
        ("people", str(len(run.people)), f"in {len(run.frames):,} frames"),
        ("detected people assigned", part_of(assigned, detected), remark),
        *_numbers_of(list(run.people.values())),
    ]


def _numbers_of(runs: Sequence[Run]) -> list[tuple[str, str, str]]:
    """Return the errors, the rejected detections and the error bars of all runs together."""

    def median(name: str) -> float:
        return finite_median(np.concatenate([getattr(one.statistics, name).ravel() for one in runs]))

    groups = [one.statistics.total for one in runs]
    used, rejected = sum(group["used"] for group in groups), sum(group["rejected"] for group in groups)
    before, after = groups[0]["before_px"], groups[0]["after_px"]
    if len(runs) > 1:
        before, after = median("error_before"), median("error_after")
    change = WHY_RISEN if round(after, 1) > round(before, 1) else "start → refined"
    biased = any(is_biased(one.result) for one in runs)
    against = "against anatomical joints" if biased else "scatter alone, without a bias of the detector"
    return [
        ("median reprojection error", f"{_change(before, after)} px", change),
        ("detections rejected", part_of(rejected, used), f"of {used:,} used"),
        ("median error bar", f"{length(median('error_bar_mm'))} mm", against),
    ]


def problem_frames(run: Run) -> int:
    """Count the frames with weak, missing or unusual joints."""
    return len({frame for one in problems_of(run.frame_findings) for frame in one.subject.frames})


def part_of(count: int, of: int) -> str:
    """Return a part as a percentage, a dash if it is a part of nothing."""
    return f"{100 * count / of:.1f}%" if of else "–"


def _heads(first: str, columns: _Columns) -> list[tuple[str, str]]:
    return [(first, ""), *((head, meaning) for head, meaning, _ in columns)]


def _cells(group: Group) -> list[str]:
    return [group["name"], *(cell(group) for *_, cell in _OF_GROUPS)]


def _change(before: float, after: float) -> str:
    return f"{number(before)} → {number(after)}"


def _known(value: float | None) -> float:
    return float("nan") if value is None else value
