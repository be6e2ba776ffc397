"""The options that commands share, in tables, and how their texts become values of the package."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import typer

from skelsplat import RefineConfig, layouts
from skelsplat.cli.rows import NAME_OR_PATH, Option, choice, positive, rows
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Remedy
from skelsplat.io.calibration import FORMATS as CALIBRATION_FORMATS
from skelsplat.io.detections import FORMATS
from skelsplat.io.detections._frames import FRAME_MODES
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.job import Job


def some_of(choices: tuple[str, ...], option: str, value: str) -> tuple[str, ...]:
    """Return the names in a list with commas, each once and each one of ``choices``."""
    names = tuple(dict.fromkeys(name.strip().lower().removeprefix(".") for name in value.split(",")))
    for name in (one for one in names if one not in choices):
        raise typer.BadParameter(f"expected some of {', '.join(choices)}, got {name!r}", param_hint=option)
    return names


def all_or_number(option: str, value: str) -> str | int:
    """Return ``"all"``, or how many people to follow."""
    if value.lower() == "all":
        return "all"
    if value.isdecimal() and int(value) > 0:
        return int(value)
    raise typer.BadParameter(f"expected all or a number of at least 1, got {value!r}", param_hint=option)


def width_and_height(option: str, text: str) -> tuple[int, int]:
    """Return the numbers of ``1920x1080``."""
    found = re.fullmatch(r"(\d+)[x×](\d+)", text.strip())
    if found is None or not (int(found[1]) and int(found[2])):
        raise typer.BadParameter(f"expected a size such as 1920x1080, got {text!r}", param_hint=option)
    return int(found[1]), int(found[2])


def _pairs(option: str, values: list[str]) -> Iterator[tuple[str, str]]:
    """Yield the two sides of each ``A=B``; no A comes twice."""
    seen = set()
    for value in values:
        left, equals, right = (part.strip() for part in value.rpartition("="))
        if not (left and equals and right) or left in seen:
            raise typer.BadParameter(f"expected A=B, each A once, got {value!r}", param_hint=option)
        seen.add(left)
        yield left, right


def _offsets(option: str, values: list[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for camera, text in _pairs(option, values):
        if not re.fullmatch(r"[+-]?\d+(\.\d+)?", text):
            raise typer.BadParameter(f"expected frames, like cam2=-1.25, got {text!r}", param_hint=option)
        found[camera] = float(text) if "." in text else int(text)
    return found


def _rates(option: str, text: str) -> float | dict[str, float]:
    """Return a frame rate, or that of each camera."""
    try:
        if "=" not in text:
            return positive(option, float(text))
        return {name: positive(option, float(rate)) for name, rate in _pairs(option, text.split(","))}
    except ValueError as error:
        expected = "rates, like cam1=30,cam2=59.94," if "=" in text else "a number,"
        raise typer.BadParameter(f"expected {expected} got {text!r}", param_hint=option) from error


def _mapping(option: str, values: list[str]) -> dict[str, str | int | None]:
    """Return what each joint is in the files: an index, None, or a name."""
    return {
        joint: int(text) if text.isdecimal() else None if text == "none" else text
        for joint, text in _pairs(option, values)
    }


def distinct(_option: str, names: list[str]) -> tuple[str, ...]:
    """Return names of cameras, each once."""
    return tuple(dict.fromkeys(names))


def order(_option: str, text: str) -> str | tuple[str, ...]:
    """Return the source of each camera, or ``"sorted"``."""
    return text if text == "sorted" else tuple(part.strip() for part in text.split(","))


_METHODS = tuple(
    {setting.name: setting for setting in RefineConfig.settings(method)} for method in ("annealed", "paper")
)


def _worded(row: Option, methods: Any = _METHODS) -> Option:
    """Return an option without a help with that of the setting of its name, in the core's words."""
    if row.help or not row.metavar:
        return row
    settings = [table[row.name] for table in methods if row.name in table]
    sentences = [
        re.sub(r"`(\w+)`", lambda found: "--" + found[1].replace("_", "-"), setting.sentence)
        for setting in settings
    ]
    texts = [text.partition("; None:")[0].rstrip(".") + "." for text in dict.fromkeys(sentences)]
    words = " With --paper: ".join([texts[0], *(text[0].lower() + text[1:] for text in texts[1:])])
    usual = [] if row.shown else dict.fromkeys(f"{setting.default:.4g}" for setting in settings)
    return replace(row, help=words, shown=row.shown or ", with --paper ".join(usual))


