"""What `skelsplat datasets check` reports."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skelsplat.datasets._finding import Finding
from skelsplat.datasets._model import Dataset
from skelsplat.datasets._registry import Survey, prepared
from skelsplat.datasets._reproject import ViewError, view_errors
from skelsplat.datasets._verify import samples_of, verify
from skelsplat.exceptions import DatasetError


@dataclass(frozen=True)
class Report:
    """What is in the folder of a data set.

    Attributes
    ----------
    name : str
    root : Path
    survey : Survey
        Files that are there, and those missing.
    dataset : Dataset or None
        What was read; None if it cannot be.
    error : DatasetError or None
        Why it cannot be read.
    findings : tuple of Finding
        What the verification found; those that are fatal make `read` refuse the data.
    errors : tuple of ViewError
        Distance of the projected truth from the detections, per camera.
    """

    name: str
    root: Path
    survey: Survey
    dataset: Dataset | None = field(default=None, repr=False)
    error: DatasetError | None = None
    findings: tuple[Finding, ...] = ()
    errors: tuple[ViewError, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing is missing and the data can be used."""
        fatal = any(finding.fatal for finding in self.findings)
        return self.error is None and not self.survey.missing and not fatal


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
    survey = module.survey(path, **options)
    try:
        dataset = module.read(path, **options)
    except DatasetError as error:
        return Report(name, path, survey, error=error)
    samples = samples_of(dataset)
    errors = view_errors(samples, dataset.layout)
    return Report(name, path, survey, dataset, findings=verify(dataset, samples), errors=errors)
