"""``skelsplat check-cameras``: the faults of a calibration."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import typer
from rich.table import Table

import skelsplat as sk
from skelsplat._words import number
from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.config import source_of
from skelsplat.cli.findings import print_finding
from skelsplat.cli.output import Terminal, print_json, print_text, say
from skelsplat.cli.table import new_table, print_table
from skelsplat.rig_check import RigReport
from skelsplat.run.check import CameraCheck
from skelsplat.run.check import check_cameras as check

EPILOG = "Exit status: 0 nothing found, 1 something found or a file is unreadable, 2 bad usage."
COMMON = ("unit", "layout", "person", "frames", "without", "offsets", "order", "mapping", "quiet", "as_json")

OPTIONS = (
    options.CALIBRATION_FILE,
    replace(
        options.DETECTIONS,
        default=None,
        help="Detections of people walking about. In any form that refine reads: a folder with one folder or "
        "file per camera, named like the camera, or one file. Without them, only the calibration itself is "
        "checked.",
    ),
    *options.CALIBRATION,
    *options.RECORDING,
    options.QUIET,
    options.AS_JSON,
)
_LEGEND = (
    "vs. others: error vs. the other cameras; --offset: value for refine that corrects an unsynchronised "
    "camera, and the error with it; DLT, robust: error vs. all cameras; weight: how much the robust solver "
    "trusts each detection, 0 to 1; rejected: weight below 0.25"
)


@takes(*OPTIONS, common=COMMON)
def check_cameras(
    context: typer.Context,
    calibration: Path,
    detections: Path | None = None,
    *,
    quiet: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Find faults in a calibration: wrong unit, swapped, rotated or unsynchronised cameras.

    With the detections of people walking about, every camera is compared
    with the other cameras. Detections are read like those of refine. With --json,
    the remedy of a finding lists the options of refine that correct it; a
    camera's best_offset is by how many frames its numbers are too high,
    offset_option the value for --offset, and adjust the command for rotated or
    moved cameras, if there are any.

    [bold]Examples[/bold]

    skelsplat check-cameras Calib.toml --unit m

    skelsplat check-cameras Calib.toml pose/ --unit m --layout body25b

    skelsplat check-cameras Calib.qca.txt pose/ --layout halpe26 --json

    skelsplat check-cameras Calib.toml pose/ --unit m --layout body25b --person largest

    skelsplat check-cameras Calib.toml dlc/ --unit mm --layout coco17 --map nose=snout --offset camB=3
    """
    if detections is None:
        _refuse(context)
    found = check(calibration, detections, **options.reading(given))
    again = [word for pair in _given(context) for word in pair]
    files = ("skelsplat", "adjust-cameras", str(calibration), str(detections))
    adjust = shlex.join([*files, *again, "-o", "fixed.toml"]) if found.report.misplaced else None
    if as_json:
        print_json({**_document(calibration, detections, found), "adjust": adjust})
    else:
        _print(found, quiet=quiet)
        if adjust and not quiet:
            say("To measure this, and correct what is sure in a new calibration file:")
            say(f"  {adjust}")  # on one line, to be pasted
    if not found.report.ok:
        raise typer.Exit(1)


def _refuse(context: typer.Context) -> None:
    """Refuse options for reading detections, where there are none; a file's may be for another command."""
    for row in options.RECORDING:
        if row.name != "without" and source_of(context, row.name) == "COMMANDLINE":
            raise typer.BadParameter("requires DETECTIONS", param_hint=row.flag)


def _given(context: typer.Context) -> Iterator[tuple[str, str]]:
    """Yield the options for reading a recording that were given, in any way, to be given again."""
    for row in (*options.CALIBRATION, *options.RECORDING):
        value = context.params[row.name]
        if value and source_of(context, row.name) != "DEFAULT":
            for one in value if row.many else [value]:
                yield row.flag, str(one)


def _print(found: CameraCheck, *, quiet: bool) -> None:
    console, report = Terminal(), found.report
    if report.cameras and not quiet:
        print_table(console, _table(report))
        console.print(_LEGEND, style="dim")
        console.print()
    for finding in (one for one in report.findings if not (quiet and one.severity == "note")):
        print_finding(console, finding, own_line=True)
    if report.ok and not quiet:
        print_text(console, _nothing(found.rig, found.frames))


def _nothing(rig: sk.CameraRig, frames: int | None) -> str:
    """Return the sentence for a check without findings."""
    if frames is not None:
        return f"No fault found: {len(rig)} cameras, {rig.unit}, {frames} frames of detections."
    return (
        f"No fault found in the file itself: {len(rig)} cameras, {rig.unit}. Whether it fits a recording "
        "takes detections: skelsplat check-cameras CALIBRATION DETECTIONS."
    )


def _table(report: RigReport) -> Table:
    columns = ("vs.\nothers", "--offset", "DLT", "robust", "weight", "rejected", "detections")
    table = new_table("Distance of the detections from the joints [px], medians", "camera", columns)
    for row in report.cameras:
        offset = "" if row.offset_option is None else f"{row.offset_option}: {row.best_offset_px:.1f}"
        share = f"{100 * row.rejected:.0f}%" if math.isfinite(row.rejected) else "–"
        cells = [number(row.left_out_px), offset, number(row.dlt_px), number(row.robust_px)]
        table.add_row(row.name, *cells, number(row.weight, 2), share, str(row.used))
    return table


def _document(source: Path, detections: Path | None, found: CameraCheck) -> dict[str, Any]:
    return {
        "calibration": str(source),
        "detections": None if detections is None else str(detections),
        "unit": found.rig.unit,
        "ok": found.report.ok,
        "findings": [finding.to_dict() for finding in found.report.findings],
        "cameras": [asdict(row) for row in found.report.cameras],
    }
