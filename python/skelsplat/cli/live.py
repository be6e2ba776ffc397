"""``skelsplat live``: detections in and poses out, a line of JSON each, for programs in any language."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
import typer

import skelsplat as sk
from skelsplat.cli import _calibration as calibration
from skelsplat.cli import options
from skelsplat.cli._app import FAILED, INTERRUPTED
from skelsplat.cli._calibration import CalibrationOptions
from skelsplat.cli._lines import MalformedLineError, answer_text, parse_line
from skelsplat.cli.options import one_of
from skelsplat.exceptions import DatasetError
from skelsplat.findings import collected_warnings

if TYPE_CHECKING:
    from collections.abc import Iterator

EPILOG = "Exit status: 0 at the end of the input, 1 failed, 2 bad usage, 130 interrupted."
_PERCENTILES = (50, 90, 99, 99.9)


def live(
    source: calibration.Calibration,
    *,
    layout: options.RequiredLayout = None,
    min_confidence: options.MinConfidence = None,
    no_undistort: options.NoUndistort = False,
    unit: calibration.Unit = None,
    calibration_format: calibration.Format = None,
    camera_type: calibration.CameraType = None,
    subject: calibration.Subject = None,
    size: calibration.Size = None,
    binning: calibration.Binning = None,
    no_swaps: options.NoSwaps = False,
    sigma: options.Sigma = None,
    quiet: options.Quiet = False,
) -> None:
    """Refine frame after frame: JSON lines of detections on stdin, of poses on stdout.

    A line in is one frame of one person: for every camera of the calibration,
    in its order, the joints of the layout as x and y in pixels and confidence.

    {"frame": 7, "detections": [[[812.5, 400.1, 0.9], ...], ...]}

    What is missing is null (a number, a joint or a camera), NaN, or of
    confidence 0. "frame" is any value and comes back as it is; "reset": true
    forgets the pose of the line before, from which the search starts otherwise.

    A line out, flushed at once, has for every joint the position in the unit of
    the calibration, its standard deviation per axis, and the status.

    {"frame": 7, "pose": [[1.2, 0.4, 1.5], ...], "sigma": [[0.01, 0.02, 0.01],
    ...], "joint_status": ["ok", ...], "latency_ms": 0.2}

    A joint without a position is null; an unobserved one stays where it was in
    the line before. "latency_ms" is the time from having read the line to the
    answer.

    The language of stdin and stdout is JSON already: there is no --json.

    A malformed line is named on stderr with its number and skipped. At the end
    stderr has the count of the lines and percentiles of the latency.

    [bold]Examples[/bold]

    detector | skelsplat live Calib.toml --unit m --layout coco17 | viewer

    skelsplat live Calib.toml --unit mm --layout body25 < recorded.jsonl > poses.jsonl
    """
    known = sk.layouts.get(one_of("--layout", layout and layout.lower(), sk.layouts.names))
    read = CalibrationOptions(unit, calibration_format, camera_type, subject, size, binning)
    settings = {
        "min_confidence": min_confidence,
        "sigma": sigma,
        "undistort": False if no_undistort else None,
        "find_swaps": False if no_swaps else None,
    }
    given = {name: value for name, value in settings.items() if value is not None}
    with collected_warnings(lambda found: _say(f"warning: {found.text}")):
        rig = read.read(source, format_option="--calibration-format")
        if len(rig) < 2:
            raise DatasetError(source, "cameras", "at least two cameras", len(rig))
        session = Session(rig, known, sk.RefineConfig(n_threads=1, **given))
        if not quiet:
            cameras, joints = f"{len(rig)} cameras ({', '.join(rig.names)})", f"{known.n_joints} joints"
            _say(f"ready: {cameras}, {joints} ({known.name}), in {rig.unit}")
        status = _serve(session, sys.stdin.buffer, sys.stdout.buffer)
    if not quiet:
        _say(session.summary())
    if status:
        sys.exit(status)


def _say(text: str) -> None:
    typer.echo(text, err=True)


def _numbered(source: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield the lines with their numbers from 1; a fault of reading is told from one of writing."""
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
                _say(f"line {number}: skipped: {' '.join(str(error).split())}")
                continue
            if answer is not None:
                target.write(answer)
                target.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        closed = isinstance(error, BrokenPipeError)
        got = "a closed pipe" if closed else (error.strerror or str(error)).lower()
        _say(f"error: stdout: expected a reader, got {got}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing is left to flush at exit
        return FAILED
    return 0


class Session:
    """A refiner with its latencies: one line in, one line out.

    Parameters
    ----------
    rig, layout, config
        As for `skelsplat.Refiner`.
    """

    def __init__(self, rig: sk.CameraRig, layout: sk.Layout, config: sk.RefineConfig) -> None:
        self._refiner = sk.Refiner(rig, layout=layout, config=config)
        self._size = (len(rig), layout.n_joints)
        self._latencies_ms: list[float] = []
        self._skipped = 0
        self._begun = self._ended = 0.0

    def answer(self, line: bytes) -> bytes | None:
        """Return the line that answers ``line``, None for a blank one.

        Raises
        ------
        MalformedLineError
            If the line is malformed; it is counted as skipped.
        """
        begin = time.perf_counter()
        try:
            frame = parse_line(line, *self._size)
            if frame is None:
                return None
            if frame.reset:
                self._refiner.reset()
            text = answer_text(frame, self._refiner.step(frame.detections))
        except sk.SkelSplatError as error:
            self._skipped += 1
            raise MalformedLineError(str(error)) from error
        except MalformedLineError:
            self._skipped += 1
            raise
        self._ended = time.perf_counter()
        self._begun = self._begun or begin
        self._latencies_ms.append(1000.0 * (self._ended - begin))
        return f'{text}, "latency_ms": {self._latencies_ms[-1]:.4f}}}\n'.encode()

    def summary(self) -> str:
        """Return how many lines were answered and skipped, how fast, and the percentiles of the latency."""
        count = len(self._latencies_ms)
        answered = f"lines answered {count}, skipped {self._skipped}"
        if not count:
            return answered
        values = np.percentile(self._latencies_ms, _PERCENTILES)
        parts = [f"{share:g}% {value:.3f}" for share, value in zip(_PERCENTILES, values, strict=True)]
        rate = count / max(self._ended - self._begun, 1e-9)
        longest = f"longest {max(self._latencies_ms):.3f}"
        return f"{answered}; {rate:.0f} per second; latency in ms: {', '.join(parts)}, {longest}"
