"""``report.html``: a run as arrays and plain values for the page of `skelsplat.viz`."""

from __future__ import annotations

import base64
import html
import importlib
import sys
import tempfile
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._optional import can_draw
from skelsplat._words import number
from skelsplat.run.angles import angles_of, by_title
from skelsplat.run.frames import problems_of, rows_of
from skelsplat.run.report import MEANINGS, solved_in_words, thinned_in_words
from skelsplat.run.summary import DOWN_WEIGHTED, error_maps, finite_median, frame_medians, is_biased
from skelsplat.run.vertical import world_up

if TYPE_CHECKING:
    from skelsplat.run._run import Run
    from skelsplat.run.read import Inputs
    from skelsplat.run.summary import Group, Statistics
    from skelsplat.viz import report as page


_SHARED = (
    ("median [px]", "median reprojection error, start → refined"),
    ("90th percentile [px]", "of the reprojection error, start → refined"),
    ("used", "detections used"),
    ("missing", "no detection of the followed person"),
    ("not chosen", "of the missing: no person detected in this view matches the other cameras"),
    ("left out", "detections below the minimum confidence, or of a joint without a position"),
    ("down-weighted", f"detections used with a weight below {DOWN_WEIGHTED:g}, including the rejected ones"),
    ("rejected", f"detections used with a weight below {sk.REJECTED_WEIGHT:g}, which hardly affect the pose"),
    ("weight", MEANINGS["mean_weight"]),
    ("swapped", MEANINGS["swapped"]),
)
_ANGLES = (
    "Joint angles have the colours of the sides of the body in the 3D view; their bands are error bars, one "
    "standard deviation. All are 0 in upright standing with the arms hanging; the guide on joint angles has "
    "their definitions."
)
_BIASED = (
    "Error bar: one standard deviation per axis against an anatomical joint. It contains the scatter, what "
    "another recording of the same pose by the same detector would give, and how far detectors place joints "
    "from anatomical ones in all views and frames (--joint-bias-mm)."
)
_UNBIASED = (
    "Error bar: one standard deviation per axis. It is the scatter, what another recording of the same pose "
    "by the same detector would give; how far the detector places joints from anatomical ones is not "
    "included (--joint-bias-mm states it)."
)
_OF_JOINTS = (
    ("views used", "views with a detection that is used and not rejected: median over the frames (lowest)"),
    (
        "error bar [mm]",
        "standard deviation per axis against an anatomical joint, median over the frames "
        "(in brackets the scatter, a part of it)",
    ),
    ("moved [mm]", "median distance of the refined joint from its start"),
)


def write_html(run: Run, path: Path) -> None:
    """Write the page as one file, which needs no other."""
    from skelsplat.viz import report as page  # matplotlib takes long to load, and --help does without

    inputs, statistics = run.inputs, run.statistics
    source = run.report["input"]["detections"]
    weights = np.where(np.isfinite(statistics.error_after), run.result.view_weights, np.nan)
    errors_px, rejected = error_maps(statistics.error_after, weights)
    data = page.ReportData(
        title="SkelSplat" if source is None else f"SkelSplat: {Path(source).name}{_of_whom(run)}",
        facts=facts_of(run.report),
        warnings=[finding.text for finding in run.findings if finding.severity != "note"],
        notes=_notes(run),
        numbers=key_numbers(run),
        sequence=_sequence(run),
        shapes=camera_shapes(inputs.rig),
        cameras=page.Table(
            [("camera", ""), *_SHARED],
            [_cells(group) for group in statistics.cameras],
            _cells(statistics.total),
        ),
        joints=_joint_table(inputs, statistics),
        errors_px=errors_px[:-1, :-1],
        rejected=rejected[:-1, :-1],
        lines=[*_lines(run), *_angle_lines(run)],
        problems=rows_of(problems_of(run.frame_findings), inputs.frames.tolist()),
        bones=_bones(run),
    )
    page.write_report(path, data)


def _of_whom(run: Run) -> str:
    """Return the number of the person for the title, if one of several was chosen by number."""
    person = run.report["input"]["person"]
    return f", person {person}" if str(person).isdecimal() else ""