JOB = rows(
    f"""
    CALIBRATION  Calibration file or its folder. convert --help lists the formats.
    DETECTIONS  Folder or file of 2D detections. A folder has one folder or file per camera, named like the
        camera.
    Calibration:
    * --unit mm|cm|m  Length unit of the calibration. Needed if the format does not state it: Anipose TOML,
        OpenCV YAML, 4D association.
    --calibration-format NAME  Format of the calibration: {", ".join(sorted(CALIBRATION_FORMATS))}.
        [found from the content]
    --camera-type TYPE  Which cameras of the file: hd, vga, … (Panoptic), video cameras (Qualisys, Vicon), or
        all.
    --subject S1  Human3.6M: the subject with these cameras.
    --size WxH  Image size, if the files do not state it, as those of OpenPose, VoxelPose, DANNCE, matrices.
    --binning N  Qualisys: sensor pixels per pixel of the video.
    Input:
    * --layout NAME  Joint layout, such as body25b. A name (skelsplat layouts lists them), a layout file
        (.toml), or file: the joints as the detections name them. [found from the joint names in the files]
    * --person WHO  Person to follow. consistent: whom the views agree on. Or one of all, followed over time:
        N, from 0 in the order of appearance; largest; moves-most; CAMERA:X,Y, whoever is at that pixel when
        the camera first sees a person. entry:N: entry N of each file, from 0, not always the same person;
        nor is largest if the frame rate is unknown. [= consistent]
    * --people all|N  Refine several people. Each has a folder, person_0, person_1, …: all of them, or the N
        whom the views see most. The frame rate must be known. [one person]
    --frames MODE  What to do if cameras have different frames. strict: stop (except for formats that list
        only people: alphapose, coco, csv); intersection: keep the common frames; union: keep all. [= strict]
    --format NAME  Format of the detections: {", ".join(FORMATS)}. [found from the files]
    * --offset CAMERA=FRAMES  Frames to add to a camera's numbers. 3 if it started 3 frames late; also 3.4.
        Repeatable.
    --order A,B,…  Folder, file or index in the file of each camera, in the calibration's order; or sorted.
        [by name]
    * --without CAMERA  Leave a camera out, which need not have detections. Repeatable.
    --map JOINT=NAME  What a joint of the layout is in the files: a name, an index from 0, or none.
        Repeatable.
    --sequence NAME  Sequence of a file that has several, such as "S9/Directions 1".
    --init POSE.npz  Pose file to start from. [triangulation]
    --init-sigma-mm MM  Standard deviation of --init per axis, in mm. With it, an --init that is independent
        of the detections (monocular, body model) counts as an observation. Not with --paper.
    --min-confidence C
    --no-undistort  Ignore lens distortion.
    --adjust-cameras  First adjust the cameras that were turned or moved since the calibration. Everybody the
        views agree on shows which; cameras.json has them. skelsplat adjust-cameras writes a calibration.
    --move CAMERA  A camera that was moved. Only these are adjusted, instead of those found to be wrong.
        Requires --adjust-cameras. Repeatable.
    Method:
    * --paper  Use the published method. It renders pixels and optimises with Adam; the default, annealed, is
        more robust.
    --no-swaps  Do not correct left–right swaps.
    --free-bones  Do not use the proportions of people for joints that few views see.
    --sigma-mm MM
    --occlusion-sigma-mm MM  [as --sigma-mm]
    --joint-bias-mm MM  [by the layout]
    --symmetry-tier 0..3
    --max-steps N
    --threads 1..1024  [all cores]
    Over time:
    * --fps HZ|CAMERA=HZ  Frame rate, for all or by camera. Where they differ: cam1=30,cam2=60. If it is
        known, the recording is solved over time: bones keep their length and joints move smoothly. [as files
        or videos state it]
    --frame-by-frame  Solve each frame alone, even if the frame rate is known. --paper always does.
    * --fill-gaps N  Fill gaps of at most N frames. The results mark these joints as filled. [none]
    --fill-weak  Also treat weak joints as gaps.
    * --filter FILTER  Smooth over time: butterworth[:HZ[:ORDER]], both ways, so without lag. Weak joints stay
        as they are and do not affect others. Requires --fps. [none]
    Output:
    * -o, --output FOLDER  Folder for the results. [required]
    * --write FORMATS  Pose files. Some of {", ".join(POSE_FORMATS)}: nc for xarray and movement, bvh and glb
        for animation, npy for FreeMoCap. pose.npz is always written. [= csv,trc]
    * --y-up  Write TRC and C3D with y up. OpenSim expects it; the calibration must have z up. BVH and glTF
        have it anyway.
    --marker-names STYLE  Joint names in TRC and C3D files: skelsplat (right_hip), or pose2sim (RHip), for
        its OpenSim models. [= skelsplat]
    * --angles  Write joint angles. angles.csv and .npz have error bars, .mot is for OpenSim; and strides.csv.
    --opensim  Write opensim/ for inverse kinematics: markers, their weights, and kinematics.py, which
        runs OpenSim.
    --no-html  Do not write report.html. It takes 5 MB or more.
    """,
    size=width_and_height,
    binning={"kind": float, "limits": {}},
    layout={"marks": (NAME_OR_PATH,), "offers": layouts.names},
    person={"offers": ("consistent", "largest", "moves-most", "0", "1", "2")},
    people={"read": all_or_number, "offers": ("all", "2", "3", "4")},
    frames={"read": choice(*FRAME_MODES), "offers": FRAME_MODES},
    format=lambda _option, value: value.lower(),
    offset={"name": "offsets", "many": True, "read": _offsets},
    order=order,
    without={"many": True, "read": distinct},
    move={"many": True, "read": distinct},
    map={"name": "mapping", "many": True, "read": _mapping},
    min_confidence={"kind": float, "limits": {"min": 0, "max": 1}},
    joint_bias_mm={"kind": float, "limits": {"min": 0}},
    symmetry_tier={"kind": int, "limits": {"min": 0, "max": 3}},
    max_steps={"kind": int, "limits": {"min": 0}},
    threads={"name": "n_threads", "kind": int, "limits": {"min": 1}},
    fps={"kind": str, "read": _rates},
    write={
        "read": partial(some_of, tuple(POSE_FORMATS)),
        "offers": tuple(kind for kind in POSE_FORMATS if kind != "npz"),
    },
)
_BY_NAME = {row.name: row for row in JOB}
JOB = tuple(map(_worded, JOB))
"""The options of a job, by the names of the fields of `skelsplat.run.Job` and of its settings."""


