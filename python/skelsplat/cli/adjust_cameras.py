"""``skelsplat adjust-cameras``: a calibration corrected by a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import typer
from rich.table import Table

from skelsplat._words import number, with_bar
from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.findings import print_finding, telling
from skelsplat.cli.output import Terminal, print_json, say
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_parts
from skelsplat.exceptions import DatasetError
from skelsplat.io import write_calibration
from skelsplat.run.adjust import AdjustedCameras, numbers_of
from skelsplat.run.adjust import adjust_cameras as adjust

EPILOG = (
    "Exit status: 0 done, also if no camera was adjusted; 1 a file is unreadable or another fault is found."
)
COMMON = (
    *("output", "unit", "layout", "person", "frames", "without", "offsets", "order", "mapping"),
    *("free", "focal", "clock", "force", "quiet", "as_json"),
)
_SUFFIXES = (".toml", ".json", ".npz")
_LEGEND = (
    "±: error bar; for a camera that was not adjusted, how far off it may still be; before, after:"
    " median distance of the detections from where the other cameras place the joints"
)

OPTIONS = (
    options.CALIBRATION_FILE,
    options.DETECTIONS,
    *options.CALIBRATION,
    *options.RECORDING,
    *rows(
        "Output",
        """
        -o, --output FILE  Calibration file to write: .toml (Anipose), .json or .npz. Nothing is written if no
            camera was adjusted. [required]
        """,
        output=Path,
    ),
    *rows(
        "Adjust",
        """
        --move CAMERA  A camera that was moved. Repeatable; only these are adjusted, instead of those found to
            be wrong.
        --focal  Also adjust focal lengths, if zoom or focus may have changed.
        --clock  Also measure clocks to parts of a frame. Offsets of whole frames are found in any case.
        """,
        move={"name": "free", "many": True},
    ),
    *rows("Output", "--force  Replace FILE if it exists."),
    options.QUIET,
    options.AS_JSON,
)


@takes(*OPTIONS, common=COMMON)
def adjust_cameras(
    calibration: Path,
    detections: Path,
    *,
    output: Path,
    force: bool,
    quiet: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Adjust the cameras that were turned or moved since the calibration, from a recording.

    The detections of people walking about, read like those of refine, show
    which cameras are wrong and by how much. The other cameras, more than half,
    stay exactly as they are. Where the recording does not tell which camera is
    wrong, none is adjusted.

    [bold]Examples[/bold]

    skelsplat adjust-cameras Calib.toml pose/ -o fixed.toml --unit m --layout body25b

    skelsplat adjust-cameras Calib.toml pose/ -o fixed.toml --unit m --layout body25b --move cam_03

    skelsplat adjust-cameras Calib.qca.txt pose/ -o fixed.toml --focal --json
    """
    _check_output(output, calibration, force=force)
    found = adjust(calibration, detections, **options.reading(given))
    if found.adjusted:
        names = ", ".join(found.adjusted)
        note = f"skelsplat adjust-cameras: {names} of {calibration.name} adjusted by {detections.name}"
        write_calibration(output, found.cameras, note=note, adjusted=True)
    if as_json:
        print_json(_document(calibration, detections, output, found))
    elif quiet:
        for finding in found.findings:
            telling(quiet=quiet)(finding)
    else:
        _print(found, output, focal=given["focal"], clock=given["clock"])


def _check_output(output: Path, source: Path, *, force: bool) -> None:
    if output.suffix.lower() not in _SUFFIXES:
        expected = f"a calibration to be written as {', '.join(_SUFFIXES)}"
        got = output.suffix or "no suffix"
        raise typer.BadParameter(f"expected {expected}, got {got!r}", param_hint="--output")
    if output.resolve() == source.resolve():
        raise DatasetError(output, "output", "another file than CALIBRATION", "the same")
    if output.exists() and not force:
        raise DatasetError(output, "output", "no file of this name (--force replaces it)", "one that exists")


def _print(found: AdjustedCameras, output: Path, *, focal: bool, clock: bool) -> None:
    console = Terminal()
    print_parts(console, _table(found, focal=focal, clock=clock), names=2)
    console.print(_LEGEND, style="dim")
    console.print()
    for finding in found.findings:
        print_finding(console, finding, own_line=True)
    wrote = f"Wrote {len(found.cameras)} cameras to {output}, lengths in {found.cameras.unit}."
    say(wrote if found.adjusted else f"{output} was not written.")


def _table(found: AdjustedCameras, *, focal: bool, clock: bool) -> Table:
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


def _document(source: Path, detections: Path, output: Path, found: AdjustedCameras) -> dict[str, Any]:
    mm = found.cameras.mm_per_unit
    return {
        "calibration": str(source),
        "detections": str(detections),
        "output": str(output) if found.adjusted else None,
        "unit": found.cameras.unit,
        "frames": {"fitted": found.adjustment.fitted, "left_out": found.adjustment.judged},
        "findings": [finding.to_dict() for finding in found.findings],
        "cameras": [numbers_of(one, mm) for one in found.adjustment.report],
    }
