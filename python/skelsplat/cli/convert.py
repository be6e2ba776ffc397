"""``skelsplat convert``: from one file format to another; the input says what kind of file it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skelsplat.cli import _calibration as calibration
from skelsplat.cli import options
from skelsplat.cli._conversion import Kind, Request
from skelsplat.cli._convert_calibration import CALIBRATION
from skelsplat.cli._convert_poses import POSES
from skelsplat.cli.config import from_file
from skelsplat.cli.output import print_json
from skelsplat.cli.table import tell
from skelsplat.exceptions import DatasetError
from skelsplat.findings import collected_warnings
from skelsplat.io.calibration import find_format

KINDS: tuple[Kind, ...] = (POSES, CALIBRATION)

EPILOG = (
    "Calibrations are read from TOML (Anipose, Pose2Sim, FreeMoCap, Caliscope), OpenCV and EasyMocap YAML "
    "pairs, OpenPose XML folders, Panoptic JSON, Human3.6M JSON, Qualisys .qca.txt, Vicon .xcp, npz and "
    "JSON, and written as .toml (Anipose), .json or .npz. Poses are read and written as .npz, .csv, .trc, "
    ".c3d, .json and .nc."
)

_Input = Annotated[
    Path, typer.Argument(readable=False, metavar="INPUT", help="File, or folder where a format is one.")
]
_Output = Annotated[Path, typer.Argument(metavar="OUTPUT", help="File; its suffix says the format.")]
_ToUnit = Annotated[
    str | None,
    typer.Option(
        metavar="mm|cm|m",
        help="Length unit to write. Pose2Sim takes m, FreeMoCap mm.",
        show_default="that of the input",
        rich_help_panel="Output",
    ),
]
_Fps = Annotated[
    float | None,
    typer.Option(metavar="RATE", help="Poses: frames per second.", rich_help_panel="Output"),
]
_YUp = Annotated[
    bool, typer.Option("--y-up", help="Poses: write a world with z up as y up.", rich_help_panel="Output")
]
_MarkerNames = Annotated[
    str | None,
    typer.Option(
        metavar="STYLE",
        help="Poses in .trc and .c3d: skelsplat, or pose2sim for RHip instead of right_hip.",
        rich_help_panel="Output",
    ),
]
_Singular = Annotated[
    bool,
    typer.Option("--singular", help="Poses in .nc: as movement 0.17.", rich_help_panel="Output"),
]


def convert(
    context: typer.Context,
    source: _Input,
    target: _Output,
    *,
    unit: calibration.Unit = None,
    format: calibration.Format = None,
    camera_type: calibration.CameraType = None,
    subject: calibration.Subject = None,
    size: calibration.Size = None,
    binning: calibration.Binning = None,
    to_unit: _ToUnit = None,
    fps: _Fps = None,
    y_up: _YUp = False,
    marker_names: _MarkerNames = None,
    singular: _Singular = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Convert a calibration, or poses (a file, or the folder of a run), to another format.

    [bold]Examples[/bold]

    skelsplat convert Calib.qca.txt Calib.toml --to-unit m

    skelsplat convert session.xcp rig.json

    skelsplat convert calibration/ Calib.toml --unit m

    skelsplat convert out walk.c3d --fps 60 --y-up

    skelsplat convert camera-parameters.json S9.toml --subject S9

    skelsplat convert cameraParameters/ Calib.toml --size 1280x1024
    """
    if target.suffix.lower() == ".csv" and from_file(context, "fps"):
        fps = None  # which may be meant for another command
    given = {
        "unit": unit,
        "format": format,
        "camera_type": camera_type,
        "subject": subject,
        "size": size,
        "binning": binning,
        "to_unit": to_unit,
        "fps": fps,
        "y_up": y_up or None,
        "marker_names": marker_names,
        "singular": singular or None,
    }
    request = Request(source, target, {name: value for name, value in given.items() if value is not None})
    kind = _kind(request)
    with collected_warnings(tell):
        written = kind.convert(request)
    if as_json:
        files = {"kind": kind.name, "input": str(source), "output": str(target)}
        print_json({**files, **written.document})
    elif not quiet:
        typer.echo(written.sentence)


def _kind(request: Request) -> Kind:
    """Return the kind of the input, which must be able to become the output with these options."""
    if not request.source.exists():
        raise DatasetError(request.source, "file", "a readable file or folder", "no such file")
    named = CALIBRATION if "format" in request.options else None
    kind = named or next((kind for kind in KINDS if kind.recognises(request.source)), None)
    if kind is None:
        raise _unknown(request.source)
    if request.target.suffix.lower() not in kind.suffixes:
        expected = f"a {kind.name} to be written as {', '.join(kind.suffixes)}"
        raise typer.BadParameter(
            f"expected {expected}, got {request.target.suffix or 'no suffix'!r}", param_hint="OUTPUT"
        )
    stray = [name for name in request.options if name not in kind.options]
    if stray:
        hint = "--" + stray[0].replace("_", "-")
        raise typer.BadParameter(f"expected none for a {kind.name}, got one", param_hint=hint)
    return kind


def _unknown(source: Path) -> DatasetError:
    """Return what is wrong with an input of no kind."""
    expected = "a calibration in a known format, a file of poses, or the folder of a run"
    try:
        find_format(source)
    except DatasetError as error:
        return error
    return DatasetError(source, "content", expected, "something else (convert --help has the formats)")
