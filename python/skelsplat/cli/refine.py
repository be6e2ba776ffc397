"""``skelsplat refine``: the method on a user's own calibration and detections."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from skelsplat.cli import options
from skelsplat.cli._app import FAILED
from skelsplat.cli.command import takes
from skelsplat.cli.findings import tell, telling
from skelsplat.cli.output import Terminal, print_json, progress
from skelsplat.cli.table import print_files, print_people, print_run
from skelsplat.findings import Finding
from skelsplat.run import Job, PeopleRun, Run, run, run_people

EPILOG = (
    "Results in FOLDER: pose.npz, pose.csv and pose.trc (or the formats of --write), report.json, "
    "report.html, overview.png and weights.png, with --paper also heatmaps.png, with --angles angles.csv,"
    " angles.npz and angles.mot; and the input as used, cameras.json, detections.npz, and layout.toml for"
    " a layout of your own. With --people these are in the folder of each person, and report.html, "
    "overview.png, and people.csv, people.json or people.nc have everybody. Files of an earlier run are "
    "removed first; plots/ and overlay/ are kept. Recordings of more than 2 million detections of a person "
    "(frames x cameras x joints) are done in parts, in little memory: pose files and counts are of all "
    "frames, medians, pictures and the 3D view of every n-th. --people, --person, --init, --adjust-cameras, "
    "--fill-gaps, --filter, --angles, --paper and --write c3d need all frames at once."
)
COMMON = (
    *("output", "unit", "layout", "person", "people", "without", "offsets", "fps"),
    *("filter", "fill_gaps", "write", "y_up", "angles", "paper", "quiet", "as_json"),
)


@takes(*options.JOB, options.QUIET, options.AS_JSON, common=COMMON)
def refine(*, quiet: bool, as_json: bool, **given: Any) -> None:
    """Refine the 3D pose of one person, or of several, from 2D detections.

    [bold]Examples[/bold]

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b --fps 60
    --write trc,c3d --angles

    skelsplat refine --config run.toml --fps 60 --people all
    """
    run_and_print(options.job_of(**given), quiet=quiet, as_json=as_json)


def run_and_print(job: Job, *, quiet: bool, as_json: bool) -> None:
    """Do a job that names a folder, under a progress bar, and print the results."""
    printed: list[Finding] = []
    print_finding = telling(quiet=quiet)

    def tell_now(finding: Finding) -> None:
        printed.append(finding)
        print_finding(finding)

    with progress("frames", first="refining", shown=not quiet) as show:
        given: dict[str, Any] = {
            "progress": lambda done, total: show("refining" if done < total else "writing", done, total),
            "tell": tell_now,
        }
        found: Run | PeopleRun = run(job, **given) if job.people is None else run_people(job, **given)
    errors = [finding for finding in found.findings if finding.severity == "error"]
    if as_json or quiet:
        for finding in found.findings:
            if finding not in (*printed, *errors):
                print_finding(finding)
        for identity, person in found.people.items() if isinstance(found, PeopleRun) else ():
            for finding in (one for one in person.findings if one.severity != "note"):
                tell(finding, f"person {identity}: ")
    if as_json:
        print_json(found.report)
    elif not quiet:
        console, folder = Terminal(), Path(str(job.output))
        told = printed if console.is_terminal and Terminal(stderr=True).is_terminal else []
        if isinstance(found, PeopleRun):
            print_people(console, found, told)
        else:
            print_run(console, found, told)
        print_files(
            console, folder, [*found.report["files"], *found.report.get("folders", []), "report.json"]
        )
    for finding in errors:
        tell(finding)
    if errors:
        raise typer.Exit(FAILED)
