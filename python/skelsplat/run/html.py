"""``report.html``: a run, or those of several people, as arrays and plain values."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat import viz
from skelsplat._arrays import Array, Index
from skelsplat._words import Table
from skelsplat.run import tables
from skelsplat.run.angles import angles_of, by_title, world_up
from skelsplat.run.figures import count_of, skeleton_of, tracks_of
from skelsplat.run.frames import problems_of, rows_of
from skelsplat.run.people import CONFIRMED
from skelsplat.run.report import solved_in_words, thinned_in_words
from skelsplat.run.summary import DOWN_WEIGHTED, error_maps, frame_medians, is_biased
from skelsplat.viz import report as page
from skelsplat.viz.people import all_frames, spread_out, with_gaps

if TYPE_CHECKING:
    from skelsplat.findings import Finding, Remedy
    from skelsplat.run._run import PeopleRun, Run
    from skelsplat.viz.report._html import Sentence

_ANGLES = (
    "The bands of joint angles are error bars, one standard deviation. All but those of the layout itself "
    "are 0 in upright standing with the arms hanging; the guide on joint angles has their definitions."
)
_BIASED = (
    "Error bar: one standard deviation per axis against an anatomical joint: the scatter between recordings "
    "of the same pose by the same detector, and how far it places joints from those (joint_bias_mm)."
)
_UNBIASED = (
    "Error bar: one standard deviation per axis: the scatter between recordings of the same pose by the same "
    "detector, without how far it places joints from anatomical ones (joint_bias_mm states it)."
)
_ON_PEOPLE = (
    "A person is found once two views agree on them. Identities are numbers in the order of appearance; the "
    "page of each person, linked in the table, has their cameras, joints and curves.",
    "A camera sees a person where it has a detection of them that is used and not rejected.",
)


def write_html(run: Run, path: Path) -> None:
    """Write the page as one file, which needs no other."""
    statistics = run.statistics
    weights = np.where(np.isfinite(statistics.error_after), run.result.view_weights, np.nan)
    errors_px, rejected = error_maps(statistics.error_after, weights)
    person = str(run.report["input"]["person"])
    data = page.ReportData(
        title=_title(run.report, f"person {person}" if person.isdecimal() else ""),
        facts=tables.facts_of(run.report),
        warnings=sentences(run.findings),
        notes=_notes(run, run.poses.frame_rate, _on_run(run)),
        numbers=tables.key_numbers(run),
        problems=rows_of(problems_of(run.frame_findings), run.frames.tolist()),
        sequence=_sequence(run),
        shapes=camera_shapes(run.cameras),
        tables=shown(tables.of_adjusted(run.report), tables.of_cameras(run), tables.of_joints(run)),
        lines=[*_lines(run), *_angle_lines(run)],
        heat=page.HeatMap(
            "Cameras and joints",
            run.cameras.names,
            run.layout.joints,
            [
                page.Heat("median reprojection error", "px", "median error %{z:.1f} px", errors_px[:-1, :-1]),
                page.Heat("detections rejected", "%", "%{z:.0f}% rejected", 100 * rejected[:-1, :-1], 100.0),
            ],
        ),
        bones=run.outcome.bones_mm(run.inputs),
    )
    page.write_report(path, data)


def write_people_html(run: PeopleRun, path: Path) -> None:
    """Write the page of several people as one file; it links to those of single people."""
    runs, tracks = list(run.people.values()), tracks_of(run)
    first, most = runs[0], run.report["input"]["people"]
    frames = with_gaps(all_frames(tracks))
    facts = tables.facts_of({**first.report, "input": {**first.report["input"], **run.report["input"]}})
    pages = [f"{entry['folder']}/{path.name}" for entry in run.report["people"]]
    marks = [(page.person_class(place), address) for place, address in enumerate(pages)]
    problems = [
        (start, end, f"person {identity}: {words}")
        for identity, one in run.people.items()
        for start, end, words in rows_of(problems_of(one.frame_findings), one.frames.tolist())
    ]
    data = page.ReportData(
        title=_title(run.report, count_of(run)),
        facts=[*facts, *([] if most == "all" else [("people at most", str(most))])],
        warnings=sentences(run.findings),
        notes=_notes(run, first.poses.frame_rate, _ON_PEOPLE),
        numbers=tables.numbers_of_people(run),
        problems=sorted(problems, key=lambda row: row[:2]),
        sequence=everybody(
            tracks,
            frames,
            joint_names=first.layout.joints,
            skeleton=skeleton_of(first.layout),
            up=world_up(first.cameras),
            frame_rate=first.poses.frame_rate,
            start_name=first.outcome.start_name if first.outcome.sequence is None else "frame by frame",
        ),
        shapes=camera_shapes(first.cameras),
        tables=shown(replace(tables.of_people(run), marks=marks), tables.of_adjusted(run.report)),
        lines=lines_of_people(tracks, frames),
        findings=[sentences(one.findings, notes=True) for one in runs],
        views=[spread_out(frames, track.frames, track.views, -1) for track in tracks],
    )
    page.write_report(path, data)


def shown(*every: Table) -> list[Table]:
    """Return the tables that have rows."""
    return [one for one in every if one.rows]


def _title(report: dict[str, Any], of_whom: str) -> str:
    source = report["input"]["detections"]
    named = ", ".join(filter(None, ["" if source is None else Path(source).name, of_whom]))
    return f"SkelSplat: {named}" if named else "SkelSplat"


def sentences(findings: Sequence[Finding], *, notes: bool = False) -> list[Sentence]:
    """Return findings with the settings that help, as in a config file; "…" where the user chooses."""

    def setting(remedy: Remedy) -> str:
        value = "…" if remedy.value is None else json.dumps(remedy.value, ensure_ascii=False)
        return f"{remedy.setting} = {value}"

    shown = (one for one in findings if notes or one.severity != "note")
    return [(one.text, [setting(remedy) for remedy in one.remedy]) for one in shown]


def _notes(run: Run | PeopleRun, rate: float | None, own: Sequence[str]) -> list[str]:
    """Return the notes of a run, its ``own`` sentences, and how to read the 3D view."""
    speed = "" if rate is not None else " The frame rate is unknown: speed 1 × plays 30 frames per second."
    return [
        *filter(None, [run.report["note"]]),
        *(finding.text for finding in run.findings if finding.severity == "note"),
        *own,
        "The 3D view is in metres, in the axes of the calibration; ellipsoids are drawn at two standard "
        "deviations, cut off 0.3 m from the joint (of smaller bodies in proportion), and joints that are "
        f"weak, inferred, filled or unobserved are hollow.{speed}",
    ]


def _on_run(run: Run) -> list[str]:
    return [
        *solved_in_words(run.report),
        *thinned_in_words(run.inputs),
        *run.poses.processing,
        f"The start is the {run.outcome.start_name}; the refined poses are those in the pose files. "
        "Reprojection errors are distances from the detections used, in pixels of the original images: they "
        "measure agreement with the detections, not accuracy.",
        f"Weight: how much each detection is trusted, from 0 to 1; down-weighted below {DOWN_WEIGHTED:g}, "
        f"rejected below {sk.REJECTED_WEIGHT:g}. {_BIASED if is_biased(run.result) else _UNBIASED}",
        *([_ANGLES] if "joint_angles" in run.report else []),
    ]


def camera_shapes(rig: sk.CameraRig, covariances: Array | None = None) -> page.CameraShapes:
    """Return the positions of the cameras and the rays to the corners of their images, in mm.

    ``covariances`` (M, 3, 3) of the positions are in the square of the rig's unit.
    """
    corners = []
    for camera in rig:
        right, low = np.array(camera.size) - 0.5
        pixels = np.array([[-0.5, -0.5, 1.0], [right, -0.5, 1.0], [right, low, 1.0], [-0.5, low, 1.0]])
        corners.append(pixels @ np.linalg.inv(camera.K).T @ np.asarray(camera.R))
    mm = rig.mm_per_unit
    centres = np.array([camera.centre for camera in rig]) * mm
    spread = None if covariances is None else covariances * mm**2
    return page.CameraShapes(rig.names, centres, np.array(corners), spread)


def _sequence(run: Run) -> page.Sequence3D:
    mm, poses, found = run.cameras.mm_per_unit, run.poses, run.outcome.sequence
    return page.Sequence3D(
        start=run.outcome.start * mm,
        refined=poses.pose * mm,
        error_bar=poses.error_bar * mm**2,
        status=poses.joint_status,
        frames=run.frames,
        frame_rate=poses.frame_rate,
        joint_names=run.layout.joints,
        skeleton=skeleton_of(run.layout),
        up=world_up(run.cameras),
        start_name=run.outcome.start_name,
        alone=None if found is None else np.asarray(found.init_pose) * mm,
        speed=None if found is None else np.linalg.norm(found.velocity, axis=-1) * mm,
    )


def everybody(
    tracks: Sequence[viz.PersonTrack], frames: Index, *, joint_names: Sequence[str], **given: Any
) -> page.Sequence3D:
    """Return all people in ``frames`` as one sequence, whose joints are those of one after the other.

    ``joint_names`` are those of one person; ``given`` are further fields of the sequence.
    """

    def together(name: str, empty: object) -> Any:
        values = [spread_out(frames, one.frames, getattr(one, name), empty) for one in tracks]
        return np.concatenate(values, axis=1)

    seen = [float(np.median(one.views)) if len(one.views) else 0.0 for one in tracks]
    return page.Sequence3D(
        start=together("start", np.nan),
        refined=together("refined", np.nan),
        error_bar=together("error_bar", np.nan),
        status=together("status", "unobserved"),
        frames=frames,
        joint_names=[f"{one.name}, {joint}" for one in tracks for joint in joint_names],
        people=[one.name for one in tracks],
        on_floor=[place for place, own in enumerate(seen) if own >= min(CONFIRMED, max(seen))],
        **given,
    )


def _lines(run: Run) -> list[page.TimeLines]:
    result, statistics = run.result, run.statistics
    used = np.isfinite(statistics.error_after)
    before, after = (frame_medians(one) for one in (statistics.error_before, statistics.error_after))
    rejected = statistics.rejected.sum(axis=(1, 2)).astype(float)
    swapped = (used & np.asarray(result.swapped)).sum(axis=(1, 2)).astype(float)
    noise = np.asarray(result.noise) * run.cameras.mm_per_unit
    bars = np.fmax.reduce(statistics.error_bar_mm, axis=1)
    both = [(run.outcome.start_name, "start", before), ("", "left", after)]
    return [
        page.TimeLines("Median reprojection error", "px", both),
        page.TimeLines("Estimated noise of the detections", "mm", [("", "left", noise)]),
        page.TimeLines("Detections rejected", "", [("", "left", rejected)], peaks=True),
        page.TimeLines("Left–right swaps", "", [("", "left", swapped)], peaks=True),
        page.TimeLines("Largest error bar", "mm", [("", "left", bars)], peaks=True),
    ]


def lines_of_people(tracks: Sequence[viz.PersonTrack], frames: Index) -> list[page.TimeLines]:
    """Return the curves of everybody: errors and rejected detections."""

    def curves(values: Sequence[Array]) -> list[tuple[str, str, Array]]:
        spread = [spread_out(frames, one.frames, values[k], np.nan) for k, one in enumerate(tracks)]
        return [(one.name, page.person_class(k), spread[k]) for k, one in enumerate(tracks)]

    errors, rejected = [one.error_px for one in tracks], [100 * one.rejected for one in tracks]
    return [
        page.TimeLines("Median reprojection error", "px", curves(errors)),
        page.TimeLines("Detections rejected", "%", curves(rejected), peaks=True),
    ]


def _angle_lines(run: Run) -> list[page.TimeLines]:
    """Return the joint angles, left and right together, if they are among the results."""
    if "joint_angles" not in run.report:
        return []
    found = angles_of(run)
    return [
        page.TimeLines(
            title,
            "°",
            [(side, side or "middle", found.degrees[:, k]) for side, k in sides],
            sigmas=[found.sigma[:, k] for _, k in sides],
        )
        for title, sides in by_title(found.names).items()
    ]
