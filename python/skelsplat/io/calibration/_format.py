"""What a calibration format is: how its files are opened, and into what they are parsed."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

from skelsplat._arrays import Array
from skelsplat._atomic import opening
from skelsplat._budget import check_document, parse_toml, read_text
from skelsplat._fields import Field
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import load_json

_BINARY = (".npz", ".npy", ".pickle", ".pkl", ".h5", ".mat", ".slp", ".nwb", ".nc", ".c3d", ".glb")


@dataclass(frozen=True)
class RawCamera:
    """One camera as its file gives it, lengths in the file's unit."""

    name: str
    K: Array  # (3, 3) pixels
    R: Array  # (3, 3) world → camera, to the digits of the file
    t: Array  # (3,) world → camera
    distortion: Array | None = None  # (n,) in OpenCV's order
    size: tuple[int, int] | None = None  # width and height in pixels; None if the format has no place for it
    fisheye: bool = False
    clock: float = 0.0  # frames that its count is ahead, as of `skelsplat.CameraRig`
    joint_sigma: float = 0.0  # of the whole rig, in the file's unit


Parsed: TypeAlias = tuple[Sequence[RawCamera], str | None]
"""The cameras of a file, and their unit (mm, cm or m) if format or file says it."""


@dataclass(frozen=True)
class CalibrationFormat:
    """A format: `matches` looks at a source, `parse` turns it into cameras and warns of what it assumes.

    `about` says what writes it. `options` names the arguments of `read_calibration` that it takes; any other
    that is given is refused. `parse` gets them by name, but for `size`, which is the same for all formats.
    """

    name: str
    about: str
    matches: Callable[[Source], bool]
    parse: Callable[..., Parsed]
    options: tuple[str, ...] = ()


class Source:
    """One path; its text and what the text parses to are read once, when they are first asked for.

    ``skip`` says of a camera's name whether its entry is passed over; ``skipped`` has the names of those.
    """

    def __init__(self, path: str | os.PathLike[str], skip: Callable[[str], bool] = lambda _: False) -> None:
        self.path, self._skip = Path(path), skip
        self.skipped: list[str] = []
        self.is_folder = self.path.is_dir()
        self.suffix = self.path.suffix.lower()

    def keeps(self, name: object) -> bool:
        """Whether the entry of a camera is read."""
        skips = isinstance(name, str | int) and self._skip(str(name))
        self.skipped += [str(name)] if skips else []
        return not skips

    @cached_property
    def files(self) -> list[Path]:
        """The files of a folder by name, hidden ones left out; empty for a file."""
        if not self.is_folder:
            return []
        with opening(self.path, "a readable folder", "folder"):
            return sorted(p for p in self.path.iterdir() if p.is_file() and not p.name.startswith("."))

    @cached_property
    def text(self) -> str:
        """The file as text; empty for a folder and for files that are binary by their suffix."""
        return "" if self.is_folder or self.suffix in _BINARY else read_text(self.path)

    @cached_property
    def start(self) -> str:
        """The first 4096 characters without leading blanks."""
        return self.text.lstrip()[:4096]

    @cached_property
    def json(self) -> Field:
        """The JSON object; None as its value if the text does not begin like one."""
        begins = self.start.startswith("{") and self.suffix != ".toml"
        return Field(self.path, "", load_json(self.path, "a calibration", self.text) if begins else None)

    @cached_property
    def xml(self) -> ET.Element | None:
        """The root of the XML document; None if the text does not begin like one."""
        if not self.start.startswith("<"):
            return None
        check_document(self.path, self.text)
        if "<!DOCTYPE" in self.text:  # an entity can stand for gigabytes
            raise DatasetError(self.path, "XML", "a document without a DOCTYPE", "one with it")
        try:
            return ET.fromstring(self.text)
        except ET.ParseError as error:
            raise DatasetError(self.path, "XML", "a well-formed XML document", str(error)) from error

    @cached_property
    def toml(self) -> Field:
        """The TOML document, or `DatasetError`."""
        return Field(self.path, "", parse_toml(self.path, self.text))
