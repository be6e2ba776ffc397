"""The order of a run, shared by the commands: read, refine, count, write, tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from skelsplat._json import to_text
from skelsplat._optional import can_draw
from skelsplat.cli.output import bar_of, print_json
from skelsplat.cli.table import print_doubts, print_files, print_left, print_over_time, print_summary, tell
from skelsplat.findings import Finding, collected_warnings, remark
from skelsplat.io import PoseData, write_pose
from skelsplat.io._atomic import atomic_write_text
from skelsplat.io._run_files import REPORT
from skelsplat.io.poses import MARKER_NAMES, POSE_FORMATS, check_pose_format
from skelsplat.io.run_folder import write_run_inputs
from skelsplat.run.figures import write_figures
from skelsplat.run.findings import find_doubts, is_of_size
from skelsplat.run.folder import (
    begin_writing,
    check_places,
    keep_input,
    left_of_earlier,
    output_folder,
    planned,
)
from skelsplat.run.frames import find_problems
from skelsplat.run.html import Findings, write_html_report
from skelsplat.run.over_time import apply_over_time, nothing_filled
from skelsplat.run.read import read_inputs
from skelsplat.run.report import build_report
from skelsplat.run.solve import refine_inputs
from skelsplat.run.summary import summarise

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.progress import Progress

    from skelsplat.run.job import Job, Verbosity
    from skelsplat.run.read import Inputs
    from skelsplat.run.solve import Outcome

_ASSUMED_FPS = 30.0
_NEED_FPS = [kind for kind, entry in POSE_FORMATS.items() if "y_up" in entry.options]


def run(job: Job, verbosity: Verbosity) -> dict[str, Any]:
    """Do one job: write its files, print what `verbosity` asks for, and return the report.

    Raises
    ------
    SkelSplatError
        If an input is missing, malformed or does not fit, or a result cannot be written.
    typer.BadParameter
        If results would be written over the input.
    """
    keep_input(job)
    check_places(job)
    with output_folder(job.out):
        return _run(job, verbosity)


def _run(job: Job, verbosity: Verbosity) -> dict[str, Any]:
    with collected_warnings(tell) as notes:
        inputs = read_inputs(job)
        keep_input(job, inputs.sources)
        for kind in job.write:
            check_pose_format(kind, inputs.frames)
        timed = [f"pose.{kind}" for kind in job.write if kind in _NEED_FPS]
        for option in _unused(job) if not timed else ():
            notes.append(
                remark(f"{option}: not used; it is for pose.trc and pose.c3d, and --write names neither")
            )
            tell(notes[-1])
        if job.fps is None and timed:
            files = " and ".join(timed)
            assumed = f"the times in {files} assume {_ASSUMED_FPS:g} frames per second"
            notes.append(remark(f"--fps: not given; {assumed}"))
            tell(notes[-1])
        if not can_draw():
            notes.append(Finding("no_pictures"))
            tell(notes[-1])
        outcome = _refine_with_bar(inputs, job, shown=not verbosity.quiet)
    warnings = [note.text for note in notes]
    statistics = summarise(inputs, outcome)
    poses, over_time = apply_over_time(_poses(job, inputs, outcome), job.over_time)
    statistics = statistics.without_bars(poses.joint_status == "filled")
    doubts = find_doubts(inputs, outcome, statistics, poses.joint_status)
    problems = find_problems(inputs, outcome, statistics, poses.joint_status)
    remarks = {
        "warnings": warnings,
        "doubts": doubts,
        "frames_with_a_problem": [problem.to_dict() for problem in problems],
        "over_time": over_time,
        "files": planned(job),
    }
    report = build_report(job, inputs, outcome, statistics, remarks)
    begin_writing(job.out, report)
    names = _write_poses(job, poses)
    names += write_run_inputs(job.out, inputs.rig, inputs.layout, inputs.detections, inputs.frames)
    names += [REPORT, *(write_figures(job, inputs, outcome, statistics) if can_draw() else [])]
    if job.html and can_draw():
        findings = Findings(poses, problems, distrust=[*doubts, *warnings])
        names += write_html_report(job, inputs, outcome, statistics, findings)
    atomic_write_text(job.out / REPORT, to_text(report))  # last: the run is whole
    if verbosity.as_json or verbosity.quiet:
        for doubt in doubts:
            _tell(doubt)
    if verbosity.as_json:
        print_json(report)
    elif not verbosity.quiet:
        console = Console(highlight=False, markup=False)
        print_summary(console, job, inputs, outcome, statistics)
        print_doubts(console, [*filter(is_of_size, warnings), *doubts])
        print_over_time(console, [*nothing_filled(over_time), *poses.processing])
        print_files(console, job.out, names)
        print_left(console, left_of_earlier(job.out))
    return report


def _unused(job: Job) -> list[str]:
    """Return the options that are for files with markers alone, where they are not at their defaults."""
    given = {"--y-up": job.y_up, "--marker-names": job.marker_names != MARKER_NAMES[0]}
    return [option for option, value in given.items() if value]


def _tell(warning: str) -> None:
    typer.echo(f"warning: {warning}", err=True)


def _refine_with_bar(inputs: Inputs, job: Job, *, shown: bool) -> Outcome:
    """Refine under a progress bar on stderr, if that is a terminal."""
    with bar_of("frames", shown=shown) as bar:
        return refine_inputs(inputs, job, _updater(bar, len(inputs.frames)))


def _updater(bar: Progress, frames: int) -> Callable[[int, int], None]:
    task = bar.add_task("refining", total=frames)

    def update(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)

    return update


def _poses(job: Job, inputs: Inputs, outcome: Outcome) -> PoseData:
    return PoseData.from_refinement(
        outcome.result,
        joint_names=inputs.layout.joints,
        frames=inputs.frames,
        camera_names=inputs.rig.names,
        unit=inputs.rig.unit,
        frame_rate=job.fps,
    )


def _write_poses(job: Job, data: PoseData) -> list[str]:
    """Write the pose files that the job asks for; return their names."""
    given = {"frame_rate": job.fps or _ASSUMED_FPS, "y_up": job.y_up, "marker_names": job.marker_names}
    names = []
    for kind in job.write:
        options = given if kind in _NEED_FPS else {}
        names.append(f"pose.{kind}")
        write_pose(job.out / names[-1], data, **options)
    return names
