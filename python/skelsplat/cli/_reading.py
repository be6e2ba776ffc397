"""Options that say how detections are read, as arguments of `skelsplat.io.read_detections`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator

_OPTIONS = ("--layout", "--format", "--frames", "--offset", "--order", "--map", "--sequence", "--person")


def reading(
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
        if said and param.opts[0] in _OPTIONS:
            raise typer.BadParameter("requires DETECTIONS", param_hint=param.opts[0])


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
