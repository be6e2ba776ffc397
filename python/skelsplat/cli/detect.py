"""``skelsplat detect``: 2D detections from videos."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from skelsplat.cli import options
from skelsplat.cli.output import counting, print_json, say
from skelsplat.cli.table import telling
from skelsplat.detect import Detected, Detector, MediaPipe, RTMLib
from skelsplat.detect import detect as run_detector
from skelsplat.findings import collected_warnings
from skelsplat.run.frame_range import FrameRange

EPILOG = (
    "mediapipe: one person, 33 points (layout mediapipe33), runs offline; pip install "
    "'skelsplat\\[mediapipe]'. rtmlib: several people, 26, 17 or 133 points (halpe26, coco17, wholebody133), "
    "downloads its networks when they are first used; pip install 'skelsplat\\[rtmlib]'."
)
BACKENDS = ("mediapipe", "rtmlib")
_INPUT, _DETECTOR, _OUTPUT = "Input", "Detector", "Output"

_Videos = Annotated[
    list[Path],
    typer.Argument(
        readable=False,
        metavar="VIDEOS",
        help="Folder with one video or one folder of images per camera, or these themselves. Their names are "
        "those of the cameras.",
    ),
]
_Range = Annotated[
    str | None,
    options.option(
        _INPUT,
        "--range",
        metavar="A-B",
        help="Frames to detect, from 0; A- and -B are open ranges.",
        default="all",
    ),
]
_Backend = Annotated[str, options.option(_DETECTOR, metavar="NAME", help="mediapipe or rtmlib.")]
_Model = Annotated[
    str | None,
    options.option(
        _DETECTOR,
        metavar="NAME",
        help="Of mediapipe: full, lite or heavy. Of rtmlib: body-feet, body or whole-body.",
        default="full; body-feet",
    ),
]
_Mode = Annotated[
    str | None,
    options.option(
        _DETECTOR, metavar="NAME", help="rtmlib: balanced, lightweight or performance.", default="balanced"
    ),
]
_DetModel = Annotated[
    Path | None,
    options.option(_DETECTOR, metavar="FILE", help="rtmlib: ONNX file that finds people (YOLOX)."),
]
_PoseModel = Annotated[
    Path | None,
    options.option(_DETECTOR, metavar="FILE", help="rtmlib: ONNX file that finds joints (RTMPose)."),
]
_Device = Annotated[
    str | None, options.option(_DETECTOR, metavar="NAME", help="rtmlib: cpu or cuda.", default="cpu")
]
_Out = Annotated[Path, options.option(_OUTPUT, "-o", "--output", metavar="FOLDER", help="Folder to write.")]
_Overwrite = Annotated[
    bool, options.flag(_OUTPUT, "--overwrite", help="Replace detections that this command wrote before.")
]


# long: a parameter per option
def detect(
    videos: _Videos,
    *,
    output: _Out = Path("pose"),
    backend: _Backend = "mediapipe",
    model: _Model = None,
    mode: _Mode = None,
    det_model: _DetModel = None,
    pose_model: _PoseModel = None,
    device: _Device = None,
    range: _Range = None,
    overwrite: _Overwrite = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Detect people in the videos of all cameras, for refine.

    Writes OpenPose JSON, one folder per camera and one file per frame, and
    detect.json, from which refine knows the layout and the frame rate. Frames
    that are there already are not detected again: after Ctrl-C, repeat the
    command to continue.

    [bold]Examples[/bold]

    skelsplat detect videos/ -o pose

    skelsplat detect cam01.mp4 cam02.mp4 -o pose --range 0-299

    skelsplat detect videos/ -o pose --backend rtmlib --model whole-body
    """
    of_rtmlib = {"mode": mode, "det_model": det_model, "pose_model": pose_model, "device": device}
    detector = _detector(
        backend, model, {key: value for key, value in of_rtmlib.items() if value is not None}
    )
    frames = FrameRange.parse(range)
    with collected_warnings(telling(quiet=quiet)) as found, counting("frames", shown=not quiet) as progress:
        written = run_detector(
            videos,
            output,
            detector,
            first=frames.first,
            last=frames.last,
            overwrite=overwrite,
            progress=progress,
        )
    if as_json:
        print_json(
            {
                "folder": str(output),
                "detector": dict(detector.settings),
                "layout": detector.layout,
                "cameras": [one.to_dict() for one in written],
                "findings": [one.to_dict() for one in found],
            }
        )
    elif not quiet:
        _tell(written, detector.layout, output)


def _detector(backend: str, model: str | None, of_rtmlib: dict[str, Any]) -> Detector:
    """Return the detector that is asked for."""
    options.one_of("--backend", backend, BACKENDS)
    given: dict[str, Any] = {} if model is None else {"model": model}
    if backend == "rtmlib":
        return RTMLib(**given, **of_rtmlib)
    for name in of_rtmlib:
        option = f"--{name.replace('_', '-')}"
        raise typer.BadParameter("does not apply to mediapipe, only to rtmlib", param_hint=option)
    return MediaPipe(**given)


def _tell(written: list[Detected], layout: str, output: Path) -> None:
    for one in written:
        rate = "" if one.frame_rate is None else f", {one.frame_rate:g} Hz"
        new = "" if one.new == one.frames else f", {one.new} of them new"
        empty = f", {one.empty} without a person" if one.empty else ""
        size = f"{one.size[0]}×{one.size[1]}{rate}"
        say(f"{one.folder}: {one.frames} frames{new}{empty} ({one.video.name}, {size})")
    again = shlex.join(["skelsplat", "refine", "CALIBRATION", str(output), "-o", "out"])
    say(f"Wrote to {output}/, with the layout {layout}. Next: {again}")
