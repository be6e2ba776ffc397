"""``skelsplat convert`` for calibrations: any format that is read, to TOML, JSON or npz."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

import skelsplat as sk
from skelsplat.cli._calibration import CalibrationOptions, listed
from skelsplat.cli._conversion import Kind, Request, Written
from skelsplat.io import convert_unit, write_calibration
from skelsplat.io.calibration import find_format

if TYPE_CHECKING:
    from pathlib import Path

_READ = frozenset({"unit", "format", "camera_type", "subject", "size", "binning"})


def _recognises(path: Path) -> bool:
    try:
        return find_format(path) is not None
    except sk.DatasetError:
        return False


def _convert(request: Request) -> Written:
    options = dict(request.options)
    unit = options.pop("to_unit", None)
    if unit not in (None, "mm", "cm", "m"):
        raise typer.BadParameter(f"expected mm, cm or m, got {unit!r}", param_hint="--to-unit")
    given = CalibrationOptions(**options)
    rig = given.read(request.source)
    if request.target.resolve() == request.source.resolve():
        raise sk.DatasetError(request.target, "target", "another file than the source", "the same")
    written = rig if unit is None else convert_unit(rig, unit)
    write_calibration(request.target, written)
    cameras = f"{len(rig)} camera{'s' * (len(rig) != 1)} ({listed(rig.names)})"
    sentence = f"Wrote {cameras} to {request.target}, lengths in {written.unit}."
    about = {"format": given.format_of(request.source), "cameras": list(rig.names)}
    return Written(sentence, {**about, "unit": {"input": rig.unit, "output": written.unit}})


CALIBRATION = Kind(
    "calibration", _recognises, _convert, (".toml", ".json", ".npz"), _READ | frozenset({"to_unit"})
)
