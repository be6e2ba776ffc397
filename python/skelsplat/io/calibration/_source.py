"""A file or folder that may hold a calibration, opened as far as a format needs it."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import parse_json, parse_toml, read_text

if TYPE_CHECKING:
    import os

_BINARY = (".npz", ".npy", ".pickle", ".pkl", ".h5", ".mat")


class Source:
    """One path; its text and what the text parses to are read once, when they are first asked for.

    Attributes
    ----------
    path : Path
    is_folder : bool
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.is_folder = self.path.is_dir()

    @property
    def suffix(self) -> str:
        """The last suffix in lower case, such as ``".json"``."""
        return self.path.suffix.lower()

    @cached_property
    def files(self) -> list[Path]:
        """The files of a folder by name, hidden ones left out; empty for a file."""
        if not self.is_folder:
            return []
        try:
            return sorted(p for p in self.path.iterdir() if p.is_file() and not p.name.startswith("."))
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise DatasetError(self.path, "folder", "a readable folder", reason) from error

    @cached_property
    def text(self) -> str:
        """The file as text; empty for a folder and for files that are binary by their suffix."""
        return "" if self.is_folder or self.suffix in _BINARY else read_text(self.path)

    @cached_property
    def start(self) -> str:
        """The first 4096 characters without leading blanks."""
        return self.text.lstrip()[:4096]

    @cached_property
    def json(self) -> Any:
        """The JSON document; None if the text does not begin like one."""
        if not self.start.startswith(("{", "[")) or self.suffix == ".toml" or _is_toml_header(self.start):
            return None
        try:
            return parse_json(self.text)
        except json.JSONDecodeError as error:
            at = f"{error.msg.lower()} at line {error.lineno}, column {error.colno}"
            raise DatasetError(self.path, "JSON", "a complete JSON document", at) from error
        except RecursionError:
            raise DatasetError(self.path, "JSON", "a calibration", "lists nested too deeply") from None

    @cached_property
    def xml(self) -> ET.Element | None:
        """The root of the XML document; None if the text does not begin like one."""
        if not self.start.startswith("<"):
            return None
        try:
            return ET.fromstring(self.text)
        except ET.ParseError as error:
            raise DatasetError(self.path, "XML", "a well-formed XML document", str(error)) from error

    @cached_property
    def toml(self) -> dict[str, Any]:
        """The TOML document, or `DatasetError`."""
        return parse_toml(self.path, self.text)


def _is_toml_header(start: str) -> bool:
    """Whether a text that begins with ``[`` begins with a table's name, not with a list's first value."""
    line = start.partition("\n")[0].partition("#")[0].strip()
    inside = line.removeprefix("[").removesuffix("]").strip()
    return line.startswith("[") and line.endswith("]") and inside[:1].isalpha()
