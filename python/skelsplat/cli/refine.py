"""``skelsplat refine`` and ``demo``: the method on a user's own recording, and on the one that ships."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import typer

import skelsplat as sk
from skelsplat._words import px
from skelsplat.cli import options
from skelsplat.cli._app import FAILED
from skelsplat.cli.command import takes
from skelsplat.cli.output import Terminal, print_json, print_text, progress, quieter, tell, tell_all
from skelsplat.cli.rows import AS_JSON, QUIET, rows
from skelsplat.cli.table import print_files, print_people, print_run
from skelsplat.findings import Finding, collected_warnings
from skelsplat.io import sample, write_calibration
from skelsplat.run import Job, PeopleRun, Run, run, run_people
from skelsplat.run.calibrate import calibrate_cameras
from skelsplat.run.folder import run_folder

_EPILOG = (
    "Results in FOLDER: pose.npz, pose.csv and pose.trc (or the formats of --write), report.json, "
    "report.html, figures, angles, opensim/, and the input as used. With --people they are in the folder of "
    "each person, and report.html, overview.png, and people.csv, people.json or people.nc have everybody. "
    "Files of an earlier run are removed first; plots/ and overlay/ are kept. Long recordings are done in "
    "parts, unless an option needs all frames at once."
)


@takes(*options.JOB, QUIET, AS_JSON, short=True, epilog=_EPILOG)
def refine(*, quiet: bool, as_json: bool, **given: Any) -> None:
    """Refine the 3D pose of one person, or of several, from 2D detections.

    [bold]Examples[/bold]

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b --fps 60

    skelsplat refine --config run.toml --fps 60 --people all
    """
    run_and_print(options.job_of(**given), quiet=quiet, as_json=as_json)


def run_and_print(job: Job, *, quiet: bool, as_json: bool) -> Run | PeopleRun:
    """Do a job that names a folder, under a progress bar, print the results and return them."""
    with quieter(quiet):
        printed: list[Finding] = []

        def tell_now(finding: Finding) -> None:
            printed.append(finding)
            tell(finding)

        with progress("frames", first="refining") as show:
            given: dict[str, Any] = {
                "progress": lambda done, total: show("refining" if done < total else "writing", done, total),
                "tell": tell_now,
            }
            found: Run | PeopleRun = run(job, **given) if job.people is None else run_people(job, **given)
        errors = [finding for finding in found.findings if finding.severity == "error"]
        if as_json or quiet:
            tell_all(one for one in found.findings if one not in (*printed, *errors))
            for identity, person in found.people.items() if isinstance(found, PeopleRun) else ():
                serious = (one for one in person.findings if one.severity != "note")
                tell_all(serious, of=f"person {identity}: ")
        if as_json:
            print_json(found.report)
        elif not quiet:
            _print(found, Path(str(job.output)), printed)
        tell_all(errors)
    if errors:
        raise typer.Exit(FAILED)
    return found


def _print(found: Run | PeopleRun, folder: Path, printed: list[Finding]) -> None:
    console = Terminal()
    told = printed if console.is_terminal and Terminal(stderr=True).is_terminal else []
    if isinstance(found, PeopleRun):
        print_people(console, found, told)
    else:
        print_run(console, found, told)
    print_files(console, folder, [*found.report["files"], *found.report.get("folders", []), "report.json"])


# one each, since a run removes the files of an earlier one
_FOLDER, _FOLDER_OF_PEOPLE = "skelsplat-demo", "skelsplat-demo-people"
_OF_PEOPLE = (
    "One of the two main people was added to this recording by calculation (Pose2Sim's demonstration): their "
    "detections are not those of a detector."
)
_NOTE = "The sample has no ground truth: these errors measure agreement with the detections, not accuracy."


@takes(
    *rows(
        f"""
        Output:
        -o, --output FOLDER  Folder for the results. [{_FOLDER}, with --people {_FOLDER_OF_PEOPLE}]
        Input:
        --people  Refine the recording of two people and a bystander.
        Cameras:
        --no-adjust  Use the cameras as calibrated: one was turned since.
        --no-calibration  Find the cameras from the recording, and compare with those calibrated.
        """
    ),
    *options.of_job("paper", "frame_by_frame", "n_threads"),
    QUIET,
    AS_JSON,
)
def demo(
    *,
    output: Path | None = None,
    people: bool,
    frame_by_frame: bool,
    adjust: bool,
    calibration: bool,
    quiet: bool,
    as_json: bool,
    **settings: Any,
) -> None:
    """Refine the recording that ships with the package: 4 cameras, 100 frames, OpenPose.

    The input is copied to FOLDER/input, as the files of a typical recording
    (calibration TOML, one folder of OpenPose JSON per camera), and read from
    there. The results are those of refine.

    One camera was turned after the calibration: its place is adjusted first, by the
    detections (with --people the recording does not tell which camera it is).

    [bold]Examples[/bold]

    skelsplat demo

    skelsplat demo --people -o people

    skelsplat demo --no-calibration
    """
    if people and not calibration:
        raise typer.BadParameter("cannot be combined with --people", param_hint="--no-calibration")
    output = output or Path(_FOLDER_OF_PEOPLE if people else _FOLDER)
    config = options.config_of(**settings)
    with run_folder(output):  # which another run may be writing
        paths = sample.extract(output / "input", people=people)
    job = Job(
        paths.calibration,
        paths.detections,
        unit=sample.UNIT,
        layout=sample.LAYOUT,
        fps=sample.FRAME_RATE_HZ,
        frame_by_frame=frame_by_frame,
        config=config,
        people="all" if people else None,
        adjust_cameras=adjust and not people,
        output=output,
        note=f"{_NOTE} {_OF_PEOPLE}" if people else _NOTE,
    )
    result = run_and_print(job if calibration else _recalibrated(job), quiet=quiet, as_json=as_json)
    if isinstance(result, Run) and not (calibration or quiet or as_json):
        with collected_warnings():
            print_text(Terminal(), _compared(result, run(replace(job, output=None))))


def _recalibrated(job: Job) -> Job:
    """Return the job with cameras that are found from its detections, as without a calibration."""
    calibration, detections = Path(job.calibration), Path(job.detections)
    found = calibrate_cameras(detections, calibration, layout=job.layout, person="entry:0")
    path = calibration.with_name("Found.toml")
    write_calibration(path, found.found.cameras, note="skelsplat demo --no-calibration", adjusted=True)
    return replace(job, calibration=path, unit="mm", adjust_cameras=False)


def _compared(found: Run, given: Run) -> str:
    """Return how a run with cameras that were found compares with that with the calibration's."""
    rigs = [one.inputs.rig for one in (found, given)]
    centres = [np.stack([camera.centre for camera in rig]) * rig.mm_per_unit for rig in rigs]
    apart = float(sk.metrics.pa_mpjpe(centres[0][None], centres[1][None]))
    errors = [one.statistics.total["after_px"] for one in (found, given)]
    adjusted = " and adjusted" if given.inputs.adjusted else ""
    words = f"Error with the cameras found: {px(errors[0])}; with those calibrated{adjusted}: "
    words += (
        f"{px(errors[1])}. The two differ by {apart:.0f} mm per camera, place and scale of the whole aside."
    )
    return words
