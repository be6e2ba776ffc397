"""The tables and key numbers of a run, as pages, notebooks and the console show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._words import decimals, length, number, with_bar
from skelsplat.run.frames import problems_of
from skelsplat.run.report import MEANINGS
from skelsplat.run.summary import DOWN_WEIGHTED, Group, finite_median, is_biased

if TYPE_CHECKING:
    from skelsplat.run._run import PeopleRun, Run


@dataclass(frozen=True)
class Rows:
    """Cells as texts; the first of a row names it. Columns are (head, what its numbers are in words)."""

    title: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[str]]
    total: Sequence[str] = ()  # a last row for all
    hint: str = ""


_WHY_RISEN = (
    "start → refined; it rises because the start follows wrong detections and noise as far as it can, which "
    "the refined pose does not"
)
# Head, meaning and cell of each column.
_Columns = Sequence[tuple[str, str, Callable[[Any], str]]]
_OF_GROUPS: _Columns = (
    (
        "median [px]",
        "median reprojection error, start → refined",
        lambda one: f"{number(one.before_px)} → {number(one.after_px)}",
    ),
    (
        "90th percentile [px]",
        "of the reprojection error, start → refined",
        lambda one: f"{number(one.p90_before_px)} → {number(one.p90_after_px)}",
    ),
    ("used", "detections used", lambda one: f"{one.used:,}"),
    ("missing", "no detection of the followed person", lambda one: f"{one.missing:,}"),
    (
        "not chosen",
        "of the missing: no person detected in this view matches the other cameras",
        lambda one: f"{one.not_chosen:,}",
    ),
    (
        "left out",
        "detections below the minimum confidence, or of a joint without a position",
        lambda one: f"{one.left_out:,}",
    ),
    (
        "down-weighted",
        f"detections used with a weight below {DOWN_WEIGHTED:g}, including the rejected ones",
        lambda one: part_of(one.down_weighted, one.used),
    ),
    (
        "rejected",
        f"detections used with a weight below {sk.REJECTED_WEIGHT:g}, which hardly affect the pose",
        lambda one: part_of(one.rejected, one.used),
    ),
    ("weight", MEANINGS["mean_weight"], lambda one: number(one.mean_weight, 2)),
    ("swapped", MEANINGS["swapped"], lambda one: f"{one.swapped:,}"),
)
# of a camera as `skelsplat.run.adjust.numbers_of` has it
_OF_ADJUSTED: _Columns = (
    ("status", "what became of it", lambda one: str(one["status"])),
    ("turned by [°]", "± its error bar", lambda one: with_bar(_known(one["degrees"]), one["degrees_sigma"])),
    ("moved by [mm]", "± its error bar", lambda one: with_bar(_known(one["mm"]), one["mm_sigma"])),
    (
        "error [px]",
        "median distance from where the other cameras place the joints, before → after, in other frames",
        lambda one: f"{number(_known(one['before_px']))} → {number(_known(one['after_px']))}",
    ),
)
# of an entry of the report and the person's run
_OF_PEOPLE: _Columns = (
    (
        "frames",
        "from the first to the last in which two views see the person",
        lambda one: f"{one[0]['first_frame']}–{one[0]['last_frame']}",
    ),
    (
        "seen",
        "frames in which a view sees the person",
        lambda one: f"{sum(last - first + 1 for first, last in one[0]['seen']):,}",
    ),
    ("views", "median number of views that see the person", lambda one: f"{one[0]['views_median']:g}"),
    (
        "error [px]",
        "median reprojection error, start → refined",
        lambda one: _OF_GROUPS[0][-1](one[1].statistics.total),
    ),
    (
        "rejected",
        "part of the detections used that hardly affects the pose",
        lambda one: part_of(one[1].statistics.total.rejected, one[1].statistics.total.used),
    ),
    (
        "error bar [mm]",
        "median against an anatomical joint, one standard deviation per axis",
        lambda one: length(finite_median(one[1].statistics.error_bar_mm)),
    ),
    (
        "limbs",
        "range of the lengths of arms and legs frame by frame, 5th to 95th percentile, as a part of the "
        "length; large if two people are mixed",
        lambda one: "–" if one[0]["limb_range"] is None else f"{100 * one[0]['limb_range']:.0f}%",
    ),
    ("problems", "frames with weak, missing or unusual joints", lambda one: f"{problem_frames(one[1]):,}"),
    ("warnings", "on this person, listed below", lambda one: str(len(one[1].findings))),
)


def of_cameras(run: Run) -> Rows:
    """Return a row per camera, and one for all."""
    columns, own = _heads("camera", _OF_GROUPS), run.statistics
    return Rows("Cameras", columns, [_cells(one) for one in own.cameras], _cells(own.total))


def of_joints(run: Run) -> Rows:
    """Return a row per joint."""
    statistics, digits = run.statistics, run.statistics.decimals
    rows = []
    for j, group in enumerate(statistics.joints):
        views = statistics.views_used[:, j]
        bar, scatter = (finite_median(mm[:, j]) for mm in (statistics.error_bar_mm, statistics.scatter_mm))
        own = [
            f"{np.median(views):g} ({views.min()})",
            f"{number(bar, digits)} ({number(scatter, digits)})",
            number(finite_median(statistics.moved_mm[:, j]), digits),
        ]
        rows.append([*_cells(group), *own])
    columns = [
        *_heads("joint", _OF_GROUPS),
        (
            f"views used, of {len(run.cameras)}",
            "views with a detection that is used and not rejected: median over the frames (lowest)",
        ),
        (
            "error bar [mm]",
            "standard deviation per axis against an anatomical joint, median over the frames "
            "(in brackets the scatter, a part of it)",
        ),
        ("moved [mm]", "median distance of the refined joint from its start"),
    ]
    return Rows("Joints", columns, rows)


def of_adjusted(report: Mapping[str, Any]) -> Rows:
    """Return what became of each camera that was to be adjusted; no rows without any."""
    rows = [[one["camera"], *(cell(one) for *_, cell in _OF_ADJUSTED)] for one in report.get(ADJUSTED, ())]
    return Rows("Cameras, before and after they were adjusted", _heads("camera", _OF_ADJUSTED), rows)


ADJUSTED = "cameras_adjusted"


def of_people(run: PeopleRun) -> Rows:
    """Return a row per person."""
    both = zip(run.report["people"], run.people.values(), strict=True)
    rows = [[f"person {one[0]['id']}", *(cell(one) for *_, cell in _OF_PEOPLE)] for one in both]
    return Rows("People", _heads("person", _OF_PEOPLE), rows)


def of_bones(run: PeopleRun) -> Rows:
    """Return the lengths of everybody's bones; no rows if the poses were not solved over time."""
    lengths: list[dict[str, str]] = []
    for one in run.people.values():
        joints = [name.replace("_", " ") for name in one.layout.joints]
        sizes = ((f"{joints[a]} – {joints[b]}", size) for a, b, *size in bones_of(one))
        lengths.append({bone: _length(*size) for bone, size in sizes if np.isfinite(size).all()})
    every = dict.fromkeys(bone for own in lengths for bone in own)
    columns = [("bone", ""), *((f"person {identity}", "") for identity in run.people)]
    rows = [[bone, *(own.get(bone, "–") for own in lengths)] for bone in every]
    return Rows("Bone lengths [mm]", columns, rows, hint="Over all frames, ± standard error.")


