"""``report.html``: what a run says, as arrays and plain values for the page of `skelsplat.viz`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat.run.figures import start_name, world_up
from skelsplat.run.frames import runs_in_words
from skelsplat.run.html_tables import camera_table, joint_table, number, share
from skelsplat.run.summary import DOWN_WEIGHTED, finite_max, finite_median, frame_medians

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from skelsplat.io import PoseData
    from skelsplat.run.frames import Problem
    from skelsplat.run.job import Job
    from skelsplat.run.read import Inputs
    from skelsplat.run.solve import Outcome
    from skelsplat.run.summary import Statistics
    from skelsplat.viz import report as page

    Array = npt.NDArray[np.float64]

NAME = "report.html"


@dataclass(frozen=True)
class Findings:
    """What the page shows beside the statistics.

    Parameters
    ----------
    poses
        Those that are written: filled and filtered, if that was asked for.
    problems
        Frames to look at.
    distrust
        Sentences: doubts and warnings.
    """

    poses: PoseData
    problems: Sequence[Problem]
    distrust: Sequence[str]


def write_html_report(
    job: Job,
    inputs: Inputs,
    outcome: Outcome,
    statistics: Statistics,
    findings: Findings,
) -> list[str]:
    """Write ``report.html`` and return its name."""
    from skelsplat.viz import report as page  # matplotlib takes long to load, and --help does without

    data = page.ReportData(
        title=f"SkelSplat: {job.detections.name}",
        facts=_facts(job, inputs),
        warnings=findings.distrust,
        notes=_notes(job, findings.poses),
        numbers=_numbers(inputs, statistics, findings.problems),
        sequence=_sequence(job, inputs, outcome, findings.poses),
        shapes=camera_shapes(inputs.rig),
        cameras=camera_table(statistics),
        joints=joint_table(inputs, statistics),
        heat=page.HeatMaps(
            errors_px=_by_view_and_joint(statistics.error_after, finite_median),
            rejected=_shares(statistics),
        ),
        lines=_lines(job, inputs, outcome, statistics),
        problems=[page.ProblemRow(*run) for run in runs_in_words(findings.problems)],
    )
    page.write_report(job.out / NAME, data)
    return [NAME]


def camera_shapes(rig: sk.CameraRig) -> page.CameraShapes:
    """Return the positions of the cameras and the rays to the corners of their images, in mm."""
    from skelsplat.viz import report as page  # as in write_html_report

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


def _facts(job: Job, inputs: Inputs) -> list[tuple[str, str]]:
    frames = inputs.frames
    span = f"{len(frames):,}, {frames[0]} to {frames[-1]}" if len(frames) > 1 else f"1, frame {frames[0]}"
    return [
        ("calibration", str(job.calibration)),
        ("detections", f"{job.detections} ({inputs.format})"),
        ("layout", f"{inputs.layout.name}, {inputs.layout.n_joints} joints"),
        ("cameras", str(len(inputs.rig))),
        ("frames", span),
        ("frame rate", "unknown" if job.fps is None else f"{job.fps:g} per second"),
        ("preset", "paper" if job.paper else "default"),
        ("unit of the calibration", inputs.rig.unit),
        ("skelsplat", sk.__version__),
    ]


def _notes(job: Job, poses: PoseData) -> list[str]:
    speed = "" if job.fps is not None else " The frame rate is unknown: speed 1 × plays 30 frames per second."
    return [
        *([job.note] if job.note else []),
        *poses.processing,
        f"The start is the {start_name(job)}; the refined poses are those in the pose files. Reprojection "
        "errors are distances from the detections used, in pixels of the original images: they measure "
        "agreement with the detections, not accuracy.",
        f"Weight: how much each detection is trusted, from 0 to 1; down-weighted below {DOWN_WEIGHTED:g}, "
        f"rejected below {sk.REJECTED_WEIGHT:g}. Error bar: one standard deviation per axis.",
        "The 3D view is in metres, in the axes of the calibration; ellipsoids are drawn at two standard "
        f"deviations, and joints that are weak, filled or unobserved are hollow.{speed}",
    ]


def _numbers(inputs: Inputs, statistics: Statistics, problems: Sequence[Problem]) -> list[page.KeyNumber]:
    from skelsplat.viz.report import KeyNumber  # as in write_html_report

    total, frames = statistics.total, len(inputs.frames)
    error = f"{number(total.before_px)} → {number(total.after_px)} px"
    largest = finite_max(statistics.error_bar_mm)
    return [
        KeyNumber("median reprojection error", error, "start → refined"),
        KeyNumber("detections rejected", share(total.rejected, total.used), f"of {total.used:,} used"),
        KeyNumber(
            "noise of the detections",
            f"{number(statistics.noise_px)} px",
            f"{number(statistics.noise_mm)} mm across the ray, estimated",
        ),
        KeyNumber(
            "median error bar",
            f"{number(finite_median(statistics.error_bar_mm))} mm",
            f"largest {number(largest, 0)} mm",
        ),
        KeyNumber("frames with a problem", f"{len(problems):,} of {frames:,}", "listed below"),
    ]


def _sequence(job: Job, inputs: Inputs, outcome: Outcome, poses: PoseData) -> page.Sequence3D:
    from skelsplat import viz  # as in write_html_report

    mm, layout = inputs.rig.mm_per_unit, inputs.layout
    return viz.report.Sequence3D(
        start=outcome.start * mm,
        refined=poses.pose * mm,
        uncertainty=poses.uncertainty * mm**2,
        status=poses.joint_status,
        frames=inputs.frames,
        frame_rate=job.fps,
        joint_names=layout.joints,
        skeleton=viz.Skeleton(limbs=tuple(layout.limbs), left_right=tuple(layout.left_right)),
        up=world_up(inputs.rig),
        start_name=start_name(job),
    )


def _lines(job: Job, inputs: Inputs, outcome: Outcome, statistics: Statistics) -> list[page.TimeLine]:
    from skelsplat.viz.report import TimeLine  # as in write_html_report

    used = np.isfinite(statistics.error_after)
    swapped = (used & np.asarray(outcome.result.swapped)).sum(axis=(1, 2))
    bars = np.fmax.reduce(statistics.error_bar_mm, axis=1)
    noise = np.asarray(outcome.result.noise) * inputs.rig.mm_per_unit
    return [
        TimeLine(
            "Median reprojection error",
            "px",
            frame_medians(statistics.error_after),
            beside=frame_medians(statistics.error_before),
            beside_name=start_name(job),
        ),
        TimeLine("Estimated noise of the detections", "mm", noise),
        TimeLine("Detections rejected", "", statistics.rejected.sum(axis=(1, 2)).astype(float), peaks=True),
        TimeLine("Detections with left and right exchanged", "", swapped.astype(float), peaks=True),
        TimeLine("Largest error bar", "mm", bars, peaks=True),
    ]


def _by_view_and_joint(values: Array, of: Any) -> Array:
    """Return ``of`` the values (T, M, N) of every view and joint, (M, N)."""
    _, views, joints = values.shape
    return np.array([[of(values[:, i, j]) for j in range(joints)] for i in range(views)])


def _shares(statistics: Statistics) -> Array:
    used = np.isfinite(statistics.error_after).sum(axis=0)
    shares: Array = np.where(used > 0, statistics.rejected.sum(axis=0) / np.maximum(used, 1), np.nan)
    return shares
