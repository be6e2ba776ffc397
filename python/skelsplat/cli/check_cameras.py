"""``skelsplat check-cameras``: what is wrong with a calibration, in words."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

import skelsplat as sk
from skelsplat.cli import _calibration as calibration
from skelsplat.cli import options
from skelsplat.cli._calibration import CalibrationOptions
from skelsplat.cli._reading import leave_out, named_offsets, read_found, reading, refuse_reading
from skelsplat.cli._remedies import Remedies
from skelsplat.cli.options import one_of
from skelsplat.cli.output import print_json
from skelsplat.findings import collected_warnings
from skelsplat.rig_check import Finding, RigReport, check_rig

if TYPE_CHECKING:
    from skelsplat.io import DetectionSet

EPILOG = "Exit status: 0 nothing found, 1 something found or a file is unreadable, 2 bad usage."

_Detections = Annotated[
    Path | None,
    typer.Argument(
        readable=False,
        metavar="DETECTIONS",
        help="Detections of one person walking about, as refine reads them: a folder with one folder or file "
        "per camera, named like the camera, or one file of all. Without it only the calibration itself is "
        "looked at.",
        show_default=False,
    ),
]
_Layout = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Joint layout of the detections.",
        show_default="what the files name",
        rich_help_panel="Input",
    ),
]
_LEGEND = (
    "by others: from what the other cameras say; --offset: what to give to refine for a camera that is "
    "out of step, and the distance with it; DLT, robust: from what all cameras say; "
    "weight: how far the robust solver believes the detections, 0 to 1; rejected: below 0.25"
)
_MODES = ("strict", "intersection", "union")


def check_cameras(
    context: typer.Context,
    source: calibration.Calibration,
    detections: _Detections = None,
    *,
    layout: _Layout = None,
    frames: options.Frames = "union",
    format: options.Format = None,
    offset: options.Offset = None,
    order: options.Order = None,
    without: options.Without = None,
    joint_map: options.JointMap = None,
    sequence: options.Sequence = None,
    unit: calibration.Unit = None,
    calibration_format: calibration.Format = None,
    camera_type: calibration.CameraType = None,
    subject: calibration.Subject = None,
    size: calibration.Size = None,
    binning: calibration.Binning = None,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Say what is wrong with a calibration: unit, exchanged, turned or late cameras.

    With the detections of one person walking about, every camera is compared
    with what the other cameras say. All formats and options of refine's
    detections are read. With --json, best_offset of a camera is by how many
    frames its numbers are too high, offset_option the value for --offset;
    refine_options of a finding are what puts it right there.

    [bold]Examples[/bold]

    skelsplat check-cameras Calib.toml --unit m

    skelsplat check-cameras Calib.toml pose/ --unit m --layout body25b

    skelsplat check-cameras Calib.qca.txt pose/ --layout halpe26 --json

    skelsplat check-cameras Calib.toml dlc/ --unit mm --layout coco17 --map nose=snout --offset camB=3
    """
    if detections is None:
        refuse_reading(context)
    given = {
        "layout": layout and layout.lower(),
        "frames": one_of("--frames", frames, _MODES),
        "sequence": sequence,
        **reading(format, offset, order, joint_map),
    }
    read = CalibrationOptions(unit, calibration_format, camera_type, subject, size, binning)
    with collected_warnings() as warnings:
        every = read.read(source, format_option="--calibration-format")
        rig = leave_out(every, tuple(without or ()))
        found = None if detections is None else read_found(detections, every, without=without or (), **given)
        report = (
            check_rig(rig)
            if found is None
            else check_rig(rig, found.people, frames=found.frames, layout=found.layout)
        )
    doubts = [
        Finding("unit" if " apart in " in text else "geometry", (), text)
        for text in (warning.text for warning in warnings)
    ]
    if any(finding.kind == "unit" for finding in report.findings):
        doubts = [doubt for doubt in doubts if doubt.kind != "unit"]
    report = RigReport((*doubts, *report.findings), report.cameras)
    remedies = Remedies(report, found, {} if found is None else named_offsets(every, given["offsets"]))
    if as_json:
        print_json(_document(source, detections, rig, remedies))
    else:
        _print(rig, found, remedies, quiet=quiet)
    if not report.ok:
        raise typer.Exit(1)


def _print(rig: sk.CameraRig, found: DetectionSet | None, remedies: Remedies, *, quiet: bool) -> None:
    console, report = Console(highlight=False, markup=False), remedies.report
    if report.cameras and not quiet:
        console.print(_table(remedies))
        console.print(_LEGEND, style="dim")
        console.print()
    for finding in report.findings:
        _print_finding(console, finding, remedies.line(finding))
    if report.ok and not quiet:
        console.print(_nothing(rig, found))


def _print_finding(console: Console, finding: Finding, remedy: str) -> None:
    """Print a finding, and below it what to give to refine: on one line, however long, to be pasted."""
    console.print(f"! {finding.text}{' refine puts it right with' if remedy else ''}")
    if remedy:
        typer.echo(f"  {remedy}")


def _nothing(rig: sk.CameraRig, found: DetectionSet | None) -> str:
    """Say that nothing was found, and in what."""
    if found is not None:
        frames = len(found.frames)
        return f"Nothing wrong was found: {len(rig)} cameras, {rig.unit}, {frames} frames of detections."
    return (
        f"Nothing wrong was found in the file itself: {len(rig)} cameras, {rig.unit}. Only detections tell "
        "whether it fits a recording: skelsplat check-cameras CALIBRATION DETECTIONS."
    )


def _table(remedies: Remedies) -> Table:
    table = Table(
        title="Distance of the detections from the person [px], medians",
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("camera")
    for name in ("by\nothers", "--offset", "DLT", "robust", "weight", "rejected", "detections"):
        table.add_column(name, justify="right")
    for row in remedies.report.cameras:
        option = remedies.offset(row)
        offset = "" if option is None else f"{option}: {row.best_offset_px:.1f}"
        share = f"{100 * row.rejected:.0f}%" if math.isfinite(row.rejected) else "–"
        cells = [_number(row.left_out_px), offset, _number(row.dlt_px), _number(row.robust_px)]
        table.add_row(row.name, *cells, _number(row.weight, 2), share, str(row.used))
    return table


def _number(value: float, digits: int = 1) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _document(source: Path, detections: Path | None, rig: sk.CameraRig, remedies: Remedies) -> dict[str, Any]:
    report = remedies.report
    return {
        "calibration": str(source),
        "detections": None if detections is None else str(detections),
        "unit": rig.unit,
        "ok": report.ok,
        "findings": [
            {**asdict(finding), "refine_options": remedies.of(finding)} for finding in report.findings
        ],
        "cameras": [{**asdict(row), "offset_option": remedies.offset(row)} for row in report.cameras],
    }