def of_job(*names: str) -> tuple[Option, ...]:
    """Return some of `JOB`, by their names."""
    return tuple(_worded(_BY_NAME[name]) for name in names)


def option_of(remedy: Remedy) -> Option | None:
    """Return the option of refine that a remedy sets; None if it is one of another command."""
    flag = f"--{remedy.setting.replace('_', '-')}"
    return next((row for row in JOB if row.flag == flag), None)


CALIBRATION = tuple(row for row in JOB if row.panel == "Calibration")
_OF_CAMERAS = "Frame rate, which calibrate --clock needs; by camera where they differ: cam1=30,cam2=60."
_JUDGED_BY = """
    Input:
    * --person WHO  By whom the cameras are judged. everybody: all on whom three views agree; consistent: only
        the person on whom they agree best; largest: the largest in each image; entry:N: entry N of
        each file, from 0. [= everybody]
    """
RECORDING = (
    *of_job("layout"),
    *rows(_JUDGED_BY),
    replace(_BY_NAME["frames"], default="union"),
    *of_job("format", "offsets", "order", "without", "mapping", "sequence"),
    replace(_BY_NAME["fps"], panel="Input", common=False, help=_OF_CAMERAS),
)
"""The options of check-cameras and adjust-cameras for reading detections."""
RECORDINGS = rows(
    """
    DETECTIONS  Folder or file of detections, as for refine; of several recordings with the same cameras,
        one after the other.
    """,
    detections={"many": True},
)
"""The argument of adjust-cameras and calibrate."""
OF_LIVE = (
    *of_job("min_confidence", "no_undistort", "no_swaps", "free_bones"),
    _worded(_BY_NAME["sigma_mm"], _METHODS[:1]),
    *of_job("joint_bias_mm"),
)
"""The settings of `skelsplat live`."""


def frame_range(_option: str, text: str) -> FrameRange:
    """Return the frames that ``--range`` names."""
    return FrameRange.parse(text)


def check_output(
    option: str, output: Path, source: Path, kind: str, suffixes: Collection[str], *, force: bool
) -> None:
    """Refuse an output with a wrong suffix, one that is the input, or, without ``force``, one that exists."""
    if output.suffix.lower() not in suffixes:
        expected, got = f"a {kind} to be written as {', '.join(suffixes)}", output.suffix or "no suffix"
        raise typer.BadParameter(f"expected {expected}, got {got!r}", param_hint=option)
    field = option.removeprefix("--")
    if output.resolve() == source.resolve():
        raise DatasetError(output, field, "another file than the input", "the same")
    if not output.absolute().parent.is_dir():
        raise DatasetError(output, field, "a file in a folder that exists", "no such folder")
    if output.exists() and not force:
        raise DatasetError(output, field, "no file of this name (--force replaces it)", "one that exists")


def job_of(**given: Any) -> Job:
    """Return the job of these options and arguments."""
    own = {one.name for one in fields(Job)}
    settings = {name: value for name, value in given.items() if name not in own}
    return Job(config=config_of(**settings), **{name: given[name] for name in given if name in own})


def reading(given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `skelsplat.run.check_cameras` and `adjust_cameras`, from those by name."""
    of_calibration = {row.name: given.pop(row.name) for row in CALIBRATION if row.name in given}
    return {"read": of_calibration, **given}


def config_of(*, paper: bool = False, free_bones: bool = False, **settings: Any) -> RefineConfig:
    """Return the settings of the method, of which the published one has no swaps and no bones."""
    swaps = settings.pop("swaps", True)
    if paper:
        return RefineConfig.paper(**settings)
    return RefineConfig(find_swaps=swaps, **({"bones": "free"} if free_bones else {}), **settings)
