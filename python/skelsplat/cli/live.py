"""``skelsplat live``: detections in and poses out, a line of JSON each, for programs in any language."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import BinaryIO

import typer

import skelsplat as sk
from skelsplat.cli import inputs, options
from skelsplat.cli._app import FAILED, INTERRUPTED
from skelsplat.cli.options import one_of
from skelsplat.cli.table import tell
from skelsplat.exceptions import DatasetError
from skelsplat.findings import collected_warnings
from skelsplat.run.live import MalformedLineError, Session
from skelsplat.run.read import read_rig

EPILOG = "Exit status: 0 at the end of the input, 1 failed, 2 bad usage, 130 interrupted."


# long: a parameter per option
def live(
    source: inputs.Calibration,
    *,
    layout: options.RequiredLayout = None,
    min_confidence: options.MinConfidence = None,
    no_undistort: options.NoUndistort = False,
    unit: inputs.Unit = None,
    calibration_format: inputs.CalibrationFormat = None,
    camera_type: inputs.CameraType = None,
    subject: inputs.Subject = None,
    size: inputs.Size = None,
    binning: inputs.Binning = None,
    no_swaps: options.NoSwaps = False,
    free_bones: options.FreeBones = False,
    sigma_mm: options.SigmaOfAnnealed = None,
    joint_bias_mm: options.JointBias = None,
    fps: options.LiveRate = None,
    lag: options.Lag = 0,
    quiet: options.Quiet = False,
) -> None:
    """Refine frame by frame: detections as JSON lines on stdin, poses on stdout.

    A line in is one frame of one person: for every camera of the calibration,
    in its order, the joints of the layout as x and y in pixels and confidence.

    {"frame": 7, "detections": [[[812.5, 400.1, 0.9], ...], ...]}

    Missing values are null (a number, a joint or a camera), NaN, or have
    confidence 0. "frame" is any value and is returned unchanged; "reset": true
    discards the previous pose, from which the search otherwise starts.

    A line out, flushed at once, has for every joint the position in the unit of
    the calibration, its standard deviations per axis, and the status: the error
    bar against an anatomical joint, and the scatter, which is a part of it.

    {"frame": 7, "pose": [[1.2, 0.4, 1.5], ...], "error_bar": [[0.02, 0.03, 0.02],
    ...], "scatter": [[0.01, 0.02, 0.01], ...], "joint_status": ["ok", ...],
    "latency_ms": 0.2}

    A joint without a position is null; an unobserved one keeps its previous
    position. "latency_ms" is the time from reading the line to the answer.

    With --fps the past predicts: noise is averaged, and a joint that fewer than
    two views see follows its own motion and bones for up to half a second
    ("inferred"). With --lag N a frame is answered once the N lines after it have
    come, the last N at the end of the input.

    Malformed lines are skipped and reported on stderr with their numbers. At the
    end, the number of lines and percentiles of the latency are printed on stderr.

    Input and output are JSON already: there is no --json.

    [bold]Examples[/bold]

    detector | skelsplat live Calib.toml --unit m --layout coco17 --fps 30 | viewer

    skelsplat live Calib.toml --unit mm --layout body25 < recorded.jsonl > poses.jsonl
    """
    known = sk.layouts.get(one_of("--layout", layout and layout.lower(), sk.layouts.names))
    read = inputs.calibration_arguments(unit, calibration_format, camera_type, subject, size, binning)
    settings = {
        "min_confidence": min_confidence,
        "sigma_mm": sigma_mm,
        "joint_bias_mm": joint_bias_mm,
        "undistort": False if no_undistort else None,
        "find_swaps": False if no_swaps else None,
        "bones": "free" if free_bones else None,
    }
    given = {name: value for name, value in settings.items() if value is not None}
    fps = options.positive("--fps", fps)
    if lag and fps is None:
        raise typer.BadParameter("expected --fps as well", param_hint="--lag")
    with collected_warnings(tell):
        rig = read_rig(source, **read)
        if len(rig) < 2:
            raise DatasetError(source, "cameras", "at least two cameras", len(rig))
        session = Session(rig, known, sk.RefineConfig(n_threads=1, **given), fps=fps, lag=lag)
        if not quiet:
            cameras, joints = f"{len(rig)} cameras ({', '.join(rig.names)})", f"{known.n_joints} joints"
            _print(f"ready: {cameras}, {joints} ({known.name}), in {rig.unit}")
        status = _serve(session, sys.stdin.buffer, sys.stdout.buffer)
    if not quiet:
        _print(session.summary())
    if status:
        sys.exit(status)


def _print(text: str) -> None:
    typer.echo(text, err=True)


def _numbered(source: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield the lines with their numbers from 1; an error of reading becomes a `DatasetError`."""
    try:
        yield from enumerate(source, start=1)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError("stdin", "line", "a stream that can be read", reason) from error


def _serve(session: Session, source: BinaryIO, target: BinaryIO) -> int:
    """Answer line by line until the input ends; return the exit status."""
    try:
        for number, line in _numbered(source):
            try:
                answer = session.answer(line)
            except MalformedLineError as error:
                _print(f"line {number}: skipped: {' '.join(str(error).split())}")
                continue
            if answer is not None:
                target.write(answer)
                target.flush()
        target.write(session.rest() or b"")
        target.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        closed = isinstance(error, BrokenPipeError)
        got = "a closed pipe" if closed else (error.strerror or str(error)).lower()
        _print(f"error: stdout: expected a reader, got {got}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing is left to flush at exit
        return FAILED
    return 0
