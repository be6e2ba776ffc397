"""How detections are read: the checks of ``--format``, ``--offset``, ``--order`` and ``--map``."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import typer

import skelsplat as sk
from skelsplat.cli._calibration import usage
from skelsplat.io.detections import (
    FORMATS,
    DetectionSet,
    camera_called,
    cameras_called,
    read_detections,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

_OPTIONS = {
    "layout": "--layout",
    "format": "--format",
    "frames": "--frames",
    "offsets": "--offset",
    "order": "--order",
    "mapping": "--map",
    "sequence": "--sequence",
    "without": "--without",
}


def read_found(path: Path, rig: sk.CameraRig, **given: Any) -> DetectionSet:
    """Read detections; ``given`` are the arguments of `skelsplat.io.read_detections`.

    Raises
    ------
    typer.BadParameter
        If an option is missing or does not fit the files.
    DatasetError
        If a file is missing or malformed.
    """
    try:
        return read_detections(path, rig, **given)
    except sk.InvalidInputError as error:
        raise usage(error, _OPTIONS) from error


def leave_out(rig: sk.CameraRig, without: tuple[str, ...]) -> sk.CameraRig:
    """Return the rig without the cameras that are meant, whose names may be written loosely.

    Raises
    ------
    typer.BadParameter
        If there is no camera of such a name, or fewer than two are left.
    """
    try:
        left_out = cameras_called(without, rig.names, "without")
    except sk.InvalidInputError as error:
        raise usage(error, _OPTIONS) from error
    kept = [camera for name, camera in zip(rig.names, rig, strict=True) if name not in left_out]
    if len(kept) < 2:
        expected = f"two cameras or more to be left of {', '.join(rig.names)}"
        raise typer.BadParameter(f"expected {expected}, got {len(kept)}", param_hint="--without")
    return sk.CameraRig(kept, unit=rig.unit) if without else rig


def named_offsets(rig: sk.CameraRig, offsets: Mapping[str, int]) -> dict[str, int]:
    """Return offsets that were read with, by the calibration's own names."""
    return {camera_called(text, rig.names): frames for text, frames in offsets.items()}


def reading(
    name: str | None, offset: list[str] | None, order: str | None, joint_map: list[str] | None
) -> dict[str, Any]:
    """Return the arguments ``format``, ``offsets``, ``order`` and ``mapping`` of `read_found`.

    Raises
    ------
    typer.BadParameter
        If the format is unknown or a value does not have the form of its option.
    """
    if name is not None and name.lower() not in FORMATS:
        raise typer.BadParameter(f"expected one of {', '.join(FORMATS)}, got {name!r}", param_hint="--format")
    return {
        "format": None if name is None else name.lower(),
        "offsets": {camera: _frames(text) for camera, text in _pairs("--offset", offset)},
        "order": order if order in (None, "sorted") else tuple(part.strip() for part in order.split(",")),
        "mapping": {joint: _place(text) for joint, text in _pairs("--map", joint_map)},
    }


def refuse_reading(context: typer.Context) -> None:
    """Refuse options on the command line that say how detections are read, where there are none.

    Those in a file of options may be meant for another command.

    Raises
    ------
    typer.BadParameter
        If there is one.
    """
    for param in context.command.params:
        said = getattr(context.get_parameter_source(str(param.name)), "name", "") == "COMMANDLINE"
        if said and param.opts[0] in _OPTIONS.values() and param.opts[0] != "--without":
            raise typer.BadParameter("expected DETECTIONS beside it, got none", param_hint=param.opts[0])


def _pairs(option: str, values: list[str] | None) -> Iterator[tuple[str, str]]:
    """Yield the two sides of each ``A=B``; no A comes twice."""
    seen = set()
    for value in values or []:
        left, equals, right = (part.strip() for part in value.rpartition("="))
        if not (left and equals and right) or left in seen:
            raise typer.BadParameter(f"expected A=B, each A once, got {value!r}", param_hint=option)
        seen.add(left)
        yield left, right


def _frames(text: str) -> int:
    if not re.fullmatch(r"[+-]?\d+", text):
        expected = "a whole number of frames, like cam2=3 or cam2=-1"
        raise typer.BadParameter(f"expected {expected}, got {text!r}", param_hint="--offset")
    return int(text)


def _place(text: str) -> str | int | None:
    """Return what ``--map`` says of a joint: a place, nothing, or a name."""
    return int(text) if text.isdecimal() else None if text == "none" else text
