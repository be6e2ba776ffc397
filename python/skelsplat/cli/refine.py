"""``skelsplat refine``: the method on a user's own calibration and detections."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

import skelsplat as sk
from skelsplat.cli import inputs, options
from skelsplat.cli._app import FAILED
from skelsplat.cli.command import with_parameters_of
from skelsplat.cli.output import Terminal, described, print_json
from skelsplat.cli.people_table import print_people
from skelsplat.cli.table import print_files, print_run, tell, telling
from skelsplat.findings import Finding
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.run import Job, PeopleRun, Run, run, run_long, run_people

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
    *("output", "unit", "layout", "person", "people", "without", "offset", "fps"),
    *("filter", "fill_gaps", "write", "y_up", "angles", "paper", "quiet", "as_json"),
)


# long: a parameter per option
@with_parameters_of(inputs.calibration_arguments)
def job_of(
    source: inputs.Calibration,
    detections: options.Detections,
    *,
    layout: options.LayoutName = None,
    person: options.Person = "consistent",
    people: options.People = None,
    frames: options.Frames = "strict",
    format: options.Format = None,
    offset: options.Offset = None,
    order: options.Order = None,
    without: options.Without = None,
    joint_map: options.JointMap = None,
    sequence: options.Sequence = None,
    init: options.Init = None,
    init_sigma_mm: options.InitSigma = None,
    min_confidence: options.MinConfidence = None,
    no_undistort: options.NoUndistort = False,
    adjust_cameras: options.AdjustCameras = False,
    paper: options.Paper = False,
    no_swaps: options.NoSwaps = False,
    free_bones: options.FreeBones = False,
    sigma_mm: options.Sigma = None,
    occlusion_sigma_mm: options.OcclusionSigma = None,
    joint_bias_mm: options.JointBias = None,
    symmetry_tier: options.SymmetryTier = None,
    max_steps: options.MaxSteps = None,
    threads: options.Threads = None,
    fps: options.Fps = None,
    frame_by_frame: options.FrameByFrame = False,
    fill_gaps: options.FillGaps = None,
    fill_method: options.FillMethod = None,
    fill_weak: options.FillWeak = False,
    filter: options.Filter = None,
    output: options.Out,
    write: options.Write = "csv,trc",
    y_up: options.YUp = False,
    marker_names: options.MarkerNames = "skelsplat",
    angles: options.Angles = False,
    no_html: options.NoHtml = False,
    **reading: Any,
) -> Job:
    """Return the job of these options and arguments."""
    given = {
        "sigma_mm": sigma_mm,
        "occlusion_sigma_mm": occlusion_sigma_mm,
        "joint_bias_mm": joint_bias_mm,
        "symmetry_tier": symmetry_tier,
        "max_steps": max_steps,
        "min_confidence": min_confidence,
        "n_threads": threads,
        "undistort": False if no_undistort else None,
        "find_swaps": False if no_swaps and not paper else None,
        "bones": "free" if free_bones and not paper else None,
    }
    settings = {name: value for name, value in given.items() if value is not None}
    return Job(
        source,
        detections,
        **inputs.calibration_arguments(**reading),
        layout=layout,
        person=person,
        people=people and (options.number_of_people("--people", people) or "all"),
        frames=frames,
        **inputs.detection_arguments(format, offset, order, joint_map),
        without=tuple(dict.fromkeys(without or [])),
        sequence=sequence,
        init=init,
        init_sigma_mm=init_sigma_mm,
        config=sk.RefineConfig.paper(**settings) if paper else sk.RefineConfig(**settings),
        adjust_cameras=adjust_cameras,
        fps=fps,
        frame_by_frame=frame_by_frame,
        fill_gaps=fill_gaps or 0,
        fill_method=fill_method,
        fill_weak=fill_weak,
        filter=filter,
        output=output,
        write=options.some_of("--write", write, tuple(POSE_FORMATS)),
        y_up=y_up,
        marker_names=marker_names,
        angles=angles,
        html=not no_html,
    )


@with_parameters_of(job_of)
def refine(*, quiet: options.Quiet = False, as_json: options.AsJson = False, **given: Any) -> None:
    """Refine the 3D pose of one person, or of several, from 2D detections.

    [bold]Examples[/bold]

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b --fps 60
    --write trc,c3d --angles

    skelsplat refine --config run.toml --fps 60 --people all
    """
    run_and_print(job_of(**given), quiet=quiet, as_json=as_json)


def run_and_print(job: Job, *, quiet: bool, as_json: bool) -> None:
    """Do a job that names a folder, under a progress bar, and print the results."""
    printed: list[Finding] = []
    print_finding = telling(quiet=quiet)

    def tell_now(finding: Finding) -> None:
        printed.append(finding)
        print_finding(finding)

    with described("refining", shown=not quiet, unit="frames") as show:
        given: dict[str, Any] = {
            "progress": lambda done, total: show("refining", done, total),
            "tell": tell_now,
            "on_file": lambda name: show(f"writing {name}", None, None),
        }
        found: Run | PeopleRun | None = run_long(job, **given)
        if found is None:
            found = run(job, **given) if job.people is None else run_people(job, **given)
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
