"""Data sets by name: reading and checking them.

A reader is a module, or an object in one (``"module:NAME"``), with

- ``DESCRIPTION``: one line for ``skelsplat datasets list``;
- ``read(root, **options) -> Dataset``: keyword-only options with defaults, and those that ``OPTIONS``, if the
  reader has it, names; raises `DatasetError`;
- ``survey(root, options) -> Survey``: those options by name; which files are there, which are missing and
  where they were expected. It opens nothing that is large and does not raise for what is missing.

Takes should say in ``Take.files`` where their parts come from, so that errors can name the file.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from skelsplat.datasets._files import Survey
from skelsplat.datasets._model import Dataset
from skelsplat.datasets._verify import ViewError, raise_errors, samples_of, verify, view_errors
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.findings import Finding

_MODULES = {
    "human36m": "skelsplat.datasets.human36m",
    "human36m-occ": "skelsplat.datasets.human36m:OCCLUDED",
    "panoptic": "skelsplat.datasets.panoptic",
    "occlusion-person": "skelsplat.datasets.occlusion_person",
    "shelf": "skelsplat.datasets._shelf_campus:SHELF",
    "campus": "skelsplat.datasets._shelf_campus:CAMPUS",
    "synthetic": "skelsplat.datasets.synthetic",
}


class Reader(Protocol):
    """What a reader offers."""

    DESCRIPTION: str

    def read(self, root: Path, **options: Any) -> Dataset:
        """Read the data set beneath `root`."""

    def survey(self, root: Path, options: Mapping[str, Any]) -> Survey:
        """Say which files are there."""


def names() -> tuple[str, ...]:
    """Names of the data sets that can be read."""
    return tuple(_MODULES)


def reader(name: str) -> Reader:
    """Return the reader of a data set."""
    one_of("name", name, _MODULES)
    module, _, inside = _MODULES[name].partition(":")
    found = import_module(module)
    return cast("Reader", getattr(found, inside) if inside else found)


def options_of(name: str) -> tuple[str, ...]:
    """Names of the options that `read` takes for a data set."""
    module = reader(name)
    return (*_defaults(module), *getattr(module, "OPTIONS", ()))


def _defaults(module: Reader) -> dict[str, Any]:
    parameters = inspect.signature(module.read).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY}


def detections_option(name: str, which: str) -> dict[str, Any]:
    """Return the reader's option for detections: a detector's name, or a path outside the root."""
    apart = Path(which).exists() and "detections" in options_of(name)
    return {"detections": Path(which)} if apart else {"detector": which}


def prepared(name: str, root: str | os.PathLike[str], options: dict[str, Any]) -> tuple[Reader, Path]:
    """Return the reader and the root; refuse unknown names and options, and a root that is not there."""
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
    raise_errors(dataset)
    return dataset


@dataclass(frozen=True)
class Report:
    """What is in the folder of a data set."""

    name: str
    root: Path
    survey: Survey  #: files that are there, and those missing
    dataset: Dataset | None = field(default=None, repr=False)  #: what was read; None if it cannot be
    error: DatasetError | None = None  #: why it cannot be read
    #: What `verify` found; with an error among them `read` refuses the data.
    findings: tuple[Finding, ...] = ()
    errors: tuple[ViewError, ...] = ()  #: distance of the projected truth from the detections, per camera

    @property
    def ok(self) -> bool:
        """Whether nothing is missing and the data can be used."""
        wrong = any(finding.severity == "error" for finding in self.findings)
        return self.error is None and not self.survey.missing and not wrong

    def to_dict(self) -> dict[str, Any]:
        """Return the report as values of JSON."""
        return {
            "name": self.name,
            "root": str(self.root),
            "format": self.survey.format or None,
            "ok": self.ok,
            "files": {
                "there": [str(path) for path in self.survey.there],
                "missing": [{"path": str(path), "what": what} for path, what in self.survey.missing],
            },
            "error": None if self.error is None else str(self.error),
            "findings": [finding.to_dict() for finding in self.findings],
            "reprojection_px": [asdict(row) for row in self.errors],
            "dataset": None if self.dataset is None else _as_dict(self.dataset),
        }


def _as_dict(dataset: Dataset) -> dict[str, Any]:
    return {
        "layout": dataset.layout.name,
        "joints": dataset.layout.n_joints,
        "detector": dataset.detector,
        "source": dataset.source,
        "notes": list(dataset.notes),
        "takes": [
            {
                "key": take.key,
                "subject": take.subject,
                "action": take.action,
                "frames": len(take),
                "views": list(take.rig.names),
                "unit": take.rig.unit,
                "detected": take.detected,
                "labelled": take.labelled,
                "files": {part: str(path) for part, path in take.files.items()},
            }
            for take in dataset
        ],
    }


def check(name: str, root: str | os.PathLike[str], **options: Any) -> Report:
    """Say what is in the folder of a data set, what is missing, and whether the data mean what they should.

    Parameters
    ----------
    name, root, **options
        As for `read`.

    Returns
    -------
    Report
        Also if the data cannot be read: it says why.

    Raises
    ------
    InvalidInputError
        If the name or an option is unknown, or an option's value is.
    DatasetError
        If there is nothing at `root`.
    """
    module, path = prepared(name, root, options)
    survey = module.survey(path, {**_defaults(module), **options})
    try:
        dataset = module.read(path, **options)
    except DatasetError as error:
        return Report(name, path, survey, error=error)
    samples = samples_of(dataset)
    errors = view_errors(samples, dataset.layout)
    return Report(name, path, survey, dataset, findings=verify(dataset, samples), errors=errors)
