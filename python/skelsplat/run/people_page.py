"""``report.html`` and ``overview.png`` of several people: their runs as arrays and plain values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat import viz
from skelsplat._arrays import Array
from skelsplat._words import decimals, length, number
from skelsplat.run.figures import skeleton_of
from skelsplat.run.frames import problems_of, rows_of
from skelsplat.run.html import camera_shapes, facts_of, of_the_view, part_of
from skelsplat.run.summary import finite_median, frame_medians, is_biased
from skelsplat.run.vertical import world_up
from skelsplat.viz import report as page

if TYPE_CHECKING:
    from skelsplat.run._run import Run
    from skelsplat.run.several import PeopleRun

_COLUMNS = (
    ("person", ""),
    ("frames", "from the first to the last in which two views see the person"),
    ("seen", "frames in which a view sees the person"),
    ("views", "median number of views that see the person"),
    ("median error [px]", "median reprojection error, start → refined"),
    ("rejected", "part of the detections used that hardly affects the pose"),
    ("error bar [mm]", "median against an anatomical joint, one standard deviation per axis"),
    (
        "limbs",
        "range of the lengths of arms and legs frame by frame, 5th to 95th percentile, as a part of the "
        "length; large if two people are mixed",
    ),
    ("problems", "frames with weak, missing or unusual joints"),
    ("warnings", "on this person, listed below"),
)


def write_people_page(run: PeopleRun, path: Path) -> None:
    """Write the page as one file; it links to those of single people."""
    first, entries, most = _first(run), run.report["people"], run.report["input"]["people"]
    source = run.report["input"]["detections"]
    data = page.PeopleReportData(
        title="SkelSplat: " + ("" if source is None else f"{Path(source).name}, ") + _count(run),
        facts=[
            *facts_of({**first.report, "input": {**first.report["input"], **run.report["input"]}}),
            *([] if most == "all" else [("people at most", str(most))]),
        ],
        warnings=[finding.text for finding in run.findings if finding.severity != "note"],
        notes=_notes(run),
        numbers=_numbers(run),
        people=tracks_of(run),
        findings=[[finding.text for finding in one.findings] for one in run.people.values()],
        table=page.Table(
            _COLUMNS,
            [_row(entry, one) for entry, one in zip(entries, run.people.values(), strict=True)],
            marks=[
                (page.person_class(place), f"{entry['folder']}/report.html")
                for place, entry in enumerate(entries)
            ],
        ),
        bones=_bones(list(run.people.values()), [name_of(identity) for identity in run.people]),
        joint_names=first.layout.joints,
        skeleton=skeleton_of(first.layout),
        shapes=camera_shapes(first.cameras),
        up=world_up(first.cameras),
        frame_rate=first.poses.frame_rate,
        start_name=_start(first),
        problems=_problems(run),
    )
    page.write_people_report(path, data)


def write_people_figure(run: PeopleRun, path: Path) -> None:
    """Draw the paths from above, who is there when, and everybody in one frame."""
    cameras, source = _first(run).cameras, run.report["input"]["detections"]
    title = _count(run) if source is None else f"{Path(source).name}: {_count(run)}"
    data = viz.PeopleData(
        people=tracks_of(run),
        camera_names=cameras.names,
        centres=np.array([camera.centre for camera in cameras]) * cameras.mm_per_unit,
        up=world_up(cameras),
        skeleton=skeleton_of(_first(run).layout),
        title=title,
    )
    viz.write_people(path, data)


def name_of(identity: int) -> str:
    """Return what a person is called in pictures and pages."""
    return f"person {identity}"


def tracks_of(run: PeopleRun) -> list[viz.PersonTrack]:
    """Return everybody as arrays in mm."""
    return [_track(name_of(identity), one) for identity, one in run.people.items()]


def _track(name: str, run: Run) -> viz.PersonTrack:
    mm, found, statistics = run.cameras.mm_per_unit, run.outcome.sequence, run.statistics
    used = np.isfinite(statistics.error_after)
    with np.errstate(invalid="ignore"):
        rejected = statistics.rejected.sum(axis=(1, 2)) / used.sum(axis=(1, 2))
    return viz.PersonTrack(
        name=name,
        frames=run.frames,
        start=(run.outcome.start if found is None else np.asarray(found.init_pose)) * mm,
        refined=run.poses.pose * mm,
        error_bar=run.poses.error_bar * mm**2,
        status=run.poses.joint_status,
        seen=np.any(used & ~statistics.rejected, axis=2),
        error_px=frame_medians(statistics.error_after),
        rejected=rejected,
    )


def _first(run: PeopleRun) -> Run:
    return next(iter(run.people.values()))


def _count(run: PeopleRun) -> str:
    return "1 person" if len(run.people) == 1 else f"{len(run.people)} people"


def _start(run: Run) -> str:
    return run.outcome.start_name if run.outcome.sequence is None else "frame by frame"


def _notes(run: PeopleRun) -> list[str]:
    note = run.report["note"]
    return [
        *([note] if note else []),
        *(finding.text for finding in run.findings if finding.severity == "note"),
        "A person is found once two views agree on them. Identities are numbers in the order of appearance; "
        "the page of each person, linked in the table, has their cameras, joints and curves.",
        "A camera sees a person where it has a detection of them that is used and not rejected. The distance "
        "to the nearest other person is between the medians of their joints.",
        *of_the_view(_first(run).poses.frame_rate),
        "The floor grid lies at the lowest joint of the people whom three views or more see, or of "
        "those with the most views.",
    ]


def _numbers(run: PeopleRun) -> list[tuple[str, str, str]]:
    """Return the key numbers: name, value and remark."""
    groups = [one.statistics.total for one in run.people.values()]
    used, rejected = sum(group.used for group in groups), sum(group.rejected for group in groups)
    before, after = (
        finite_median(np.concatenate([getattr(one.statistics, name).ravel() for one in run.people.values()]))
        for name in ("error_before", "error_after")
    )
    bars = np.concatenate([one.statistics.error_bar_mm.ravel() for one in run.people.values()])
    biased = any(is_biased(one.result) for one in run.people.values())
    against = "against anatomical joints" if biased else "scatter alone, without a bias of the detector"
    cameras = run.report["detections"]["cameras"]
    assigned, detected = (sum(camera[name] for camera in cameras) for name in ("assigned", "detected"))
    return [
        ("people", str(len(run.people)), f"in {len(run.frames):,} frames"),
        (
            "detected people assigned",
            part_of(assigned, detected),
            f"of {detected:,} in all views, to the people above",
        ),
        ("median reprojection error", f"{number(before)} → {number(after)} px", "start → refined"),
        ("detections rejected", part_of(rejected, used), f"of {used:,} used"),
        ("median error bar", f"{length(finite_median(bars))} mm", against),
    ]


def _row(entry: dict[str, Any], run: Run) -> list[str]:
    total, limbs = run.statistics.total, entry["limb_range"]
    frames = {frame for finding in problems_of(run.frame_findings) for frame in finding.subject.frames}
    return [
        name_of(entry["id"]),
        f"{entry['frames']:,}, {entry['first_frame']} to {entry['last_frame']}",
        f"{sum(last - first + 1 for first, last in entry['seen']):,}",
        f"{entry['views_median']:g}",
        f"{number(total.before_px)} → {number(total.after_px)}",
        part_of(total.rejected, total.used),
        length(finite_median(run.statistics.error_bar_mm)),
        "–" if limbs is None or not np.isfinite(limbs) else f"{100 * limbs:.0f}%",
        f"{len(frames):,}",
        str(len(run.findings)),
    ]


def _problems(run: PeopleRun) -> list[tuple[int, int, str]]:
    rows = [
        (first, last, f"{name_of(identity)}: {words}")
        for identity, one in run.people.items()
        for first, last, words in rows_of(problems_of(one.frame_findings), one.frames.tolist())
    ]
    return sorted(rows, key=lambda row: row[:2])


def _bones(runs: Sequence[Run], names: Sequence[str]) -> page.Table:
    """Return the lengths of bones over all frames; no rows if the poses were not solved over time."""
    columns = [("bone", ""), *((name, "") for name in names)]
    solved = [one.outcome.sequence for one in runs]
    mm, joints = runs[0].cameras.mm_per_unit, runs[0].layout.joints
    lengths: list[dict[tuple[int, int], str]] = []
    for found in solved:
        if found is None:
            return page.Table(columns, [])
        sizes = np.stack([found.bone_lengths, found.bone_length_sigma], axis=1) * mm
        ends = [(a, b) for a, b in found.bones.tolist()]
        lengths.append({bone: _length(size) for bone, size in zip(ends, sizes, strict=True)})
    every = list(dict.fromkeys(bone for own in lengths for bone in own))
    words = {bone: " – ".join(joints[j].replace("_", " ") for j in bone) for bone in every}
    rows = [[words[bone], *(own.get(bone, "–") for own in lengths)] for bone in every]
    return page.Table(columns, [row for row in rows if set(row[1:]) != {"–"}])


def _length(size: Array) -> str:
    digits = decimals(size[0], 0, 10.0)
    return " ± ".join(number(mm, digits) for mm in size) if np.isfinite(size).all() else "–"
