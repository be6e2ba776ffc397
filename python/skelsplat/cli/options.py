"""The options that commands share, with their help, and checks of their values.

Each option is the annotated type of a parameter.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from skelsplat import RefineConfig
from skelsplat.cli.config import NAME_OR_PATH
from skelsplat.io.detections import FORMATS

_INPUT, _METHOD, _TIME, _OUTPUT = "Input", "Method", "Over time", "Output"


def option(panel: str, *names: str, metavar: str, help: str, default: str | None = None, **more: Any) -> Any:
    """Return typer's option, in a panel of the help; ``default`` is shown in place of None."""
    more |= {} if default is None else {"show_default": default}
    return typer.Option(*names, metavar=metavar, help=help, rich_help_panel=panel, **more)


def flag(panel: str, *names: str, help: str) -> Any:
    """Return typer's option of a flag, in a panel of the help."""
    return typer.Option(*names, metavar="", help=help, rich_help_panel=panel)


_METHODS = tuple(
    {setting.name: setting for setting in RefineConfig.settings(method)} for method in ("annealed", "paper")
)


def _sentence(name: str, *tables: Mapping[str, Any]) -> str:
    """Return what a setting does, in the core's words, with options instead of settings."""
    sentences = [
        re.sub(r"`(\w+)`", lambda found: "--" + found[1].replace("_", "-"), table[name].sentence)
        for table in tables
        if name in table
    ]
    both = [text.partition("; None:")[0].rstrip(".") + "." for text in dict.fromkeys(sentences)]
    return " With --paper: ".join([both[0], *(text[0].lower() + text[1:] for text in both[1:])])


def _setting(
    panel: str, name: str, *tables: Mapping[str, Any], metavar: str, default: str | None = None, **more: Any
) -> Any:
    """Return typer's option of a setting, with what the methods' ``tables`` say of it."""
    texts = [] if default else [f"{table[name].default:.4g}" for table in tables if name in table]
    shown = default or ", with --paper ".join(dict.fromkeys(texts))
    return option(panel, metavar=metavar, help=_sentence(name, *tables), default=shown, **more)


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
    option(
        _INPUT,
        metavar="NAME",
        help="Joint layout, such as body25b. A name (skelsplat layouts lists them), a layout file (.toml), "
        "or file: the joints as the detections name them.",
        default="found from the joint names in the files",
    ),
    NAME_OR_PATH,
]
RequiredLayout = Annotated[
    str | None,
    option(
        _INPUT,
        "--layout",
        metavar="NAME",
        help="Joint layout of the detections: a name (skelsplat layouts lists them) or a layout file "
        "(.toml). Required.",
    ),
    NAME_OR_PATH,
]
Format = Annotated[
    str | None,
    option(
        _INPUT,
        metavar="NAME",
        help=f"Format of the detections: {', '.join(FORMATS)}.",
        default="found from the files",
    ),
]
Offset = Annotated[
    list[str] | None,
    option(
        _INPUT,
        metavar="CAMERA=FRAMES",
        help="Frames to add to a camera's numbers. 3 if it started 3 frames late; also 3.4. Repeatable.",
    ),
]
Order = Annotated[
    str | None,
    option(
        _INPUT,
        metavar="A,B,…",
        help="Folder, file or index in the file of each camera, in the calibration's order; or sorted.",
        default="by name",
    ),
]
Without = Annotated[
    list[str] | None,
    option(
        _INPUT, metavar="CAMERA", help="Leave a camera out. Repeatable; the camera need not have detections."
    ),
]
JointMap = Annotated[
    list[str] | None,
    option(
        _INPUT,
        "--map",
        metavar="JOINT=NAME",
        help="What a joint of the layout is in the files: a name, an index from 0, or none. Repeatable.",
    ),
]
Sequence = Annotated[
    str | None,
    option(_INPUT, metavar="NAME", help='Sequence of a file that has several, such as "S9/Directions 1".'),
]
Person = Annotated[
    str,
    option(
        _INPUT,
        metavar="WHO",
        help="Person to follow. consistent: the person the views agree on. The others are followed over time "
        "as by --people, and one is chosen: N, the identity, from 0 in the order of appearance; largest; "
        "moves-most; CAMERA:X,Y, whoever is at that pixel when the camera first sees somebody. If the frame "
        "rate is unknown, N is entry N of each file, and largest the largest in each image: not always the "
        "same person.",
    ),
]
People = Annotated[
    str | None,
    option(
        _INPUT,
        metavar="all|N",
        help="Refine several people. Each has a folder, person_0, person_1, …: all of them, or the N whom "
        "the views see most. The frame rate must be known.",
        default="one person",
    ),
]
Entry = Annotated[
    str,
    option(
        _INPUT,
        metavar="WHO",
        help="By whom the cameras are judged. everybody: all on whom three views agree; consistent: only the "
        "person on whom they agree best; largest: the largest in each image; N: entry N of each file, "
        "from 0.",
    ),
]
Frames = Annotated[
    str,
    option(
        _INPUT,
        metavar="MODE",
        help="What to do if cameras have different frames. strict: stop (except for formats that list only "
        "people: alphapose, coco, csv); intersection: keep the common frames; union: keep all.",
    ),
]
Init = Annotated[
    Path | None,
    option(
        _INPUT, metavar="POSE.npz", help="Pose file to start from.", default="triangulation", readable=False
    ),
]
InitSigma = Annotated[
    float | None,
    option(
        _INPUT,
        metavar="MM",
        help="Standard deviation of --init per axis, in mm. With it, an --init that is independent of the "
        "detections (monocular, body model) counts as an observation. Not with --paper.",
    ),
]
MinConfidence = Annotated[
    float | None, _setting(_INPUT, "min_confidence", *_METHODS, metavar="C", min=0, max=1)
]
AdjustCameras = Annotated[
    bool,
    flag(
        _INPUT,
        "--adjust-cameras",
        help="First adjust the cameras that were turned or moved since the calibration. Everybody the views "
        "agree on shows which; cameras.json has them. skelsplat adjust-cameras writes a calibration.",
    ),
]
NoUndistort = Annotated[bool, flag(_INPUT, "--no-undistort", help="Ignore lens distortion.")]

