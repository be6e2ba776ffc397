"""``skelsplat convert``: from one file format to another; the kind of file is found from the input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from skelsplat.cli import options
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.output import say
from skelsplat.cli.rows import rows
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io import convert_unit, write_calibration
from skelsplat.io._files import listed
from skelsplat.io._kinds import seems
from skelsplat.io._run_files import POSES, check_run, folders_of_run
from skelsplat.io.calibration import FORMATS, WRITTEN, find_format, read_calibration
from skelsplat.io.poses import POSE_FORMATS, READ, convert_poses, is_pose_file, pose_format

_EPILOG = (
    f"Calibrations are read from {'; '.join(known.about for known in FORMATS.values())}; they are written as "
    f".toml (Anipose), .json or .npz. Poses are written as .{', .'.join(POSE_FORMATS)}, and read as "
    f".{', .'.join(READ)}."
)
_READ = frozenset({"unit", "format", "camera_type", "subject", "size", "binning"})
_MOST_NAMES = 8
# By kind of file: what OUTPUT may end in, and the options of the command that it takes.
_KINDS = {
    "pose file": (
        tuple(f".{kind}" for kind in POSE_FORMATS),
        frozenset({"fps", "to_unit", "y_up", "marker_names", "singular"}),
    ),
    "calibration": (tuple(WRITTEN), _READ | {"to_unit"}),
}

OPTIONS = (
    *rows(
        "INPUT  File or folder.\nOUTPUT  File; its suffix is the format.",
        input={"name": "source"},
        output={"name": "target"},
    ),
    *(
        replace(row, name="format", flags=("--format",)) if row.name == "calibration_format" else row
        for row in options.CALIBRATION
    ),
    *rows(
        """
        Output:
        --to-unit mm|cm|m  Length unit to write. Pose2Sim takes m, FreeMoCap mm. [that of the input; BVH cm]
        --fps HZ  Poses: frames per second.
        --y-up  Poses: write a world with z up as y up.
        --marker-names STYLE  Poses in .trc and .c3d: skelsplat, or pose2sim for RHip instead of right_hip.
        --singular  Poses in .nc: name the dimensions as movement 0.17 does.
        --force  Replace OUTPUT if it exists.
        """,
        fps=float,
    ),
)


@answers(*OPTIONS, epilog=_EPILOG)
def convert(source: Path, target: Path, *, force: bool, **given: Any) -> Answer:
    """Convert a calibration, or poses (a file, or the folder of a run), to another format.

    [bold]Examples[/bold]

    skelsplat convert Calib.qca.txt Calib.toml --to-unit m

    skelsplat convert calibration/ Calib.toml --unit m --size 1280x1024

    skelsplat convert out walk.c3d --fps 60 --y-up

    skelsplat convert out walk.glb
    """
    given = {name: value for name, value in given.items() if value is not False}
    kind = _kind(source, named="format" in given)
    suffixes, known = _KINDS[kind]
    for name in given.keys() - known:
        raise typer.BadParameter(f"does not apply to a {kind}", param_hint=f"--{name.replace('_', '-')}")
    options.check_output("OUTPUT", target, source, kind, suffixes, force=force)
    sentence, about = (_poses if kind == "pose file" else _calibration)(source, target, given)
    document = {"kind": kind, "input": str(source), "output": str(target), **about}
    return Answer(document, lambda _: say(sentence))


def _kind(source: Path, *, named: bool) -> str:
    """Return the kind of a file; only calibrations have formats that can be ``named``."""
    if not source.exists():
        raise DatasetError(source, "file", "a readable file or folder", "no such file")
    if named:
        return "calibration"
    if source.is_dir():
        check_run(source)
    if is_pose_file(source) or is_pose_file(source / POSES):
        return "pose file"
    if people := folders_of_run(source):
        got = f"a run of several ({', '.join(people)}); give that of one, for example {source / people[0]}"
        raise DatasetError(source, "folder", "one person", got)
    if find_format(source) is not None:  # an error of its own for a damaged file
        return "calibration"
    expected = "a calibration in a known format, a pose file, or the folder of a run"
    actual = seems(source) or "something else"
    raise DatasetError(source, "content", expected, f"{actual} (convert --help lists the formats)")


def _poses(source: Path, target: Path, given: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Convert poses; return a sentence about it, and values of JSON."""
    path = source / POSES if source.is_dir() else source
    try:
        data = convert_poses(path, target, unit=given.pop("to_unit", None), **given)
    except InvalidInputError as error:
        raise error.of_argument({"unit": "to_unit"}.get(error.argument, error.argument)) from error
    except DatasetError as error:
        if error.field != "frame_rate":
            raise
        raise InvalidInputError(f"fps: expected {error.expected}, got {error.actual}") from error
    frames, joints = data.pose.shape[:2]
    about = {"format": pose_format(path), "frames": frames, "joints": list(data.joint_names)}
    sentence = f"Wrote {frames} frames of {joints} joints to {target}."
    return sentence, {**about, "frame_rate_hz": data.frame_rate}


def _calibration(source: Path, target: Path, given: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Convert a calibration; return a sentence about it, and values of JSON."""
    unit = given.pop("to_unit", None)
    rig = read_calibration(source, **given)
    written = rig if unit is None else convert_unit(rig, unit)
    write_calibration(target, written)
    cameras = f"{len(rig)} camera{'s' * (len(rig) != 1)} ({listed(rig.names, _MOST_NAMES)})"
    about = {"format": given.get("format") or find_format(source), "cameras": list(rig.names)}
    sentence = f"Wrote {cameras} to {target}, lengths in {written.unit}."
    return sentence, {**about, "unit": {"input": rig.unit, "output": written.unit}}
