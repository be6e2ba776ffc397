"""``skelsplat detect``: 2D detections from videos."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import typer

from skelsplat.cli import options
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.output import progress, say, tell
from skelsplat.cli.rows import rows
from skelsplat.detect import Detected, Detector, MediaPipe, RTMLib
from skelsplat.detect import detect as run_detector
from skelsplat.findings import collected_warnings
from skelsplat.run.frame_range import FrameRange

_EPILOG = (
    "mediapipe: one person, 33 points (layout mediapipe33), runs offline; pip install "
    "'skelsplat\\[mediapipe]'. rtmlib: several people, 26, 17 or 133 points (halpe26, coco17, wholebody133), "
    "downloads its networks when they are first used; pip install 'skelsplat\\[rtmlib]'."
)
OPTIONS = rows(
    """
    VIDEOS  Folder with one video or one folder of images per camera, or these themselves. Their names are
        those of the cameras.
    Input:
    --range A-B  Frames to detect, from 0; A- and -B are open ranges. [all]
    Detector:
    --backend mediapipe|rtmlib  Detector to use. [= mediapipe]
    --model NAME  Of mediapipe: full, lite or heavy. Of rtmlib: body-feet, body or whole-body.
        [full; body-feet]
    --mode NAME  rtmlib: balanced, lightweight or performance. [balanced]
    --device NAME  rtmlib: cpu or cuda. [cpu]
    Output:
    -o, --output FOLDER  Folder to write. [= pose]
    --overwrite  Replace detections that this command wrote before.
    """,
    videos={"kind": Path, "many": True},
    range=options.frame_range,
)


@answers(*OPTIONS, epilog=_EPILOG)
def detect(
    videos: list[Path],
    *,
    output: Path,
    backend: str,
    range: FrameRange | None = None,
    overwrite: bool,
    **of_detector: Any,
) -> Answer:
    """Detect people in the videos of all cameras, for refine.

    Writes OpenPose JSON, one folder per camera and one file per frame, and
    detect.json, from which refine knows the layout and the frame rate. Frames
    that are there already are not detected again: after Ctrl-C, repeat the
    command to continue.

    [bold]Examples[/bold]

    skelsplat detect cam01.mp4 cam02.mp4 -o pose --range 0-299

    skelsplat detect videos/ -o pose --backend rtmlib --model whole-body
    """
    detector, frames = _detector(backend, of_detector), range or FrameRange()
    with collected_warnings(tell) as found, progress("frames") as count:
        written = run_detector(
            videos,
            output,
            detector,
            first=frames.first,
            last=frames.last,
            overwrite=overwrite,
            progress=count,
        )
    document = {
        "folder": str(output),
        "detector": dict(detector.settings),
        "layout": detector.layout,
        "cameras": [one.to_dict() for one in written],
        "findings": [one.to_dict() for one in found],
    }
    again = shlex.join(["skelsplat", "refine", "CALIBRATION", str(output), "-o", "out"])
    cameras = shlex.join(["skelsplat", "calibrate", str(output), "-o", "Calib.toml"])
    end = f"Wrote to {output}/, with the layout {detector.layout}. Next: {again}"
    end += f"; {cameras} makes a CALIBRATION"
    return Answer(document, lambda _: say(*map(_line, written), end))


def _detector(backend: str, given: dict[str, Any]) -> Detector:
    """Return the detector that is asked for."""
    if backend == "rtmlib":
        return RTMLib(**given)
    for name in given.keys() - {"model"}:
        option = f"--{name.replace('_', '-')}"
        raise typer.BadParameter("does not apply to mediapipe, only to rtmlib", param_hint=option)
    return MediaPipe(**given)


def _line(one: Detected) -> str:
    rate = "" if one.frame_rate is None else f", {one.frame_rate:g} Hz"
    new = "" if one.new == one.frames else f", {one.new} of them new"
    empty = f", {one.empty} without a person" if one.empty else ""
    size = f"{one.size[0]}×{one.size[1]}{rate}"
    return f"{one.folder}: {one.frames} frames{new}{empty} ({one.video.name}, {size})"
