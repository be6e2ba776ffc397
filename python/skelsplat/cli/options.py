"""The options that commands share, with their help, and checks of their values.

Each option is the annotated type of a parameter.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from skelsplat import RefineConfig, layouts
from skelsplat.io.detections import FORMATS
from skelsplat.io.poses import POSE_FORMATS

_INPUT, _METHOD, _TIME, _OUTPUT = "Input", "Method", "Over time", "Output"
_ANNEALED, _OF_PAPER = (
    {setting.name: setting for setting in RefineConfig.settings(method)} for method in ("annealed", "paper")
)


def _sentence(name: str) -> str:
    """Return what a setting does, in the core's words, with options instead of settings."""
    sentences = [
        re.sub(r"`(\w+)`", lambda found: "--" + found[1].replace("_", "-"), table[name].sentence)
        for table in (_ANNEALED, _OF_PAPER)
        if name in table
    ]
    both = [text.partition("; None:")[0].rstrip(".") + "." for text in dict.fromkeys(sentences)]
    return " With --paper: ".join([both[0], *(text[0].lower() + text[1:] for text in both[1:])])


def _default(name: str) -> str:
    """Return the default of a setting, with that of the paper's method if it is another."""
    texts = [f"{table[name].default:.4g}" for table in (_ANNEALED, _OF_PAPER) if name in table]
    return ", with --paper ".join(dict.fromkeys(texts))


Detections = Annotated[
    Path,
    typer.Argument(
        readable=False,
        metavar="DETECTIONS",
        help="Folder or file of 2D detections. A folder has one folder or file per camera, named like the "
        "camera.",
    ),
]

LayoutName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Joint layout, such as body25b. One of {', '.join(layouts.names)}.",
        show_default="the one whose joints the files name",
        rich_help_panel=_INPUT,
    ),
]
RequiredLayout = Annotated[
    str | None,
    typer.Option(
        "--layout",
        metavar="NAME",
        help=f"Joint layout of the detections, one of {', '.join(layouts.names)}. Required.",
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
        help="Add to a camera's frame numbers. 3 if it started 3 frames late. Repeatable.",
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
        help="Leave a camera out. Repeatable; the camera need not have detections.",
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
        help="Whom to follow. consistent: the person the views agree on; largest: the largest in each image; "
        "N: the one at place N of each file, from 0.",
        rich_help_panel=_INPUT,
    ),
]
Frames = Annotated[
    str,
    typer.Option(
        metavar="MODE",
        help="What to do if cameras have different frames. strict refuses (except for formats that list only "
        "people: alphapose, coco, csv), intersection keeps common frames, union all.",
        rich_help_panel=_INPUT,
    ),
]
Init = Annotated[
    Path | None,
    typer.Option(
        readable=False,
        metavar="POSE.npz",
        help="Pose file to start from.",
        show_default="triangulation",
        rich_help_panel=_INPUT,
    ),
]
InitSigma = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help="Standard deviation of --init per axis, in mm. With it, an --init that is independent of the "
        "detections (monocular, body model) counts as an observation. Not with --paper.",
        rich_help_panel=_INPUT,
    ),
]
MinConfidence = Annotated[
    float | None,
    typer.Option(
        min=0,
        max=1,
        metavar="C",
        help=_sentence("min_confidence"),
        show_default=_default("min_confidence"),
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
        help="Use the method of the paper. It renders pixels and optimises with Adam; the default is more "
        "robust.",
        rich_help_panel=_METHOD,
    ),
]
NoSwaps = Annotated[
    bool,
    typer.Option(
        "--no-swaps",
        metavar="",
        help="Do not look for exchanged left and right sides; --paper never does.",
        rich_help_panel=_METHOD,
    ),
]
Sigma = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help=_sentence("sigma_mm"),
        show_default=_default("sigma_mm"),
        rich_help_panel=_METHOD,
    ),
]
OcclusionSigma = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help=_sentence("occlusion_sigma_mm"),
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
        help=f"{_sentence('symmetry_tier')} 1: lower limbs, 2: also upper limbs, 3: also trunk.",
        show_default=_default("symmetry_tier"),
        rich_help_panel=_METHOD,
    ),
]
MaxSteps = Annotated[
    int | None,
    typer.Option(
        min=0,
        metavar="N",
        help=_sentence("max_steps"),
        show_default=_default("max_steps"),
        rich_help_panel=_METHOD,
    ),
]
Threads = Annotated[
    int | None,
    typer.Option(
        "--threads",
        min=1,
        metavar="N",
        help=_sentence("n_threads"),
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
        help="Fill gaps of at most N frames. The results mark these joints as filled.",
        show_default="none",
        rich_help_panel=_TIME,
    ),
]
FillMethod = Annotated[
    str | None,
    typer.Option(
        "--fill-method",
        metavar="cubic|linear",
        help="Fill with cubic splines, or straight lines.",
        show_default="cubic",
        rich_help_panel=_TIME,
    ),
]
FillWeak = Annotated[
    bool,
    typer.Option(
        "--fill-weak",
        metavar="",
        help="Also treat weak joints as gaps.",
        rich_help_panel=_TIME,
    ),
]
Filter = Annotated[
    str | None,
    typer.Option(
        "--filter",
        metavar="FILTER",
        help="Smooth over time. butterworth[:HZ[:ORDER]] runs both ways and has no lag; "
        "one-euro[:HZ[:BETA]] is causal, BETA in Hz per mm/s. Weak joints stay as they are and do not affect "
        "others. Requires --fps.",
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
        help="Pose files: csv, trc, c3d, json, nc. pose.npz is always written; nc is for xarray and "
        "movement.",
        rich_help_panel=_OUTPUT,
    ),
]
Fps = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Frame rate, for files and filters.", rich_help_panel=_OUTPUT),
]
YUp = Annotated[
    bool,
    typer.Option(
        "--y-up",
        metavar="",
        help="Write TRC and C3D y up, for OpenSim. The world of the calibration is z up.",
        rich_help_panel=_OUTPUT,
    ),
]
NoHtml = Annotated[
    bool,
    typer.Option(
        "--no-html",
        metavar="",
        help="Do not write report.html. It takes 5 MB and more.",
        rich_help_panel=_OUTPUT,
    ),
]
MarkerNames = Annotated[
    str,
    typer.Option(
        "--marker-names",
        metavar="STYLE",
        help="Joint names in TRC and C3D files: skelsplat (right_hip), or pose2sim (RHip), for its OpenSim "
        "models.",
        rich_help_panel=_OUTPUT,
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", metavar="", help="Print only warnings and errors.", rich_help_panel=_OUTPUT
    ),
]
AsJson = Annotated[
    bool,
    typer.Option(
        "--json",
        metavar="",
        help="Print the result as JSON. Nothing else is printed on stdout.",
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


def person(value: str) -> str:
    """Return a value of ``--person`` if it has one of its forms."""
    if value in ("consistent", "largest") or value.isdecimal():
        return value
    raise typer.BadParameter(
        f"expected consistent, largest or a number, got {value!r}", param_hint="--person"
    )