Paper = Annotated[
    bool,
    flag(
        _METHOD,
        "--paper",
        help="Use the published method. It renders pixels and optimises with Adam; the default, "
        "annealed, is more robust.",
    ),
]
FreeBones = Annotated[
    bool,
    flag(_METHOD, "--free-bones", help="Do not use the proportions of people for joints that few views see."),
]
NoSwaps = Annotated[bool, flag(_METHOD, "--no-swaps", help="Do not correct left–right swaps.")]
Sigma = Annotated[float | None, _setting(_METHOD, "sigma_mm", *_METHODS, metavar="MM")]
SigmaOfAnnealed = Annotated[float | None, _setting(_METHOD, "sigma_mm", _METHODS[0], metavar="MM")]
OcclusionSigma = Annotated[
    float | None, _setting(_METHOD, "occlusion_sigma_mm", *_METHODS, metavar="MM", default="as --sigma-mm")
]
JointBias = Annotated[
    float | None, _setting(_METHOD, "joint_bias_mm", *_METHODS, metavar="MM", min=0, default="by the layout")
]
SymmetryTier = Annotated[
    int | None, _setting(_METHOD, "symmetry_tier", *_METHODS, metavar="0..3", min=0, max=3)
]
MaxSteps = Annotated[int | None, _setting(_METHOD, "max_steps", *_METHODS, metavar="N", min=0)]
Threads = Annotated[
    int | None,
    option(
        _METHOD,
        "--threads",
        metavar="1..1024",
        help=_sentence("n_threads", *_METHODS),
        default="all cores",
        min=1,
    ),
]