def show_page(run: Run) -> None:
    """Show the page below a notebook's cell, or in the browser."""
    path = Path(tempfile.mkdtemp(prefix="skelsplat-")) / "report.html"
    write_html(run, path)
    shell = sys.modules.get("IPython")
    if shell is None or getattr(shell.get_ipython(), "kernel", None) is None:
        webbrowser.open(path.as_uri())
        return
    page = html.escape(path.read_text(encoding="utf-8"))
    frame = f'<iframe srcdoc="{page}" width="100%" height="800" frameborder="0"></iframe>'
    notebook = importlib.import_module("IPython.display")
    notebook.display(notebook.HTML(frame))


def notebook_view(run: Run) -> str:
    """Return facts, numbers, findings and the overview as HTML, for the output of a notebook's cell."""
    remarked = [(name, f"{value} ({remark})") for name, value, remark in key_numbers(run)]
    rows = [*facts_of(run.report), *remarked]
    cells = "".join(
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows
    )
    found = "".join(
        f"<li>{html.escape(finding.severity)}: {html.escape(finding.text)}</li>" for finding in run.findings
    )
    listed = f"<ul>{found}</ul>" if found else "<p>No findings.</p>"
    return f"<table>{cells}</table>{listed}{_picture(run) if can_draw() else ''}"


def _picture(run: Run) -> str:
    """Return the overview as an element of HTML."""
    from skelsplat.run.figures import write_figures  # as in write_html

    with tempfile.TemporaryDirectory() as folder:
        write_figures(run, Path(folder))
        picture = base64.b64encode((Path(folder) / "overview.png").read_bytes()).decode()
    return f'<img alt="overview" style="max-width: 100%" src="data:image/png;base64,{picture}">'


def camera_shapes(rig: sk.CameraRig) -> page.CameraShapes:
    """Return the positions of the cameras and the rays to the corners of their images, in mm."""
    from skelsplat.viz import report as page  # as in write_html

    corners = []
    for camera in rig:
        width, height = camera.size
        pixels = np.array(
            [[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]]
        )
        rays = np.hstack([pixels, np.ones((4, 1))]) @ np.linalg.inv(camera.K).T
        corners.append(rays @ np.asarray(camera.R))
    centres = np.array([camera.centre for camera in rig]) * rig.mm_per_unit
    return page.CameraShapes(rig.names, centres, np.array(corners))


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
    total = statistics.total
    frames = {frame for finding in problems_of(run.frame_findings) for frame in finding.subject.frames}
    digits = statistics.decimals
    scatter = f"against anatomical joints; scatter {number(finite_median(statistics.scatter_mm), digits)} mm"
    return [
        (
            "median reprojection error",
            f"{number(total.before_px)} → {number(total.after_px)} px",
            "start → refined",
        ),
        ("detections rejected", part_of(total.rejected, total.used), f"of {total.used:,} used"),
        (
            "noise of the detections",
            f"{number(statistics.noise_px)} px",
            f"{number(statistics.noise_mm, digits)} mm across the ray, estimated",
        ),
        (
            "median error bar",
            f"{number(finite_median(statistics.error_bar_mm), digits)} mm",
            scatter if is_biased(run.result) else "scatter alone, without a bias of the detector",
        ),
        (
            "frames with a problem",
            f"{len(frames):,} of {run.inputs.n_frames:,}",
            "weak, missing or unusual joints",
        ),
    ]


def _notes(run: Run) -> list[str]:
    note = run.report["note"]
    return [
        *([note] if note else []),
        *(finding.text for finding in run.findings if finding.severity == "note"),
        *solved_in_words(run.report),
        *thinned_in_words(run.inputs),
        *run.poses.processing,
        f"The start is the {run.outcome.start_name}; the refined poses are those in the pose files. "
        "Reprojection errors are distances from the detections used, in pixels of the original images: they "
        "measure agreement with the detections, not accuracy.",
        f"Weight: how much each detection is trusted, from 0 to 1; down-weighted below {DOWN_WEIGHTED:g}, "
        f"rejected below {sk.REJECTED_WEIGHT:g}. {_BIASED if is_biased(run.result) else _UNBIASED}",
        *([_ANGLES] if "joint_angles" in run.report else []),
        *of_the_view(run.poses.frame_rate),
    ]


