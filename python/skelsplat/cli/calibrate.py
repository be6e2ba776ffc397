"""``skelsplat calibrate``: cameras from the people who are filmed, without a calibration."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from skelsplat._optional import DRAWING, check_installed
from skelsplat._words import number
from skelsplat.cli import options
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.config import given_again, source_of
from skelsplat.cli.output import print_findings, print_text, progress, say, tell_all
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_table
from skelsplat.io.calibration import WRITTEN, write_calibration
from skelsplat.run.calibrate import Calibrated, Recorded
from skelsplat.run.calibrate import calibrate_cameras as run_calibration
from skelsplat.run.tables import of_calibrated

_EPILOG = "Exit status: 0 written; 1 failed, or the recording does not tell where the cameras are."
_FORWARDED = ("layout", "frames", "format", "mapping", "sequence", "fps", "person")  # to refine
_OF_FILE = tuple(
    replace(row, panel="Cameras", common=False) for row in options.CALIBRATION[1:] if row.name != "size"
)
_LEGEND = (
    "error: median distance of the detections from the joints; explained: within four times the noise; ±: "
    "one standard deviation, with the rig aligned as a whole"
)
OPTIONS = (
    *options.RECORDINGS,
    *rows(
        """
        Cameras:
        * --intrinsics FILE  Calibration file with the cameras' lenses, image sizes and names; places are
            ignored. Without it, focal lengths are found, which takes three cameras.
        * --same-cameras  Lenses are unknown, but all of one model, zoom and image size.
        * --size WxH  Image size. [as the detections, videos beside them or FILE state it]
        --videos FOLDER  Videos of the cameras, which state the image sizes. [beside the detections]
        """,
        same_cameras={"name": "same_focal"},
        size=options.width_and_height,
    ),
    *_OF_FILE,
    *rows(
        """
        Scale:
        * --stature METRES  Height of the person, or the mean of several. Without it and --distance, that of
            adults: 1.70 ± 0.09 m.
        * --distance CAM1 CAM2 METRES  Distance of two cameras.
        Clocks:
        * --clock  Also find clocks, up to 10 s and to parts of a frame: cameras without a common trigger.
        Input:
        * --person WHO  Use one of several people. largest: the largest in each image; entry:N: entry N of
            each file, from 0. [all people]
        """,
        stature=float,
        distance={"kind": tuple[str, str, float]},
    ),
    *(row for row in options.RECORDING if row.name != "person"),
    *rows(
        """
        Output:
        * -o, --output FILE  Calibration file to write: .toml (Anipose), .json or .npz. [required]
        * --report FILE.html  Page with the cameras, their error ellipsoids in 3D, and what pairs of them
            explain; also written if the recording does not tell where the cameras are.
        * --force  Replace FILE if it exists.
        """
    ),
)


@answers(*OPTIONS, short=True, epilog=_EPILOG)
def calibrate(
    context: typer.Context,
    detections: list[Path],
    *,
    output: Path,
    force: bool,
    report: Path | None = None,
    **given: Any,
) -> Answer:
    """Find where the cameras are from the detections of people who walk about.

    No board is needed: somebody walks two metres, turns around and raises the
    arms, for ten seconds. The calibration is in mm, with z up and the origin on
    the floor. Several recordings of the same person and cameras add up.

    [bold]Examples[/bold]

    skelsplat calibrate pose -o Calib.toml --same-cameras --stature 1.75

    skelsplat calibrate pose -o Calib.toml --intrinsics lenses.toml --clock
    """
    source = given.get("intrinsics") or detections[0]
    options.check_output("--output", output, source, "calibration", WRITTEN, force=force)
    _check_report(report, source, force=force)
    with progress("steps", first="finding cameras") as show:
        asked = options.reading(given)
        found = run_calibration(detections, progress=partial(show, "finding cameras"), **asked)
    sure, commands = found.found.sure, []
    if sure:
        note = f"skelsplat calibrate: from the detections {', '.join(path.name for path in detections)}"
        write_calibration(output, found.found.cameras, note=note, adjusted=True)
        words = [[*_again(context, one, several=len(detections) > 1)] for one in found.recordings]
        commands = [shlex.join(["skelsplat", "refine", str(output), *again]) for again in words]
    if report is not None:
        typed = shlex.join(["skelsplat", *sys.argv[1:]])
        made = [("calibration", str(output) if sure else "not written"), ("command", typed)]
        found.write_html(report, [*made, *(("next", one) for one in commands)])
    document = {
        "detections": list(map(str, detections)),
        "output": str(output) if sure else None,
        "report": None if report is None else str(report),
        **found.to_dict(),
        "refine": commands,
    }
    show = partial(_print, found, output, report, commands)
    return Answer(document, show, partial(tell_all, found.findings), status=0 if sure else 1)


def _check_report(report: Path | None, source: Path, *, force: bool) -> None:
    """Refuse what cannot be the page, or a page without the packages that it needs."""
    if report is not None:
        options.check_output("--report", report, source, "page", (".html",), force=force)
        for package in DRAWING:
            check_installed(package, "--report", "viz")


def _again(context: typer.Context, recorded: Recorded, *, several: bool) -> Iterator[str]:
    """Yield the words after ``skelsplat refine CALIBRATION`` that refine a recording."""
    name = "-".join(part for part in recorded.path.parts if part.strip("./"))
    yield from (str(recorded.path), "-o", f"out-{name}" if several else "out")
    yield from chain.from_iterable(given_again(context, [row for row in OPTIONS if row.name in _FORWARDED]))
    if recorded.uneven and source_of(context, "frames") == "DEFAULT":
        yield from ("--frames", "union")
    if recorded.several:
        yield from ("--people", "all")
    if recorded.order is not None:
        yield from ("--order", ",".join(recorded.order))
    for camera, frames in recorded.offsets.items():
        yield from ("--offset", f"{camera}={frames}")


def _print(found: Calibrated, output: Path, report: Path | None, again: list[str], console: Console) -> None:
    shown = of_calibrated(found)
    heads = [head.replace(" ", "\n", 1) for head, _ in shown.columns]
    table = new_table(shown.title, heads[0], heads[1:])
    for row in shown.rows:
        table.add_row(*row)
    print_table(console, table)
    console.print(_LEGEND, style="dim")
    console.print()
    print_findings(found.findings, console)
    if report is not None:
        say(f"Wrote {report}.")
    if not again:
        say(f"{output} was not written.")
        return
    print_text(console, _world(found))
    refine = f"To refine the recording{'s' if len(again) > 1 else ''}:"
    say(f"Wrote {len(found.found.cameras)} cameras to {output}, lengths in mm. {refine}")
    say(*(f"  {command}" for command in again))  # on one line each, to be pasted


def _world(found: Calibrated) -> str:
    """Return where the scale and up are from, with error bars."""
    result = found.found
    bar, stature = f"{100 * result.scale_sigma:.1f}%", result.stature
    tall = f", by which people are {stature:.2f} m tall" if math.isfinite(stature) else ""
    lengths = {
        "adults": f"± {bar}: a stature of 1.70 ± 0.09 m is assumed (see --stature, --distance)",
        "stature": f"± {bar}, from the stature",
        "distance": f"from the distance of two cameras{tall}",
    }
    up = f"z is up, ± {number(result.up_sigma)}°"
    if not math.isfinite(result.up_sigma):
        up = "z is not up: nobody stands, or the layout lacks ankles, shoulders or a head"
    joints = f"error bars of joints include ± {number(result.cameras.joint_sigma)} mm"
    return f"Lengths are {lengths[found.scale]}; {up}; {joints}."
