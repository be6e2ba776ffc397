"""``skelsplat live``: detections in and poses out, a line of JSON each, for programs in any language."""

from __future__ import annotations

import gc
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import typer

from skelsplat.cli import options
from skelsplat.cli._app import FAILED, INTERRUPTED
from skelsplat.cli.command import takes
from skelsplat.cli.output import quieter, say, tell
from skelsplat.cli.rows import QUIET, REQUIRED, rows
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Subject, collected_warnings, warn
from skelsplat.io import read_layout
from skelsplat.run.live import MalformedLineError, Session
from skelsplat.run.read import read_rig

_EPILOG = "Exit status: 0 at the end of the input, 1 failed, 2 bad usage, 130 interrupted."


OPTIONS = (
    *options.of_job("calibration"),
    *options.CALIBRATION,
    replace(
        options.of_job("layout")[0],
        help="Joint layout of the detections: a name that skelsplat layouts lists, or a layout file (.toml).",
        default=REQUIRED,
        shown="",
    ),
    *options.OF_LIVE,
    *rows(
        """
        Over time:
        --fps HZ  Frames per second, one line each, also where nothing is detected: the past then predicts.
            [every frame by itself]
        --lag FRAMES  Answer each line with the frame so many before, from the frames before and after it; the
            first lines with {"waiting": 1}, …; the last frames at the end. Requires --fps. [= 0]
        --people all|N  Follow everybody, or at most N people, and find out who is who. Requires --fps.
            [one person]
        """,
        lag={"kind": int, "limits": {"min": 0}},
        people=options.all_or_number,
    ),
    QUIET,
)


@takes(*OPTIONS, epilog=_EPILOG)
def live(
    calibration: Path,
    *,
    layout: str,
    fps: float | None = None,
    lag: int,
    people: str | int | None = None,
    quiet: bool,
    **given: Any,
) -> None:
    """Refine frame by frame: detections as JSON lines on stdin, poses on stdout.

    A line in is one frame. For every camera it has the joints of the layout as
    x and y in pixels and confidence: cameras in the order of the calibration, or
    by name. Missing values are null, NaN, or have confidence 0. "frame" is any
    value and is returned unchanged; "reset": true discards the past.

    {"frame": 7, "detections": {"cam2": [[812.5, 400.1, 0.9], ...], ...}}

    A line out, flushed at once, has for every joint the position in the unit of
    the calibration, its standard deviations per axis (against an anatomical
    joint, and the scatter), and its status.

    {"frame": 7, "pose": [[1.2, 0.4, 1.5], ...], "joint_status": ["ok", ...], ...}

    A malformed line changes nothing, and its answer has an "error". With --people
    each camera has a list of people, and the answer has everybody with an id.
    The guide on live use has every key; there is no --json, since all is JSON.

    [bold]Examples[/bold]

    skelsplat live Calib.toml --unit mm --layout body25 < recorded.jsonl > poses.jsonl

    detector | skelsplat live Calib.toml --unit m --layout coco17 --fps 30 --people all
    """
    known = read_layout(layout)
    if people is not None and fps is None:
        raise typer.BadParameter("expected --fps as well", param_hint="--people")
    if people is not None and lag:
        expected = "expected no --people: only one person is solved with a lag"
        raise typer.BadParameter(expected, param_hint="--lag")
    reading = options.reading(given)
    of_calibration = reading.pop("read")
    config = options.config_of(n_threads=1, **reading)
    with quieter(quiet), collected_warnings(tell):
        rig = read_rig(calibration, **of_calibration)
        if len(rig) < 2:
            raise DatasetError(calibration, "cameras", "at least two cameras", len(rig))
        if rig.clocks:
            words = f"The clocks of {calibration.name} are not applied: the detections of a line are taken "
            words += "to be of one instant."
            warn(Finding("clocks_not_applied", "warning", Subject(tuple(rig.clocks)), sentence=words))
        session = Session(rig, known, config, fps=fps, lag=lag, people=people)
        if not quiet:
            cameras = f"{len(rig)} cameras ({', '.join(rig.names)})"
            later = f"; each line is answered with the frame {lag} before" if lag else ""
            say(f"ready: {cameras}, {known.n_joints} joints ({known.name}), in {rig.unit}{later}", err=True)
        gc.freeze()  # what has been imported is not searched for garbage again, which takes 10 ms
        try:
            status = _serve(session, sys.stdin.buffer, sys.stdout.buffer)
        finally:
            gc.unfreeze()
    if not quiet:
        say(session.summary(), err=True)
    if status:
        sys.exit(status)


def _serve(session: Session, source: BinaryIO, target: BinaryIO) -> int:
    """Answer line by line until the input ends; return the exit status."""
    try:
        for number, line in enumerate(source, start=1):
            try:
                answer = session.answer(line)
            except MalformedLineError as error:
                say(f"line {number}: skipped: {error}", err=True)
                answer = error.line(number)
            target.write(answer)
            target.flush()
        target.write(session.rest())
        target.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        say(f"error: stdin or stdout: {(error.strerror or str(error)).lower()}", err=True)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing is left to flush at exit
        return FAILED
    return 0
