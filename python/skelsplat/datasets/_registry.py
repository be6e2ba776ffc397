"""Data sets by name: reading and checking them.

A reader is a function ``read(root, survey, **options) -> Dataset``; its options are keyword-only and have
defaults. It looks for files with `Survey.find` and raises `DatasetError`. Options of several readers:

- ``detector``: whose detections to read, as in ``2d_DETECTOR``: ``"metrabs"``, ``"cpn"``, … By default the
  first that is there of metrabs, resnet152, cpn, resnet50 and others;
- ``detections``: detections that are kept apart from the data, in place of those of a detector: a folder
  ``<subject>/<activity>[/<camera>]/poses.npz``. Takes without any there are left out;
- ``format``: the layout on disk; found from the files by default;
- ``views``: how many cameras, or which;
- ``monocular``: the folder in ``initial_guess`` with 3D poses of monocular estimators, mm.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skelsplat.datasets import hourglass, human36m, occlusion_person, panoptic, shelf_campus, synthetic
from skelsplat.datasets._files import Survey
from skelsplat.datasets._model import Dataset
from skelsplat.datasets._verify import raise_errors, samples_of, verify, view_errors
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.findings import Finding


@dataclass(frozen=True)
class Reader:
    """A line for ``skelsplat datasets list``, and the function that reads."""

    description: str
    read: Callable[..., Dataset]


READERS = {
    "human36m": Reader("Human3.6M: 4 cameras, 17 joints; formats skelsplat, videopose3d", human36m.read),
    "human36m-occ": Reader(
        "Human3.6M-Occ: occluded views; one folder per variant, in the authors' layout",
        human36m.read_occluded,
    ),
    "human36m-hourglass": Reader(
        "Human3.6M with hourglass detections of arms, legs, neck and pelvis: one npz per take.",
        hourglass.read,
    ),
    "panoptic": Reader("CMU Panoptic Studio: single-person sequences in HD cameras.", panoptic.read),
    "occlusion-person": Reader(
        "Occlusion-Person: rendered persons behind furniture in 8 cameras.", occlusion_person.read
    ),
    "shelf": Reader("Shelf: several people in 5 cameras.", shelf_campus.read_shelf),
    "campus": Reader("Campus: several people in 3 cameras.", shelf_campus.read_campus),
    "synthetic": Reader("Simulated data sets that `skelsplat synth` writes.", synthetic.read),
}


def names() -> tuple[str, ...]:
    """Names of the data sets that can be read."""
    return tuple(READERS)


def options_of(name: str) -> tuple[str, ...]:
    """Names of the options that `read` takes for a data set."""
    one_of("name", name, READERS)
    parameters = inspect.signature(READERS[name].read).parameters.values()
    return tuple(one.name for one in parameters if one.kind is one.KEYWORD_ONLY)


def detections_option(name: str, which: str) -> dict[str, Any]:
    """Return the reader's option for detections: a detector's name, or a path outside the root."""
    known = options_of(name)
    if "detections" in known and Path(which).exists():
        return {"detections": Path(which)}
    if "detector" not in known:
        raise InvalidInputError(f"detections: expected none, as {name} has its own, got {which!r}")
    return {"detector": which}


def _checked(name: str, root: str | os.PathLike[str], options: Mapping[str, Any]) -> Path:
    """Return the root if it is there and the data set has these options."""
    known = options_of(name)
    for option in options:
        if option not in known:
            raise InvalidInputError(
                f"{option}: expected an option of {name} ({', '.join(known)}), got {option}"
            )
    if not Path(root).exists():
        raise DatasetError(Path(root), "root", f"the folder of {name}", "nothing in this place")
    return Path(root)


def read(name: str, root: str | os.PathLike[str], **options: Any) -> Dataset:
    """Read the data set `name`, one of `names`, from its folder.

    The options are those of the reader, such as ``detector="cpn"``; the reader's module documents them.
    Unknown names and options are an `InvalidInputError`; files that are missing or malformed, and data that
    cannot be used because of a wrong unit or exchanged sides, a `DatasetError` with the file and the field.
    """
    path = _checked(name, root, options)
    dataset = READERS[name].read(path, Survey(), **options)
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
    #: Median distance of the truth from the detections of each camera, px.
    errors: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether nothing is missing and the data can be used."""
        wrong = any(finding.severity == "error" for finding in self.findings)
        return self.error is None and not self.survey.missing and not wrong

    def to_dict(self) -> dict[str, Any]:
        """Return the report as values of JSON."""
        missing = [{"path": str(path), "what": what} for path, what in self.survey.missing]
        return {
            "name": self.name,
            "root": str(self.root),
            "format": self.survey.format or None,
            "ok": self.ok,
            "files": {"there": [str(path) for path in self.survey.there], "missing": missing},
            "error": None if self.error is None else str(self.error),
            "findings": [finding.to_dict() for finding in self.findings],
            "reprojection_px": dict(self.errors),
            "dataset": None if self.dataset is None else _as_dict(self.dataset),
        }


def _as_dict(dataset: Dataset) -> dict[str, Any]:
    takes = [
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
    ]
    return {
        "layout": dataset.layout.name,
        "joints": dataset.layout.n_joints,
        "detector": dataset.detector,
        "source": dataset.source,
        "notes": list(dataset.notes),
        "takes": takes,
    }


def check(name: str, root: str | os.PathLike[str], **options: Any) -> Report:
    """Say what is in the folder of a data set, what is missing, and whether the data mean what they should.

    Parameters and errors are those of `read`, but the report says why data cannot be read.
    """
    path, survey = _checked(name, root, options), Survey()
    try:
        dataset = READERS[name].read(path, survey, **options)
    except DatasetError as error:
        return Report(name, path, survey, error=error)
    samples = samples_of(dataset)
    errors = view_errors(samples)
    return Report(name, path, survey, dataset, findings=verify(dataset, samples), errors=errors)
