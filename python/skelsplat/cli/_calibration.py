"""The options with which commands read a calibration of any format."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import skelsplat as sk
from skelsplat.cli import options
from skelsplat.io.calibration import FORMATS
from skelsplat.run.read import read_rig

if TYPE_CHECKING:
    from collections.abc import Iterator

_PANEL = "Calibration"

Calibration = Annotated[
    Path,
    typer.Argument(
        readable=False,
        metavar="CALIBRATION",
        help="Calibration file or folder. convert --help lists the formats.",
    ),
]

Unit = Annotated[
    str | None,
    options.option(
        _PANEL,
        metavar="mm|cm|m",
        help="Length unit of the calibration. Needed if the format does not state it: Anipose TOML, OpenCV "
        "YAML.",
    ),
]
Format = Annotated[
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
        _PANEL, metavar="WxH", help="Image size, if the files do not state it: OpenPose, some OpenCV YAML."
    ),
]
Binning = Annotated[
    float | None, options.option(_PANEL, metavar="N", help="Qualisys: sensor pixels per pixel of the video.")
]


@dataclass(frozen=True)
class CalibrationOptions:
    """What the user said about a calibration; None: nothing."""

    unit: str | None = None
    calibration_format: str | None = None
    camera_type: str | None = None
    subject: str | None = None
    size: str | None = None
    binning: float | None = None

    def read(self, path: Path) -> sk.CameraRig:
        """Read a rig; an error of the format calls it ``calibration_format``, as commands do."""
        return read_rig(path, **self.given())

    def given(self) -> dict[str, Any]:
        """Return the arguments of `skelsplat.run.read.read_rig`, and fields of `skelsplat.run.Job`."""
        return {**asdict(self), "size": None if self.size is None else width_and_height(self.size)}


def width_and_height(text: str) -> tuple[int, int]:
    """Return what ``--size`` says, or raise `typer.BadParameter`."""
    found = re.fullmatch(r"(\d+)[x×](\d+)", text.strip())
    if found is None or not (int(found[1]) and int(found[2])):
        raise typer.BadParameter(
            f"expected a width and a height such as 1920x1080, got {text!r}", param_hint="--size"
        )
    return int(found[1]), int(found[2])


def listed(names: Iterator[str] | tuple[str, ...], most: int = 8) -> str:
    """Return names as a phrase, a long list cut short."""
    every = list(names)
    rest = len(every) - most
    return ", ".join(every) if rest <= 0 else f"{', '.join(every[:most])} and {rest} more"
