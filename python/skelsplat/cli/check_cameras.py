"""``skelsplat check-cameras``: what is wrong with a calibration, in words."""

from __future__ import annotations

import json
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
from skelsplat.cli import _options as options
from skelsplat.cli._calibration import CalibrationOptions, usage
from skelsplat.cli._pipeline import collected_warnings
from skelsplat.io import DetectionSet, read_openpose
from skelsplat.rig_check import Finding, RigReport, check_rig

if TYPE_CHECKING:
    from collections.abc import Sequence

EPILOG = "Exit status: 0 nothing found, 1 something found or a file is unreadable, 2 bad usage."

_Calibration = Annotated[
    Path, typer.Argument(metavar="CALIBRATION", help="Calibration, in any format that convert reads.")
]
_Detections = Annotated[
    Path | None,
    typer.Argument(
        metavar="DETECTIONS",
        help="Folder with one folder of OpenPose JSON per camera, named like the camera. Without it only "
        "the calibration itself is looked at.",
        show_default=False,
    ),
]
_Layout = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Joint layout of the detections.",
        rich_help_panel="Detections",
    ),
]
_Frames = Annotated[
    str,
    typer.Option(
        metavar="MODE",
        help="If cameras have different frames: strict refuses, intersection keeps common ones, union all.",
        rich_help_panel="Detections",
    ),
]
_LEGEND = (
    "left out: from what the other cameras say; offset: frames that would fit better, and "
    "the distance with them, all else set right; DLT, robust: from what all cameras say; "
    "weight: how far the robust solver believes the detections, 0 to 1"
)
_MODES = ("strict", "intersection", "union")


def check_cameras(
    source: _Calibration,
    detections: _Detections = None,
    *,
    layout: _Layout = None,
    frames: _Frames = "union",
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
    with what the other cameras say.

    [bold]Examples[/bold]

    skelsplat check-cameras Calib.toml --unit m

    skelsplat check-cameras Calib.toml pose/ --unit m --layout body25b

    skelsplat check-cameras Calib.qca.txt pose/ --layout halpe26 --json
    """
    if frames not in _MODES:
        raise typer.BadParameter(
            f"expected one of {', '.join(_MODES)}, got {frames!r}", param_hint="--frames"
        )
    read = CalibrationOptions(unit, calibration_format, camera_type, subject, size, binning)
    with collected_warnings(lambda _: None) as warnings:
        rig = read.read(source)
        found = None if detections is None else _detections(detections, rig, layout, frames)
        report = (
            check_rig(rig)
            if found is None
            else check_rig(rig, found.people, frames=found.frames, layout=layout)
        )
    doubts = [Finding("unit" if " apart in " in text else "geometry", (), text) for text in warnings]
    if any(finding.kind == "unit" for finding in report.findings):
        doubts = [doubt for doubt in doubts if doubt.kind != "unit"]
    report = RigReport((*doubts, *report.findings), report.cameras)
    if as_json:
        typer.echo(_to_json(source, detections, rig, report), nl=False)
    elif not (quiet and report.ok):
        _print(rig, report, found)
    if not report.ok:
        raise typer.Exit(1)


def _detections(folder: Path, rig: sk.CameraRig, layout: str | None, frames: Any) -> DetectionSet:
    try:
        return read_openpose(folder, rig, layout=layout and layout.lower(), frames=frames)
    except sk.InvalidInputError as error:
        raise usage(error) from error


def _print(rig: sk.CameraRig, report: RigReport, found: DetectionSet | None) -> None:
    console = Console(highlight=False, markup=False)
    if report.cameras:
        console.print(_table(report))
        console.print(_LEGEND, style="dim")
        console.print()
    for finding in report.findings:
        console.print(f"! {finding.text}{_remedy(finding)}")
    if report.ok:
        recording = "" if found is None else f", {len(found.frames)} frames of detections"
        console.print(f"Nothing wrong was found: {len(rig)} cameras, {rig.unit}{recording}.")


def _remedy(finding: Finding) -> str:
    """Say what to give to refine for a finding, if it has an option for it."""
    if finding.kind == "offset":
        return f" refine takes it as --offset {finding.cameras[0]}={-finding.numbers['frames']}."
    return ""


def _table(report: RigReport) -> Table:
    table = Table(
        title="Distance of the detections from the person [px], medians",
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("camera")
    for name in ("left\nout", "offset", "DLT", "robust", "weight", "rejected", "detections"):
        table.add_column(name, justify="right")
    for row in report.cameras:
        offset = f"{row.best_offset:+d}: {row.best_offset_px:.1f}" if row.best_offset else ""
        share = f"{100 * row.rejected:.0f}%" if math.isfinite(row.rejected) else "–"
        cells = [_number(row.left_out_px), offset, _number(row.dlt_px), _number(row.robust_px)]
        table.add_row(row.name, *cells, _number(row.weight, 2), share, str(row.used))
    return table


def _number(value: float, digits: int = 1) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _to_json(source: Path, detections: Path | None, rig: sk.CameraRig, report: RigReport) -> str:
    document = {
        "calibration": str(source),
        "detections": None if detections is None else str(detections),
        "unit": rig.unit,
        "ok": report.ok,
        "findings": [asdict(finding) for finding in report.findings],
        "cameras": _rows(report),
    }
    return json.dumps(_plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _rows(report: RigReport) -> Sequence[dict[str, Any]]:
    return [asdict(row) for row in report.cameras]


def _plain(value: Any) -> Any:
    """Return ``value`` with NaN and infinity as None."""
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