def bones_of(run: Run) -> list[tuple[int, int, float, float]]:
    """Return the bones of a solution over time with their lengths and standard errors in mm."""
    found, mm = run.outcome.sequence, run.cameras.mm_per_unit
    if found is None:
        return []
    sizes = zip(found.bones.tolist(), found.bone_lengths * mm, found.bone_length_sigma * mm, strict=True)
    return [(a, b, float(length), float(sigma)) for (a, b), length, sigma in sizes]


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
    statistics = run.statistics
    error, rejected, bar = _numbers_of([run])
    digits = statistics.decimals
    scatter = f"against anatomical joints; scatter {number(finite_median(statistics.scatter_mm), digits)} mm"
    noise = f"{number(statistics.noise_mm, digits)} mm across the ray, estimated"
    return [
        error,
        rejected,
        ("noise of the detections", f"{number(statistics.noise_px)} px", noise),
        (*bar[:2], scatter if is_biased(run.result) else bar[2]),
        (
            "frames with a problem",
            f"{problem_frames(run):,} of {run.inputs.n_frames:,}",
            "weak, missing or unusual joints",
        ),
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
    groups = [one.statistics.total for one in runs]
    used, rejected = sum(group.used for group in groups), sum(group.rejected for group in groups)
    before, after = groups[0].before_px, groups[0].after_px
    if len(runs) > 1:
        names = ("error_before", "error_after")
        before, after = (
            finite_median(np.concatenate([getattr(one.statistics, name).ravel() for one in runs]))
            for name in names
        )
    bars = np.concatenate([one.statistics.error_bar_mm.ravel() for one in runs])
    biased = any(is_biased(one.result) for one in runs)
    against = "against anatomical joints" if biased else "scatter alone, without a bias of the detector"
    return [
        (
            "median reprojection error",
            f"{number(before)} → {number(after)} px",
            _WHY_RISEN if round(after, 1) > round(before, 1) else "start → refined",
        ),
        ("detections rejected", part_of(rejected, used), f"of {used:,} used"),
        ("median error bar", f"{length(finite_median(bars))} mm", against),
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
    return [group.name, *(cell(group) for *_, cell in _OF_GROUPS)]


def _length(mm: float, sigma: float) -> str:
    digits = decimals(mm, 0, 10.0)
    return f"{number(mm, digits)} ± {number(sigma, digits)}"


def _known(value: float | None) -> float:
    return float("nan") if value is None else value
