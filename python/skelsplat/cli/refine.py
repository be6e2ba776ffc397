"""``skelsplat refine``: the method on a user's own calibration and detections."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

import skelsplat as sk
from skelsplat.cli import _calibration as calibration
from skelsplat.cli import options
from skelsplat.cli._calibration import CalibrationOptions
from skelsplat.cli._reading import reading
from skelsplat.cli._run import run
from skelsplat.cli.options import formats, one_of, positive
from skelsplat.io.poses import MARKER_NAMES
from skelsplat.run.job import Job, Verbosity
from skelsplat.run.over_time import over_time

if TYPE_CHECKING:
    from pathlib import Path

EPILOG = (
    "Results in FOLDER: pose.npz, pose.csv and pose.trc (or what --write says), report.json, report.html, "
    "overview.png and weights.png, with --paper also heatmaps.png; and the input as it was used, "
    "cameras.json and detections.npz. What an earlier run wrote there is removed first; plots/ and overlay/ "
    "stay."
)
_UNITS = ("mm", "cm", "m")
_FRAMES = ("strict", "intersection", "union")


def refine(
    source: calibration.Calibration,
    detections: options.Detections,
    *,
    layout: options.LayoutName = None,
    person: options.Person = "consistent",
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
    unit: calibration.Unit = None,
    calibration_format: calibration.Format = None,
    camera_type: calibration.CameraType = None,
    subject: calibration.Subject = None,
    size: calibration.Size = None,
    binning: calibration.Binning = None,
    paper: options.Paper = False,
    no_swaps: options.NoSwaps = False,
    sigma_mm: options.Sigma = None,
    occlusion_sigma_mm: options.OcclusionSigma = None,
    symmetry_tier: options.SymmetryTier = None,
    max_steps: options.MaxSteps = None,
    threads: options.Threads = None,
    fill_gaps: options.FillGaps = None,
    fill_method: options.FillMethod = None,
    fill_weak: options.FillWeak = False,
    filter: options.Filter = None,
    output: options.Out,
    write: options.Write = "csv,trc",
    fps: options.Fps = None,
    y_up: options.YUp = False,
    marker_names: options.MarkerNames = "skelsplat",
    no_html: options.NoHtml = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Refine the 3D pose of one person from calibrated cameras and 2D detections.

    --unit is needed where the calibration does not say it.

    [bold]Examples[/bold]

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b

    skelsplat refine Calib.qca.txt pose/ -o out --layout body25 --y-up

    skelsplat refine Calib.toml dlc/ -o out --unit mm --layout coco17 --map nose=snout --offset camB=3

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b --fps 60 --filter butterworth:6

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b --fill-gaps 10

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b --paper

    skelsplat refine Calib.toml pose/ -o out --unit m --layout body25b --init mono.npz --init-sigma-mm 40

    skelsplat refine --config run.toml
    """
    settings = {
        "sigma_mm": sigma_mm,
        "occlusion_sigma_mm": occlusion_sigma_mm,
        "symmetry_tier": symmetry_tier,
        "max_steps": max_steps,
        "min_confidence": min_confidence,
        "n_threads": threads,
        "undistort": False if no_undistort else None,
        "find_swaps": False if no_swaps and not paper else None,
    }
    if unit is not None:
        one_of("--unit", unit, _UNITS)  # the rest is known when the file is read
    job = Job(
        calibration=source,
        detections=detections,
        cameras=CalibrationOptions(unit, calibration_format, camera_type, subject, size, binning),
        layout=layout and one_of("--layout", layout.lower(), sk.layouts.names),
        out=output,
        person=_person(person),
        frames=one_of("--frames", frames, _FRAMES),
        **reading(format, offset, order, joint_map),
        without=tuple(dict.fromkeys(without or [])),
        sequence=sequence,
        init=init,
        init_sigma_mm=_init_sigma(init_sigma_mm, init, paper=paper),
        paper=paper,
        fps=positive("--fps", fps),
        y_up=y_up,
        marker_names=one_of("--marker-names", marker_names, MARKER_NAMES),
        write=formats(write),
        html=not no_html,
        over_time=over_time(filter, fps, fill_gaps, fill_method, weak=fill_weak),
        settings={name: value for name, value in settings.items() if value is not None},
    )
    positive("--sigma-mm", sigma_mm)
    positive("--occlusion-sigma-mm", occlusion_sigma_mm)
    run(job, Verbosity(quiet=quiet, as_json=as_json))


def _person(value: str) -> str:
    if value in ("consistent", "largest") or value.isdecimal():
        return value
    raise typer.BadParameter(
        f"expected consistent, largest or a number, got {value!r}", param_hint="--person"
    )


def _init_sigma(value: float | None, init: Path | None, *, paper: bool) -> float | None:
    """Return the standard deviation of ``--init`` in mm, which needs a pose and the default method."""
    if value is not None and init is None:
        raise typer.BadParameter("expected --init beside it, got none", param_hint="--init-sigma-mm")
    if value is not None and paper:
        raise typer.BadParameter(
            "expected a run without --paper (the paper's start is no observation), got both",
            param_hint="--init-sigma-mm",
        )
    return positive("--init-sigma-mm", value)
