"""``skelsplat check-cameras`` and ``adjust-cameras``: the faults of a calibration, found and corrected."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.table import Table

import skelsplat as sk
from skelsplat._words import number, with_bar
from skelsplat.cli import options
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.config import source_of
from skelsplat.cli.output import print_finding, print_text, say, tell
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_parts, print_table
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding
from skelsplat.io import write_calibration
from skelsplat.rig_check import RigReport
from skelsplat.run.cameras import AdjustedCameras, CameraCheck, numbers_of
from skelsplat.run.cameras import adjust_cameras as adjust
from skelsplat.run.cameras import check_cameras as check

_CHECK_EPILOG = "Exit status: 0 nothing found, 1 something found or a file is unreadable, 2 bad usage."
_CHECK_COMMON = ("unit", "layout", "person", "frames", "without", "offsets", "order", "mapping")

_CHECK_OPTIONS = (
    *options.of_job("calibration"),
    replace(
        options.of_job("detections")[0],
        default=None,
        help="Detections of people walking about. In any form that refine reads: a folder with one folder or "
        "file per camera, named like the camera, or one file. Without them, only the calibration itself is "
        "checked.",
    ),
    *options.CALIBRATION,
    *options.RECORDING,
)
_CHECK_LEGEND = (
    "vs. others: error vs. the other cameras; --offset: value for refine that corrects an unsynchronised "
    "camera, and the error with it; DLT, robust: error vs. all cameras; weight: how much the robust solver "
    "trusts each detection, 0 to 1; rejected: weight below 0.25"
)


@answers(*_CHECK_OPTIONS, common=_CHECK_COMMON, epilog=_CHECK_EPILOG)
def check_cameras(
    context: typer.Context, calibration: Path, detections: Path | None = None, **given: Any
) -> Answer:
    """Find faults in a calibration: wrong unit, swapped, rotated or unsynchronised cameras.

    With the detections of people walking about, every camera is compared
    with the other cameras. Detections are read like those of refine.

    [bold]Examples[/bold]

    skelsplat check-cameras Calib.toml --unit m

    skelsplat check-cameras Calib.toml pose/ --unit m --layout body25b

    skelsplat check-cameras Calib.toml dlc/ --unit mm --layout coco17 --map nose=snout --offset camB=3
    """
    if detections is None:
        _refuse(context)
    found = check(calibration, detections, **options.reading(given))
    report, adjust = found.report, None
    if report.misplaced:
        again = [word for pair in _given(context) for word in pair]
        files = ("skelsplat", "adjust-cameras", str(calibration), str(detections))
        adjust = shlex.join([*files, *again, "-o", "fixed.toml"])
    document = {
        "calibration": str(calibration),
        "detections": None if detections is None else str(detections),
        "unit": found.rig.unit,
        "ok": report.ok,
        "findings": [finding.to_dict() for finding in report.findings],
        "cameras": [asdict(row) for row in report.cameras],
        "adjust": adjust,
    }

    def show_warnings(console: Console) -> None:
        for finding in (one for one in report.findings if one.severity != "note"):
            print_finding(console, finding, own_line=True)

    return Answer(document, partial(_print_check, found, adjust), show_warnings, status=0 if report.ok else 1)


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


def _print_check(found: CameraCheck, adjust: str | None, console: Console) -> None:
    report = found.report
    if report.cameras:
        print_table(console, _table_of_check(report))
        console.print(_CHECK_LEGEND, style="dim")
        console.print()
    for finding in report.findings:
        print_finding(console, finding, own_line=True)
    if report.ok:
        print_text(console, _nothing(found.rig, found.frames))
    if adjust:
        say("To measure this, and correct what is sure in a new calibration file:")
        say(f"  {adjust}")  # on one line, to be pasted


def _nothing(rig: sk.CameraRig, frames: int | None) -> str:
    """Return the sentence for a check without findings."""
    if frames is not None:
        return f"No fault found: {len(rig)} cameras, {rig.unit}, {frames} frames of detections."
    return (
        f"No fault found in the file itself: {len(rig)} cameras, {rig.unit}. Whether it fits a recording "
        "takes detections: skelsplat check-cameras CALIBRATION DETECTIONS."
    )


def _table_of_check(report: RigReport) -> Table:
    columns = ("vs.\nothers", "--offset", "DLT", "robust", "weight", "rejected", "detections")
    table = new_table("Distance of the detections from the joints [px], medians", "camera", columns)
    for row in report.cameras:
        offset = "" if row.offset_option is None else f"{row.offset_option}: {row.best_offset_px:.1f}"
        share = f"{100 * row.rejected:.0f}%" if math.isfinite(row.rejected) else "–"
        cells = [number(row.left_out_px), offset, number(row.dlt_px), number(row.robust_px)]
        table.add_row(row.name, *cells, number(row.weight, 2), share, str(row.used))
    return table


_ADJUST_EPILOG = (
    "Exit status: 0 done, also if no camera was adjusted; 1 a file is unreadable or another fault is found."
)
_ADJUST_COMMON = (
    *("output", "unit", "layout", "person", "frames", "without", "offsets", "order", "mapping"),
    *("free", "focal", "clock", "force"),
)
_SUFFIXES = (".toml", ".json", ".npz")
_ADJUST_LEGEND = (
    "±: error bar; for a camera that was not adjusted, how far off it may still be; before, after:"
    " median distance of the detections from where the other cameras place the joints"
)

_ADJUST_OPTIONS = (
    *options.of_job("calibration", "detections"),
    *options.CALIBRATION,
    *options.RECORDING,
    *rows(
        """
        Output:
        -o, --output FILE  Calibration file to write: .toml (Anipose), .json or .npz. Nothing is written if no
            camera was adjusted. [required]
        --force  Replace FILE if it exists.
        Adjust:
        --move CAMERA  A camera that was moved. Repeatable; only these are adjusted, instead of those found to
            be wrong.
        --focal  Also adjust focal lengths, if zoom or focus may have changed.
        --clock  Also measure clocks to parts of a frame. Offsets of whole frames are found in any case.
        """,
        move={"name": "free", "many": True},
    ),
)


@answers(*_ADJUST_OPTIONS, common=_ADJUST_COMMON, epilog=_ADJUST_EPILOG)
def adjust_cameras(calibration: Path, detections: Path, *, output: Path, force: bool, **given: Any) -> Answer:
    """Adjust the cameras that were turned or moved since the calibration, from a recording.

    The detections of people walking about, read like those of refine, show
    which cameras are wrong and by how much. The other cameras, more than half,
    stay exactly as they are. Where the recording does not tell which camera is
    wrong, none is adjusted.

    [bold]Examples[/bold]

    skelsplat adjust-cameras Calib.toml pose/ -o fixed.toml --unit m --layout body25b

    skelsplat adjust-cameras Calib.qca.txt pose/ -o fixed.toml --move cam_03 --focal
    """
    _check_output(output, calibration, force=force)
    found = adjust(calibration, detections, **options.reading(given))
    wrote = f"{output} was not written."
    if found.adjusted:
        names = ", ".join(found.adjusted)
        note = f"skelsplat adjust-cameras: {names} of {calibration.name} adjusted by {detections.name}"
        write_calibration(output, found.cameras, note=note, adjusted=True)
        wrote = f"Wrote {len(found.cameras)} cameras to {output}, lengths in {found.cameras.unit}."

    def show(console: Console) -> None:
        print_parts(console, _table_of_adjusted(found, focal=given["focal"], clock=given["clock"]), names=2)
        console.print(_ADJUST_LEGEND, style="dim")
        console.print()
        for finding in found.findings:
            print_finding(console, finding, own_line=True)
        say(wrote)

    document = {
        "calibration": str(calibration),
        "detections": str(detections),
        "output": str(output) if found.adjusted else None,
        "unit": found.cameras.unit,
        "frames": {"fitted": found.adjustment.fitted, "left_out": found.adjustment.judged},
        "findings": [finding.to_dict() for finding in found.findings],
        "cameras": [numbers_of(one, found.cameras.mm_per_unit) for one in found.adjustment.report],
    }
    return Answer(document, show, lambda _: _tell(found.findings))


def _tell(findings: Sequence[Finding]) -> None:
    for finding in findings:
        tell(finding)


def _check_output(output: Path, source: Path, *, force: bool) -> None:
    if output.suffix.lower() not in _SUFFIXES:
        expected = f"a calibration to be written as {', '.join(_SUFFIXES)}"
        got = output.suffix or "no suffix"
        raise typer.BadParameter(f"expected {expected}, got {got!r}", param_hint="--output")
    if output.resolve() == source.resolve():
        raise DatasetError(output, "output", "another file than CALIBRATION", "the same")
    if output.exists() and not force:
        raise DatasetError(output, "output", "no file of this name (--force replaces it)", "one that exists")


def _table_of_adjusted(found: AdjustedCameras, *, focal: bool, clock: bool) -> Table:
    report, mm, judged = found.adjustment.report, found.cameras.mm_per_unit, found.adjustment.judged
    clock = clock or any(one.clock for one in report)
    more = [*(["focal\n[%]"] if focal else []), *(["clock\n[frames]"] if clock else [])]
    columns = ("", "turned by\n[°]", "moved by\n[mm]", *more, "before\n[px]", "after\n[px]")
    left_out = f"; errors measured in {judged} others" if judged else ""
    table = new_table(f"Cameras estimated from {found.adjustment.fitted} frames{left_out}", "camera", columns)
    for column in table.columns:
        column.no_wrap = True  # a number and its error bar
    table.columns[1].justify = "left"
    for one in report:
        cells = [_bar(one.degrees, one.turn_sigma), _bar(one.distance * mm, one.shift_sigma * mm)]
        if focal:
            cells.append(_bar(100 * (one.focal - 1), 100 * one.focal_sigma, "+"))
        if clock:
            cells.append(_bar(one.clock, one.clock_sigma, "+"))
        table.add_row(one.name, one.status, *cells, number(one.before), number(one.after))
    return table


def _bar(value: float, sigma: float, sign: str = "") -> str:
    """Return a number with its error bar; a dash for what was not looked at."""
    return with_bar(value, sigma, sign) if round(value, 1) or math.isfinite(sigma) else "–"
