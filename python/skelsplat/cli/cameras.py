"""``skelsplat check-cameras`` and ``adjust-cameras``: the faults of a calibration, found and corrected."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.table import Table

from skelsplat._words import number
from skelsplat.cli import options
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.config import given_again, source_of
from skelsplat.cli.output import option_words, print_findings, print_text, say, tell_all
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_adjusted, print_table
from skelsplat.io.calibration import WRITTEN, write_calibration
from skelsplat.rig_check import RigReport
from skelsplat.run.adjusted import numbers_of
from skelsplat.run.cameras import AdjustedCameras, CameraCheck
from skelsplat.run.cameras import adjust_cameras as adjust
from skelsplat.run.cameras import check_cameras as check

_CHECK_EPILOG = "Exit status: 0 nothing found, 1 something found or a file is unreadable, 2 bad usage."

_CHECK_OPTIONS = (
    *options.of_job("calibration"),
    replace(
        options.of_job("detections")[0],
        default=None,
        help="Detections of people walking about, as for refine. Without them, only the file is checked.",
    ),
    *options.CALIBRATION,
    *options.RECORDING,
)
_CHECK_LEGEND = (
    "vs. others: error vs. the other cameras; --offset: correction of an unsynchronised camera, and error "
    "with it; DLT, robust: error vs. all cameras; weight: mean trust, 0 to 1; rejected: weight below 0.25"
)


@answers(*_CHECK_OPTIONS, short=True, epilog=_CHECK_EPILOG)
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
    report, files = found.report, (str(calibration), str(detections))
    given_before = given_again(context, (*options.CALIBRATION, *options.RECORDING))
    refine, adjust = _refined(files, given_before, report), None
    if report.misplaced:
        words = ("skelsplat", "adjust-cameras", *files, *chain.from_iterable(given_before))
        adjust = shlex.join([*words, "-o", "fixed.toml"])
    document = {
        "calibration": str(calibration),
        "detections": None if detections is None else str(detections),
        "unit": found.rig.unit,
        "ok": report.ok,
        "findings": [finding.to_dict() for finding in report.findings],
        "cameras": [asdict(row) for row in report.cameras],
        "refine": refine,
        "adjust": adjust,
    }

    show = partial(_print_check, found, refine, adjust)
    warnings = [one for one in report.findings if one.severity != "note"]
    return Answer(document, show, partial(print_findings, warnings), status=0 if report.ok else 1)


def _refuse(context: typer.Context) -> None:
    """Refuse options for reading detections, where there are none; a file's may be for another command."""
    for row in options.RECORDING:
        if row.name != "without" and source_of(context, row.name) == "COMMANDLINE":
            raise typer.BadParameter("requires DETECTIONS", param_hint=row.flag)


def _refined(files: Sequence[str], given: Sequence[tuple[str, str]], report: RigReport) -> str | None:
    """Return the command that refines with the remedies of all findings, which replace what was given."""
    fixes = [option_words(remedy) for one in report.findings for remedy in one.remedy]

    def set_by(words: str) -> str:
        return words.rpartition("=")[0] or words.partition(" ")[0]

    before = [f"{flag} {shlex.quote(text)}" for flag, text in given if flag != "--person"]
    kept = [words for words in before if set_by(words) not in {*map(set_by, fixes)}]
    words = ("skelsplat refine", shlex.join(files), *kept, *dict.fromkeys(fixes), "-o out")
    return " ".join(words) if fixes else None


def _print_check(found: CameraCheck, refine: str | None, adjust: str | None, console: Console) -> None:
    report = found.report
    if report.cameras:
        print_table(console, _table_of_check(report))
        console.print(_CHECK_LEGEND, style="dim")
        console.print()
    print_findings(report.findings, console)
    if report.ok:
        cameras = f"{len(found.rig)} cameras, {found.rig.unit}"
        sentence = f"No fault found: {cameras}, {found.frames} frames of detections."
        if found.frames is None:
            sentence = f"No fault found in the file itself: {cameras}. Whether it fits a recording takes "
            sentence += "detections: skelsplat check-cameras CALIBRATION DETECTIONS."
        print_text(console, sentence)
    if refine:
        say("To refine with all of this corrected:", f"  {refine}")  # on one line, to be pasted
    if adjust:
        say("To measure this, and correct what is sure in a new calibration file:", f"  {adjust}")