FillGaps = Annotated[
    int | None,
    option(
        _TIME,
        "--fill-gaps",
        metavar="N",
        help="Fill gaps of at most N frames. The results mark these joints as filled.",
        default="none",
        min=1,
    ),
]
FillMethod = Annotated[
    str | None,
    option(
        _TIME,
        "--fill-method",
        metavar="cubic|linear",
        help="Fill with cubic splines, or straight lines.",
        default="cubic",
    ),
]
FillWeak = Annotated[bool, flag(_TIME, "--fill-weak", help="Also treat weak joints as gaps.")]
Filter = Annotated[
    str | None,
    option(
        _TIME,
        "--filter",
        metavar="FILTER",
        help="Smooth over time. butterworth[:HZ[:ORDER]] runs both ways and has no lag; "
        "one-euro[:HZ[:BETA]] is causal, BETA in Hz per mm/s. Weak joints stay as they are and do not affect "
        "others. Requires --fps.",
        default="none",
    ),
]
LiveRate = Annotated[
    float | None,
    option(
        _TIME,
        "--fps",
        metavar="HZ",
        help="Frames per second, one line each, also where nothing is detected: the past then predicts.",
        default="every frame by itself",
    ),
]
Lag = Annotated[
    int,
    option(
        _TIME,
        "--lag",
        metavar="FRAMES",
        help="Answer so many frames later, from the frames before and after. Requires --fps.",
        min=0,
    ),
]
LivePeople = Annotated[
    str | None,
    option(
        _TIME,
        "--people",
        metavar="all|N",
        help="Follow everybody, or at most N people, and find out who is who. Requires --fps.",
        default="one person",
    ),
]
FrameByFrame = Annotated[
    bool,
    flag(
        _TIME,
        "--frame-by-frame",
        help="Solve each frame alone, even if the frame rate is known. --paper always does.",
    ),
]

Out = Annotated[Path, option(_OUTPUT, "-o", "--output", metavar="FOLDER", help="Folder for the results.")]
Write = Annotated[
    str,
    option(
        _OUTPUT,
        "--write",
        metavar="FORMATS",
        help="Pose files: csv, trc, c3d, json, nc. pose.npz is always written; nc is for xarray and "
        "movement.",
    ),
]
Fps = Annotated[
    float | None,
    option(
        _TIME,
        metavar="HZ",
        help="Frame rate. If it is known, the recording is solved over time: bones keep their length and "
        "joints move smoothly.",
        default="as files or videos state it",
    ),
]
YUp = Annotated[
    bool,
    flag(
        _OUTPUT,
        "--y-up",
        help="Write TRC and C3D with y up. OpenSim expects it; the calibration must have z up.",
    ),
]
Angles = Annotated[
    bool,
    flag(
        _OUTPUT,
        "--angles",
        help="Write joint angles. angles.csv and angles.npz have error bars, angles.mot is for OpenSim.",
    ),
]
NoHtml = Annotated[bool, flag(_OUTPUT, "--no-html", help="Do not write report.html. It takes 5 MB or more.")]
MarkerNames = Annotated[
    str,
    option(
        _OUTPUT,
        "--marker-names",
        metavar="STYLE",
        help="Joint names in TRC and C3D files: skelsplat (right_hip), or pose2sim (RHip), for its OpenSim "
        "models.",
    ),
]
Quiet = Annotated[bool, flag(_OUTPUT, "--quiet", "-q", help="Print only warnings and errors.")]
AsJson = Annotated[
    bool, flag(_OUTPUT, "--json", help="Print the result as JSON. Nothing else is printed on stdout.")
]
Range = Annotated[
    str | None,
    option(
        "Drawing",
        "--range",
        metavar="A-B",
        help="Frames to draw, by the run's frame numbers; A- and -B are open ranges; A is one frame.",
        default="all",
    ),
]


def one_of(option: str, value: str | None, choices: tuple[str, ...]) -> str:
    """Return ``value`` if it is one of ``choices``; None: a required option is missing."""
    if value in choices:
        return value
    got = "nothing (the files do not state it)" if value is None else repr(value)
    raise typer.BadParameter(f"expected one of {', '.join(choices)}, got {got}", param_hint=option)


def positive(option: str, value: float | None) -> float | None:
    """Return ``value`` if it is positive and finite, or None."""
    if value is None or 0 < value < float("inf"):
        return value
    raise typer.BadParameter(f"expected a positive number, got {value:g}", param_hint=option)


def number_of_people(option: str, value: str) -> int | None:
    """Return how many people to follow at most: None for all."""
    if value.lower() == "all":
        return None
    if value.isdecimal() and int(value) > 0:
        return int(value)
    raise typer.BadParameter(f"expected all or a number of at least 1, got {value!r}", param_hint=option)


def some_of(option: str, value: str, choices: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names in a list with commas, each once and each one of ``choices``."""
    names = tuple(dict.fromkeys(name.strip().lower().removeprefix(".") for name in value.split(",")))
    for name in names:
        if name not in choices:
            expected = f"some of {', '.join(choices)}"
            raise typer.BadParameter(f"expected {expected}, got {name!r}", param_hint=option)
    return names
