"""``skelsplat refine``: the method on a user's own calibration and detections."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import skelsplat as sk
from skelsplat.cli import _options as options
from skelsplat.cli._job import Job, Verbosity
from skelsplat.cli._pipeline import check_output
from skelsplat.cli._run import run

EPILOG = "Results: pose.npz, pose.csv, pose.trc, report.json, overview.png and heatmaps.png in FOLDER."
_INPUT = "Input"
_UNITS = ("mm", "cm", "m")
_FRAMES = ("strict", "intersection", "union")


def refine(
    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="Calibration file (TOML of Anipose or Pose2Sim).")
    ],
    detections: Annotated[
        Path, typer.Argument(metavar="DETECTIONS", help="Folder with one folder of OpenPose JSON per camera.")
    ],
    output: options.Out,
    *,
    unit: Annotated[
        str | None,
        typer.Option(
            metavar="mm|cm|m", help="Length unit of the calibration. Required.", rich_help_panel=_INPUT
        ),
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Joint layout of the detections, e.g. body25b. Required.",
            rich_help_panel=_INPUT,
        ),
    ] = None,
    person: Annotated[
        str,
        typer.Option(
            metavar="consistent|largest|N",
            help="Whom to follow: the person on whom the views agree, the largest in each view, or the N-th.",
            rich_help_panel=_INPUT,
        ),
    ] = "consistent",
    frames: Annotated[
        str,
        typer.Option(
            metavar="strict|intersection|union",
            help="If cameras have different frames: refuse, keep the common ones, or keep all.",
            rich_help_panel=_INPUT,
        ),
    ] = "strict",
    init: Annotated[
        Path | None,
        typer.Option(
            metavar="POSE.npz", help="Pose to start from.  [default: triangulation]", rich_help_panel=_INPUT
        ),
    ] = None,
    min_confidence: Annotated[
        float | None,
        typer.Option(
            min=0, max=1, metavar="C", help="Leave out detections of less confidence.", rich_help_panel=_INPUT
        ),
    ] = None,
    no_undistort: Annotated[
        bool, typer.Option("--no-undistort", help="Ignore lens distortion.", rich_help_panel=_INPUT)
    ] = False,
    sigma: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Width σ of a joint's Gaussian.", rich_help_panel=options.METHOD),
    ] = None,
    occlusion_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="MM", help="Width σ of elbows, wrists and ankles.", rich_help_panel=options.METHOD
        ),
    ] = None,
    symmetry_tier: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=3,
            metavar="0..3",
            help="Limbs kept equal left and right: 0 none, 1 lower, 2 and upper, 3 and trunk.",
            rich_help_panel=options.METHOD,
        ),
    ] = None,
    max_steps: Annotated[
        int | None,
        typer.Option(min=0, metavar="N", help="Most steps per frame.", rich_help_panel=options.METHOD),
    ] = None,
    threads: options.Threads = None,
    fps: Annotated[
        float | None,
        typer.Option(
            metavar="HZ", help="Frame rate of the recording, for pose.trc.", rich_help_panel=options.OUTPUT
        ),
    ] = None,
    y_up: Annotated[
        bool,
        typer.Option(
            "--y-up", help="Write pose.trc y up (OpenSim), from z up.", rich_help_panel=options.OUTPUT
        ),
    ] = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Refine the 3D pose of one person from calibrated cameras and 2D detections.

    [bold]Examples[/bold]

    skelsplat refine Calib.toml openpose/ -o out --unit m --layout body25b

    skelsplat refine Calib.toml openpose/ -o out --unit m --layout body25 --fps 60 --y-up
    """
    settings = {
        "sigma": sigma,
        "occlusion_sigma": occlusion_sigma,
        "symmetry_tier": symmetry_tier,
        "max_steps": max_steps,
        "min_confidence": min_confidence,
        "n_threads": threads,
        "undistort": False if no_undistort else None,
    }
    job = Job(
        calibration=calibration,
        detections=detections,
        unit=_one_of("--unit", unit, _UNITS),
        layout=_one_of("--layout", layout and layout.lower(), sk.layouts.names),
        out=output,
        person=_person(person),
        frames=_one_of("--frames", frames, _FRAMES),
        init=init,
        fps=_positive("--fps", fps),
        y_up=y_up,
        settings={name: value for name, value in settings.items() if value is not None},
    )
    _positive("--sigma", sigma)
    _positive("--occlusion-sigma", occlusion_sigma)
    check_output(output)
    run(job, Verbosity(quiet=quiet, as_json=as_json))


def _one_of(option: str, value: str | None, choices: tuple[str, ...]) -> str:
    """Return ``value`` if it is one of ``choices``; None means that a required option is missing."""
    if value in choices:
        return value
    got = "nothing (the files do not say)" if value is None else repr(value)
    raise typer.BadParameter(f"expected one of {', '.join(choices)}, got {got}", param_hint=option)


def _person(value: str) -> str:
    if value in ("consistent", "largest") or value.isdecimal():
        return value
    raise typer.BadParameter(
        f"expected consistent, largest or a number, got {value!r}", param_hint="--person"
    )


def _positive(option: str, value: float | None) -> float | None:
    if value is None or 0 < value < float("inf"):
        return value
    raise typer.BadParameter(f"expected a positive number, got {value:g}", param_hint=option)
