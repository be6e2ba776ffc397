"""Options for reading calibrations and detections, as arguments of their readers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from skelsplat.cli import options
from skelsplat.cli.command import with_parameters_of
from skelsplat.io.calibration import FORMATS
from skelsplat.run.job import FRAME_MODES

_PANEL = "Calibration"
_OF_DETECTIONS = (
    *("--layout", "--format", "--frames", "--offset", "--order", "--map", "--sequence", "--person"),
)

Calibration = Annotated[
    Path,
    typer.Argument(
        readable=False,
        metavar="CALIBRATION",
        help="Calibration file or its folder. convert --help lists the formats.",
    ),
]

Unit = Annotated[
    str | None,
    options.option(
        _PANEL,
        metavar="mm|cm|m",
        help="Length unit of the calibration. Needed if the format does not state it: Anipose TOML, OpenCV "
        "YAML, 4D association.",
    ),
]
CalibrationFormat = Annotated[
    str | None,
    options.option(
        _PANEL,
        metavar="NAME",
        help=f"Format of the calibration: {', '.join(sorted(FORMATS))}.",
        default="found from the content",
    ),
]
CameraType = Annotated[
    str | None,
    options.option(
        _PANEL,
        metavar="TYPE",
        help="Which cameras of the file: hd, vga, … (Panoptic), video cameras (Qualisys, Vicon), or all.",
    ),
]
Subject = Annotated[
    str | None, options.option(_PANEL, metavar="S1", help="Human3.6M: the subject with these cameras.")
]
Size = Annotated[
    str | None,
    options.option(
        _PANEL,
        metavar="WxH",
        help="Image size, if the files do not state it: OpenPose, some OpenCV YAML, VoxelPose, DANNCE.",
    ),
]
Binning = Annotated[
    float | None, options.option(_PANEL, metavar="N", help="Qualisys: sensor pixels per pixel of the video.")
]


def calibration_arguments(
    *,
    unit: Unit = None,
    calibration_format: CalibrationFormat = None,
    camera_type: CameraType = None,
    subject: Subject = None,
    size: Size = None,
    binning: Binning = None,
) -> dict[str, Any]:
    """Return the arguments of `skelsplat.run.read.read_rig`, which are fields of `skelsplat.run.Job`, too."""
    names = {"unit": unit, "calibration_format": calibration_format, "camera_type": camera_type}
    return {**names, "subject": subject, "size": width_and_height(size), "binning": binning}


# long: a parameter per option
@with_parameters_of(calibration_arguments)
def recording_arguments(
    *,
    layout: options.LayoutName = None,
    person: options.Entry = "everybody",
    frames: options.Frames = "union",
    format: options.Format = None,
    offset: options.Offset = None,
    order: options.Order = None,
    without: options.Without = None,
    joint_map: options.JointMap = None,
    sequence: options.Sequence = None,
    **reading: Any,
) -> dict[str, Any]:
    """Return the arguments of `skelsplat.run.check_cameras` and `adjust_cameras` for reading a recording.

    Raises
    ------
    typer.BadParameter
        If a value does not have the form of its option.
    """
    return {
        "read": calibration_arguments(**reading),
        "without": without or (),
        "person": person,
        "layout": layout,
        "frames": options.one_of("--frames", frames, FRAME_MODES),
        "sequence": sequence,
        **detection_arguments(format, offset, order, joint_map),
    }


def width_and_height(text: str | None) -> tuple[int, int] | None:
    """Return the width and height of ``--size``, or raise `typer.BadParameter`."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d+)[x×](\d+)", text.strip())
    if found is None or not (int(found[1]) and int(found[2])):
        raise typer.BadParameter(
            f"expected a width and a height such as 1920x1080, got {text!r}", param_hint="--size"
        )
    return int(found[1]), int(found[2])


def detection_arguments(
    name: str | None, offset: list[str] | None, order: str | None, joint_map: list[str] | None
) -> dict[str, Any]:
    """Return the arguments ``format``, ``offsets``, ``order`` and ``mapping`` of the reader.

    Raises
    ------
    typer.BadParameter
        If a value does not have the form of its option.
    """
    return {
        "format": None if name is None else name.lower(),
        "offsets": {camera: _offset(text) for camera, text in _pairs("--offset", offset)},
        "order": order if order in (None, "sorted") else tuple(part.strip() for part in order.split(",")),
        "mapping": {joint: _source(text) for joint, text in _pairs("--map", joint_map)},
    }


def refuse_detection_options(context: typer.Context) -> None:
    """Refuse command-line options for reading detections, where there are none.

    Those of a configuration file may be meant for another command.

    Raises
    ------
    typer.BadParameter
        If there is one.
    """
    for param in context.command.params:
        source = getattr(context.get_parameter_source(str(param.name)), "name", "")
        if source == "COMMANDLINE" and param.opts[0] in _OF_DETECTIONS:
            raise typer.BadParameter("requires DETECTIONS", param_hint=param.opts[0])


def repeated(context: typer.Context, without: Sequence[str] = ()) -> list[str]:
    """Return the options of a command that were given, on the command line or in a file, to be given again.

    Flags are not; ``without`` are names of other parameters that are not either.
    """
    words: list[str] = []
    for param in context.command.params:
        value, name = context.params.get(str(param.name)), str(param.name)
        option = next((text for text in param.opts if text.startswith("--")), None)
        if option is None or name in (*without, "config") or isinstance(value, bool) or not value:
            continue
        source = getattr(context.get_parameter_source(name), "name", "DEFAULT")
        if source != "DEFAULT":
            words += [
                word
                for one in (value if isinstance(value, list | tuple) else [value])
                for word in (option, str(one))
            ]
    return words


def _pairs(option: str, values: list[str] | None) -> Iterator[tuple[str, str]]:
    """Yield the two sides of each ``A=B``; no A comes twice."""
    seen = set()
    for value in values or []:
        left, equals, right = (part.strip() for part in value.rpartition("="))
        if not (left and equals and right) or left in seen:
            raise typer.BadParameter(f"expected A=B, each A once, got {value!r}", param_hint=option)
        seen.add(left)
        yield left, right


def _offset(text: str) -> float:
    if not re.fullmatch(r"[+-]?\d+(\.\d+)?", text):
        expected = "a number of frames, like cam2=3 or cam2=-1.25"
        raise typer.BadParameter(f"expected {expected}, got {text!r}", param_hint="--offset")
    return float(text) if "." in text else int(text)


def _source(text: str) -> str | int | None:
    """Return what ``--map`` gives for a joint: an index, None, or a name."""
    return int(text) if text.isdecimal() else None if text == "none" else text
