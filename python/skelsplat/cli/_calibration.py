"""The options with which commands read a calibration of any format."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import skelsplat as sk
from skelsplat.io.calibration import FORMATS, find_format, read_calibration

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

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
    typer.Option(
        metavar="mm|cm|m",
        help="Length unit of the calibration. Needed if the format does not state it: Anipose TOML, OpenCV "
        "YAML.",
        rich_help_panel=_PANEL,
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Format of the calibration: {', '.join(sorted(FORMATS))}.",
        show_default="found from the content",
        rich_help_panel=_PANEL,
    ),
]
CameraType = Annotated[
    str | None,
    typer.Option(
        metavar="TYPE",
        help="Which cameras of the file: hd, vga, … (Panoptic), video cameras (Qualisys, Vicon), or all.",
        rich_help_panel=_PANEL,
    ),
]
Subject = Annotated[
    str | None,
    typer.Option(metavar="S1", help="Human3.6M: the subject with these cameras.", rich_help_panel=_PANEL),
]
Size = Annotated[
    str | None,
    typer.Option(
        metavar="WxH",
        help="Image size, if the files do not state it: OpenPose, some OpenCV YAML.",
        rich_help_panel=_PANEL,
    ),
]
Binning = Annotated[
    float | None,
    typer.Option(metavar="N", help="Qualisys: sensor pixels per pixel of the video.", rich_help_panel=_PANEL),
]


@dataclass(frozen=True)
class CalibrationOptions:
    """What the user said about a calibration; None: nothing."""

    unit: str | None = None
    format: str | None = None
    camera_type: str | None = None
    subject: str | None = None
    size: str | None = None
    binning: float | None = None

    def read(self, path: Path, *, format_option: str = "--format") -> sk.CameraRig:
        """Read a rig; ``format_option`` is what the command calls the option that names the format.

        Raises
        ------
        typer.BadParameter
            If an option is missing, unknown or does not go with the format.
        DatasetError
            If the file is missing or malformed.
        """
        with_size: Any = None if self.size is None else _width_and_height(self.size)
        try:
            return read_calibration(
                path,
                unit=self.unit,
                format=self.format,
                camera_type=self.camera_type,
                subject=self.subject,
                size=with_size,
                binning=self.binning,
            )
        except sk.InvalidInputError as error:
            options = {field.name: "--" + field.name.replace("_", "-") for field in fields(self)}
            raise usage(error, {**options, "format": format_option}) from error

    def format_of(self, path: Path) -> str | None:
        """Return the name of the format: what the user said, or what the content says."""
        return self.format or find_format(path)


def usage(error: sk.InvalidInputError, options: Mapping[str, str]) -> Exception:
    """Return an error of usage that names the option, if the error is of an argument that is one.

    ``options`` are the options by argument of the reader.
    """
    name, _, message = str(error).partition(": ")
    return typer.BadParameter(message, param_hint=options[name]) if name in options else error


def _width_and_height(text: str) -> tuple[int, int]:
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