def of_the_view(rate: float | None) -> list[str]:
    """Return sentences on how to read the 3D view."""
    speed = "" if rate is not None else " The frame rate is unknown: speed 1 × plays 30 frames per second."
    return [
        "The 3D view is in metres, in the axes of the calibration; ellipsoids are drawn at two standard "
        "deviations, cut off 0.3 m from the joint, and joints that are weak, inferred, filled or "
        f"unobserved are hollow.{speed}"
    ]


def _sequence(run: Run) -> page.Sequence3D:
    from skelsplat.run.figures import skeleton_of  # as in write_html
    from skelsplat.viz.report import Sequence3D

    mm, poses, found = run.cameras.mm_per_unit, run.poses, run.outcome.sequence
    return Sequence3D(
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


def _bones(run: Run) -> list[tuple[int, int, float, float]]:
    """Return the bones of a solution over time with their lengths and standard errors in mm."""
    found, mm = run.outcome.sequence, run.cameras.mm_per_unit
    if found is None:
        return []
    sizes = zip(found.bones.tolist(), found.bone_lengths * mm, found.bone_length_sigma * mm, strict=True)
    return [(a, b, float(length), float(sigma)) for (a, b), length, sigma in sizes]


def _lines(run: Run) -> list[page.TimeLine]:
    from skelsplat.viz.report import TimeLine  # as in write_html

    result, statistics = run.result, run.statistics
    used = np.isfinite(statistics.error_after)
    swapped = (used & np.asarray(result.swapped)).sum(axis=(1, 2))
    bars = np.fmax.reduce(statistics.error_bar_mm, axis=1)
    noise = np.asarray(result.noise) * run.cameras.mm_per_unit
    return [
        TimeLine(
            "Median reprojection error",
            "px",
            frame_medians(statistics.error_after),
            beside=frame_medians(statistics.error_before),
            beside_name=run.outcome.start_name,
        ),
        TimeLine("Estimated noise of the detections", "mm", noise),
        TimeLine("Detections rejected", "", statistics.rejected.sum(axis=(1, 2)).astype(float), peaks=True),
        TimeLine("Left–right swaps", "", swapped.astype(float), peaks=True),
        TimeLine("Largest error bar", "mm", bars, peaks=True),
    ]


def _angle_lines(run: Run) -> list[page.TimeLines]:
    """Return the joint angles, left and right together, if they are among the results."""
    from skelsplat.viz.report import TimeLines  # as in write_html

    if "joint_angles" not in run.report:
        return []
    found = angles_of(run)
    return [
        TimeLines(
            title,
            "°",
            [(side, side or "middle", found.degrees[:, k]) for side, k in sides],
            sigmas=[found.sigma[:, k] for _, k in sides],
        )
        for title, sides in by_title(found.names).items()
    ]


def _joint_table(inputs: Inputs, statistics: Statistics) -> page.Table:
    """Return a row per joint."""
    from skelsplat.viz.report import Table  # as in write_html

    rows, digits = [], statistics.decimals
    for j, group in enumerate(statistics.joints):
        views = statistics.views_used[:, j]
        bar, scatter = (finite_median(mm[:, j]) for mm in (statistics.error_bar_mm, statistics.scatter_mm))
        own = [
            f"{np.median(views):g} ({views.min()})",
            f"{number(bar, digits)} ({number(scatter, digits)})",
            number(finite_median(statistics.moved_mm[:, j]), digits),
        ]
        rows.append([*_cells(group), *own])
    (views_used, meaning), *others = _OF_JOINTS
    views_used = f"{views_used}, of {len(inputs.rig)}"
    return Table([("joint", ""), *_SHARED, (views_used, meaning), *others], rows)


def _cells(group: Group) -> list[str]:
    return [
        group.name,
        f"{number(group.before_px)} → {number(group.after_px)}",
        f"{number(group.p90_before_px)} → {number(group.p90_after_px)}",
        f"{group.used:,}",
        f"{group.missing:,}",
        f"{group.not_chosen:,}",
        f"{group.left_out:,}",
        part_of(group.down_weighted, group.used),
        part_of(group.rejected, group.used),
        number(group.mean_weight, 2),
        f"{group.swapped:,}",
    ]


def part_of(count: int, of: int) -> str:
    """Return a part as a percentage, a dash if it is a part of nothing."""
    return f"{100 * count / of:.1f}%" if of else "–"
