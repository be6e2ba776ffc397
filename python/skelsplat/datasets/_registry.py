"""Data sets by name.

A reader is a module, or an object in one (``"module:NAME"``), with

- ``DESCRIPTION``: one line for ``skelsplat datasets list``;
- ``read(root, **options) -> Dataset``: keyword-only options with defaults; raises `DatasetError`;
- ``survey(root, **options) -> Survey``: the same options; which files are there, and which are missing and
  where they were expected. It opens nothing that is large and does not raise for what is missing.

Takes should say in ``Take.files`` where their parts come from, so that errors can name the file.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from skelsplat.datasets._model import Dataset
from skelsplat.datasets._verify import raise_fatal
from skelsplat.exceptions import DatasetError, InvalidInputError

_MODULES = {
    "human36m": "skelsplat.datasets.human36m",
    "human36m-occ": "skelsplat.datasets.human36m_occ",
    "panoptic": "skelsplat.datasets.panoptic",
    "occlusion-person": "skelsplat.datasets.occlusion_person",
    "shelf": "skelsplat.datasets._shelf_campus:SHELF",
    "campus": "skelsplat.datasets._shelf_campus:CAMPUS",
    "synthetic": "skelsplat.datasets.synthetic",
}


@dataclass(frozen=True)
class Survey:
    """Files of a data set.

    Attributes
    ----------
    there : sequence of Path
    missing : sequence of (Path, str)
        Where a file or folder was expected, and what it would hold.
    format : str
        The layout on disk that was chosen or found; "" if the data set has one only.
    """

    there: Sequence[Path] = field(default=())
    missing: Sequence[tuple[Path, str]] = field(default=())
    format: str = ""


class Reader(Protocol):
    """What a reader offers."""

    DESCRIPTION: str

    def read(self, root: Path, **options: Any) -> Dataset:
        """Read the data set beneath `root`."""

    def survey(self, root: Path, **options: Any) -> Survey:
        """Say which files are there."""


def names() -> tuple[str, ...]:
    """Names of the data sets that can be read."""
    return tuple(_MODULES)


def reader(name: str) -> Reader:
    """Return the reader of a data set.

    Raises
    ------
    InvalidInputError
        If there is none of that name.
    """
    if name not in _MODULES:
        raise InvalidInputError(f"name: expected one of {', '.join(_MODULES)}, got {name!r}")
    module, _, inside = _MODULES[name].partition(":")
    found = import_module(module)
    return cast("Reader", getattr(found, inside) if inside else found)


def options_of(name: str) -> tuple[str, ...]:
    """Names of the options that `read` takes for a data set."""
    parameters = inspect.signature(reader(name).read).parameters.values()
    return tuple(p.name for p in parameters if p.kind is p.KEYWORD_ONLY)


def prepared(name: str, root: str | os.PathLike[str], options: dict[str, Any]) -> tuple[Reader, Path]:
    """Return the reader and the root, both checked.

    Raises
    ------
    InvalidInputError
        If the name or an option is unknown.
    DatasetError
        If there is nothing at `root`.
    """
    module = reader(name)
    known = options_of(name)
    for option in options:
        if option not in known:
            raise InvalidInputError(f"{option}: expected an option of {name} ({', '.join(known)}), got this")
    path = Path(root)
    if not path.exists():
        raise DatasetError(path, "root", f"the folder of {name}", "nothing in this place")
    return module, path


def read(name: str, root: str | os.PathLike[str], **options: Any) -> Dataset:
    """Read a data set.

    Parameters
    ----------
    name : str
        One of `names`.
    root : path
        Its folder.
    **options
        Those of the reader, such as ``detector="cpn"``; the reader's module documents them.

    Raises
    ------
    InvalidInputError
        If the name or an option is unknown, or an option's value is.
    DatasetError
        If files are missing or malformed, or the data cannot be used: a wrong unit, exchanged sides. It names
        the file and the field.
    """
    module, path = prepared(name, root, options)
    dataset = module.read(path, **options)
    raise_fatal(dataset)
    return dataset