def _table_of_check(report: RigReport) -> Table:
    columns = ("vs.\nothers", "--offset", "DLT", "robust", "weight", "rejected", "detections")
    table = new_table("Distance of the detections from the joints [px], medians", "camera", columns)
    for row in report.cameras:
        offset = "" if row.offset_option is None else f"{row.offset_option}: {row.best_offset_px:.1f}"
        share = f"{100 * row.rejected:.0f}%" if math.isfinite(row.rejected) else "–"
        cells = [number(row.left_out_px), offset, number(row.dlt_px), number(row.robust_px)]
        table.add_row(row.name, *cells, number(row.weight, 2), share, str(row.used))
    return table


_ADJUST_EPILOG = "Exit status: 0 done, also if no camera was adjusted; 1 failed, or another fault is found."

_ADJUST_OPTIONS = (
    *options.of_job("calibration"),
    *options.RECORDINGS,
    *options.CALIBRATION,
    *options.RECORDING,
    *rows(
        """
        Output:
        * -o, --output FILE  Calibration file to write: .toml (Anipose), .json or .npz. Nothing is written if
            no camera or clock was adjusted. [required]
        * --force  Replace FILE if it exists.
        Adjust:
        * --move CAMERA  A camera that was moved. Repeatable; only these are adjusted, instead of those found
            to be wrong.
        * --focal  Also adjust focal lengths, if zoom or focus may have changed.
        * --clock  Also measure clocks to parts of a frame. Offsets of whole frames are found in any case.
        """,
        move={"name": "free", "many": True},
    ),
)


@answers(*_ADJUST_OPTIONS, short=True, epilog=_ADJUST_EPILOG)
def adjust_cameras(
    calibration: Path, detections: list[Path], *, output: Path, force: bool, **given: Any
) -> Answer:
    """Adjust the cameras that were turned or moved since the calibration, from recordings.

    The detections of people walking about, read like those of refine, show
    which cameras are wrong and by how much. The other cameras, more than half,
    stay exactly as they are. Where recordings do not tell which camera is
    wrong, none is adjusted; nor is one that was moved while it recorded.

    [bold]Examples[/bold]

    skelsplat adjust-cameras Calib.toml pose/ -o fixed.toml --unit m --layout body25b

    skelsplat adjust-cameras Calib.qca.txt day1/*/pose -o fixed.toml --move cam_03 --focal
    """
    options.check_output("--output", output, calibration, "calibration", WRITTEN, force=force)
    found = adjust(calibration, detections, **options.reading(given))
    if found.changed:
        names = ", ".join(found.changed)
        by = ", ".join(path.name for path in detections)
        note = f"skelsplat adjust-cameras: {names} of {calibration.name} adjusted by {by}"
        write_calibration(output, found.cameras, note=note, adjusted=True)
    cameras = [numbers_of(one, found.cameras.mm_per_unit) for one in found.adjustment.report]

    def show(console: Console) -> None:
        print_adjusted(console, cameras)
        print_findings(found.findings, console)
        _print_written(found, output)

    document = {
        "calibration": str(calibration),
        "detections": list(map(str, detections)),
        "output": str(output) if found.changed else None,
        "unit": found.cameras.unit,
        "frames": {"fitted": found.adjustment.fitted, "left_out": found.adjustment.judged},
        "findings": [finding.to_dict() for finding in found.findings],
        "cameras": cameras,
        "offsets": found.session.offsets,
    }
    return Answer(document, show, partial(tell_all, found.findings))


def _print_written(found: AdjustedCameras, output: Path) -> None:
    """Say what was written, and what offsets the recordings need."""
    if not found.changed:
        say(f"{output} was not written.")
    else:
        say(f"Wrote {len(found.cameras)} cameras to {output}, lengths in {found.cameras.unit}.")
    if found.changed and found.cameras.clocks:
        say("The clocks hold for what was recorded here; commands that read the file apply them.")
    elif found.session.shared is None and not found.cameras.clocks:
        for name, offsets in found.session.offsets.items():
            words = " ".join(f"--offset {camera}={frames}" for camera, frames in offsets.items() if frames)
            say(f"Clocks of {name}: {words or 'in step'}")
