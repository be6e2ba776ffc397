"""The options that commands share, with their help, and checks of their values.

Each option is the annotated type of a parameter.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skelsplat import RefineConfig, layouts
from skelsplat.io.detections import FORMATS
from skelsplat.io.poses import POSE_FORMATS

_INPUT, _METHOD, _TIME, _OUTPUT = "Input", "Method", "Over time", "Output"
_DEFAULT, _PAPER = RefineConfig(), RefineConfig.paper()

Detections = Annotated[
    Path,
    typer.Argument(
        readable=False,
        metavar="DETECTIONS",
        help="Folder with one folder or file of 2D detections per camera, named like the camera; "
        "or one file of all cameras.",
    ),
]

LayoutName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Joint layout of the detections: {', '.join(layouts.names)}.",
        show_default="the one whose joints the files name",
        rich_help_panel=_INPUT,
    ),
]
RequiredLayout = Annotated[
    str | None,
    typer.Option(
        "--layout",
        metavar="NAME",
        help=f"Joint layout of the detections: {', '.join(layouts.names)}. Required.",
        rich_help_panel=_INPUT,
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Format of the detections: {', '.join(FORMATS)}.",
        show_default="found from the files",
        rich_help_panel=_INPUT,
    ),
]
Offset = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CAMERA=FRAMES",
        help="Frames to add to a camera's frame numbers, 3 if it started 3 frames late. Repeatable.",
        rich_help_panel=_INPUT,
    ),
]
Order = Annotated[
    str | None,
    typer.Option(
        metavar="A,B,…",
        help="Folder, file or place in the file of each camera, in the calibration's order, or sorted.",
        show_default="by name",
        rich_help_panel=_INPUT,
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CAMERA",
        help="Leave a camera out, whether it has detections or not. Repeatable.",
        rich_help_panel=_INPUT,
    ),
]
JointMap = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="JOINT=NAME",
        help="What the files call a joint of the layout: a name, a place from 0, or none. Repeatable.",
        rich_help_panel=_INPUT,
    ),
]
Sequence = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help='Sequence of a file that has several, such as "S9/Directions 1".',
        rich_help_panel=_INPUT,
    ),
]
Person = Annotated[
    str,
    typer.Option(
        metavar="WHO",
        help="consistent: on whom the views agree; largest: in each image; N: place N of each file, from 0.",
        rich_help_panel=_INPUT,
    ),
]
Frames = Annotated[
    str,
    typer.Option(
        metavar="MODE",
        help="If cameras have different frames, strict refuses (but for formats that list only people: "
        "alphapose, coco, csv), intersection keeps common ones, union all.",
        rich_help_panel=_INPUT,
    ),
]
Init = Annotated[
    Path | None,
    typer.Option(
        readable=False,
        metavar="POSE.npz",
        help="Pose to start from, as refine writes it.",
        show_default="triangulation",
        rich_help_panel=_INPUT,
    ),
]
InitSigma = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help="Standard deviation per axis of an --init that is independent of the detections (monocular, "
        "body model): it then counts as an observation. Not with --paper.",
        rich_help_panel=_INPUT,
    ),
]
MinConfidence = Annotated[
    float | None,
    typer.Option(
        min=0,
        max=1,
        metavar="C",
        help="Leave out detections of less confidence.",
        show_default=f"{_DEFAULT.min_confidence:g}",
        rich_help_panel=_INPUT,
    ),
]
NoUndistort = Annotated[
    bool,
    typer.Option("--no-undistort", metavar="", help="Ignore lens distortion.", rich_help_panel=_INPUT),
]

Paper = Annotated[
    bool,
    typer.Option(
        "--paper",
        metavar="",
        help="The paper's method, pixels and Adam, instead of the robust default.",
        rich_help_panel=_METHOD,
    ),
]
NoSwaps = Annotated[
    bool,
    typer.Option(
        "--no-swaps",
        metavar="",
        help="Do not look for detections with left and right exchanged; --paper never does.",
        rich_help_panel=_METHOD,
    ),
]
Sigma = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help="Width σ of a joint's Gaussian: at most that in the end, with --paper that at the start.",
        show_default=f"{_DEFAULT.sigma_mm:.1f}, with --paper {_PAPER.sigma_mm:.1f}",
        rich_help_panel=_METHOD,
    ),
]
OcclusionSigma = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help="Width σ of elbows, wrists and ankles.",
        show_default="as --sigma-mm",
        rich_help_panel=_METHOD,
    ),
]
SymmetryTier = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=3,
        metavar="0..3",
        help="Limbs kept equal left and right: 0 none, 1 lower, 2 and upper, 3 and trunk.",
        show_default=str(_DEFAULT.symmetry_tier),
        rich_help_panel=_METHOD,
    ),
]
MaxSteps = Annotated[
    int | None,
    typer.Option(
        min=0,
        metavar="N",
        help="Most steps per frame.",
        show_default=f"{_DEFAULT.max_steps}, with --paper {_PAPER.max_steps}",
        rich_help_panel=_METHOD,
    ),
]
Threads = Annotated[
    int | None,
    typer.Option(
        "--threads",
        min=1,
        metavar="N",
        help="Threads to use.",
        show_default="all cores",
        rich_help_panel=_METHOD,
    ),
]

FillGaps = Annotated[
    int | None,
    typer.Option(
        "--fill-gaps",
        min=1,
        metavar="N",
        help="Fill gaps of a joint of at most N frames, marked filled in the results.",
        show_default="none",
        rich_help_panel=_TIME,
    ),
]
FillMethod = Annotated[
    str | None,
    typer.Option(
        "--fill-method",
        metavar="cubic|linear",
        help="Cubic splines, or straight lines.",
        show_default="cubic",
        rich_help_panel=_TIME,
    ),
]
FillWeak = Annotated[
    bool,
    typer.Option(
        "--fill-weak",
        metavar="",
        help="Take joints whose status is weak for gaps as well.",
        rich_help_panel=_TIME,
    ),
]
Filter = Annotated[
    str | None,
    typer.Option(
        "--filter",
        metavar="FILTER",
        help="butterworth[:HZ[:ORDER]], both ways and without lag, or one-euro[:HZ[:BETA]], causal, BETA in "
        "Hz per mm/s. Weak joints stay as they are and pull on no others. Needs --fps.",
        show_default="none",
        rich_help_panel=_TIME,
    ),
]

Out = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="FOLDER", help="Folder for the results.", rich_help_panel=_OUTPUT),
]
Write = Annotated[
    str,
    typer.Option(
        "--write",
        metavar="FORMATS",
        help="Pose files to write beside pose.npz, of csv, trc, c3d, json and nc (xarray, for movement).",
        rich_help_panel=_OUTPUT,
    ),
]
Fps = Annotated[
    float | None,
    typer.Option(
        metavar="HZ", help="Frame rate of the recording, for files and filters.", rich_help_panel=_OUTPUT
    ),
]
YUp = Annotated[
    bool,
    typer.Option(
        "--y-up",
        metavar="",
        help="Write pose.trc and pose.c3d y up (OpenSim), from z up.",
        rich_help_panel=_OUTPUT,
    ),
]
NoHtml = Annotated[
    bool,
    typer.Option(
        "--no-html",
        metavar="",
        help="Leave out report.html, which takes 5 MB and more.",
        rich_help_panel=_OUTPUT,
    ),
]
MarkerNames = Annotated[
    str,
    typer.Option(
        "--marker-names",
        metavar="STYLE",
        help="Names in .trc and .c3d: skelsplat (right_hip), or pose2sim (RHip), for its OpenSim models.",
        rich_help_panel=_OUTPUT,
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", metavar="", help="Say nothing but warnings and errors.", rich_help_panel=_OUTPUT
    ),
]
AsJson = Annotated[
    bool,
    typer.Option(
        "--json",
        metavar="",
        help="Print the result as JSON on stdout, and nothing else there.",
        rich_help_panel=_OUTPUT,
    ),
]
Range = Annotated[
    str | None,
    typer.Option(
        "--range",
        metavar="A-B",
        help="Frames to draw, in the run's numbers; A- and -B leave one end open; A is one frame.",
        show_default="all",
        rich_help_panel="Drawing",
    ),
]


def one_of(option: str, value: str | None, choices: tuple[str, ...]) -> str:
    """Return ``value`` if it is one of ``choices``; None means that a required option is missing."""
    if value in choices:
        return value
    got = "nothing (the files do not say)" if value is None else repr(value)
    raise typer.BadParameter(f"expected one of {', '.join(choices)}, got {got}", param_hint=option)


def positive(option: str, value: float | None) -> float | None:
    """Return ``value`` if it is positive and finite, or None."""
    if value is None or 0 < value < float("inf"):
        return value
    raise typer.BadParameter(f"expected a positive number, got {value:g}", param_hint=option)


def some_of(option: str, value: str, choices: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names in a list with commas, each once and each one of ``choices``."""
    names = tuple(dict.fromkeys(name.strip().lower().removeprefix(".") for name in value.split(",")))
    for name in names:
        if name not in choices:
            expected = f"some of {', '.join(choices)}"
            raise typer.BadParameter(f"expected {expected}, got {name!r}", param_hint=option)
    return names


def formats(value: str) -> tuple[str, ...]:
    """Return npz, which every run writes, and the pose formats in a list with commas, each once."""
    return tuple(dict.fromkeys(["npz", *some_of("--write", value, tuple(POSE_FORMATS))]))
