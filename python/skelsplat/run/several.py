"""The runs of everybody in a recording: who is there when, findings on all, one folder per person."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat._arrays import Index
from skelsplat._atomic import atomic_write_text
from skelsplat._json import to_text
from skelsplat._optional import can_draw
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, collected_warnings
from skelsplat.io import write_people
from skelsplat.io._files import load_json
from skelsplat.io._run_files import (
    REPORT,
    RUN,
    check_finished,
    check_people,
    folders_of_run,
    is_person,
    of_person,
)
from skelsplat.io.poses import PEOPLE_FORMATS
from skelsplat.run import folder as folders
from skelsplat.run._run import Run, check_output, in_order, summed_up, warn_of_output
from skelsplat.run.adjust import read_adjusted
from skelsplat.run.over_people import find_over_people, in_proportion, with_checks
from skelsplat.run.over_time import try_over_time
from skelsplat.run.people_report import build_people_report, folder_of
from skelsplat.run.solve import refine_inputs
from skelsplat.run.tracked import check_times, follow_everybody

PICTURE = "overview.png"

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from skelsplat.run.job import Job
    from skelsplat.run.solve import Progress


@dataclass(frozen=True, repr=False)
class PeopleRun:
    """The runs of all people of a recording.

    `skelsplat.run.run_people` makes one from files, and `open` from the folder of an earlier one.

    Attributes
    ----------
    people : dict of int to Run
        By identity, in the order of appearance. The ``frames`` of a run are those from the first to the last
        in which two views see the person.
    findings : tuple of Finding
        What concerns everybody, errors first; those on one person are in their `Run`.
    report : dict
        What ``report.json`` holds; ``people`` has an entry per person, with the name of their ``folder``.
    """

    people: Mapping[int, Run]
    findings: tuple[Finding, ...]
    report: dict[str, Any]

    @property
    def frames(self) -> Index:
        """The numbers of the frames in which somebody is there."""
        return np.unique(np.concatenate([run.frames for run in self.people.values()]))

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> PeopleRun:
        """Read the folder that ``skelsplat refine --people`` wrote.

        Raises
        ------
        DatasetError
            If it is none, or a file is missing or malformed.
        """
        path = Path(folder)
        names = folders_of_run(path)
        if not names:
            raise DatasetError(path, REPORT, "the report of a run of several people", "none")
        report = load_json(path / REPORT, "the report of a run")
        check_finished(path / REPORT, report)
        check_people(path / REPORT)
        runs = [Run.open(path / name) for name in names]
        found = tuple(Finding.from_dict(entry) for entry in report["findings"])
        pairs = zip(report["people"], runs, strict=True)
        return cls({entry["id"]: run for entry, run in pairs}, found, report)

    def write(
        self, folder: str | os.PathLike[str], formats: Sequence[str] = ("npz", "csv", "trc"), **options: Any
    ) -> list[str]:
        """Write everything, as ``skelsplat refine --people`` does; return the names of files and folders.

        ``options`` are those of `Run.write`.
        """
        kinds = tuple(dict.fromkeys(["npz", *formats]))
        with folders.run_folder(Path(folder)):
            report = write_everybody(self, Path(folder), folders.Writing(kinds, **options)).report
        return [*report["files"], *report["folders"], REPORT]

    def __repr__(self) -> str:
        people = "1 person" if len(self.people) == 1 else f"{len(self.people)} people"
        found = len(self.findings) + sum(len(run.findings) for run in self.people.values())
        return f"PeopleRun({people}, {len(self.frames)} frames, {found} finding{'s' * (found != 1)})"


def run_people(
    job: Job,
    *,
    progress: Progress | None = None,
    tell: Callable[[Finding], None] | None = None,
    on_file: Callable[[str], None] | None = None,
) -> PeopleRun:
    """Do one job for everybody in the recording: who is who, then a run for each person.

    Parameters
    ----------
    job : Job
        Its frame rate must be known; ``people`` limits their number.
    progress, tell, on_file
        As for `run`; the name of a person's file is ``person_0/pose.npz``.

    Returns
    -------
    PeopleRun

    Raises
    ------
    SkelSplatError
        As `run`; also if the frame rate is unknown, or no two views agree on anybody.
    """
    if job.output is None:
        return _run_people(job, progress, tell)
    output, writing = Path(job.output), folders.Writing.of(job)
    folders.keep_input(job)
    folders.check_places(output, _together(writing))
    for path in output.glob("person_*"):
        if is_person(path.name) and not path.is_dir():
            raise DatasetError(path, "output", "a folder, or nothing, with the name of a person's", "a file")
    writing.check()
    with folders.run_folder(output):
        return write_everybody(_run_people(job, progress, tell), output, writing, on_file)


def _run_people(job: Job, progress: Progress | None, tell: Callable[[Finding], None] | None) -> PeopleRun:
    job = replace(job, people="all" if job.people is None else job.people)
    with collected_warnings(tell) as notes:
        try_over_time(job)
        people, whole = read_adjusted(job)
        check_times(whole, job)
        check_output(job, whole)
        warn_of_output(job, whole)
        everybody = follow_everybody(people, whole, job, progress)
        outcomes = [refine_inputs(inputs, job) for inputs in everybody.people]
    pairs = zip(everybody.people, outcomes, strict=True)
    runs = in_proportion({int(one.person): summed_up(one, outcome, job) for one, outcome in pairs})
    runs = with_checks(runs, job)
    found = in_order([*notes, *everybody.whole.doubts, *find_over_people(runs)])
    return PeopleRun(runs, found, build_people_report(everybody, runs, found, job))


def write_everybody(
    run: PeopleRun, folder: Path, writing: folders.Writing, on_file: Callable[[str], None] | None = None
) -> PeopleRun:
    """Write the folders of all people, then the files of everybody, the report last; return the run."""
    on_file = on_file or folders.nothing
    names = "".join(folders.name_of(one) for one in run.people.values())
    name = hashlib.sha256(names.encode()).hexdigest()[:16]
    run = replace(run, report={**run.report, RUN: name, "files": _together(writing)})
    folders.begin_writing(folder, run.report)
    people = {}
    for identity, one in run.people.items():
        own = folder_of(identity)
        told = partial(_tell_of, on_file, own)
        with folders.run_folder(folder / own):
            people[identity] = folders.write_folder(one, folder / own, writing, of_person(name, own), told)
    poses = {identity: one.poses for identity, one in run.people.items()}
    for name in _poses_together(writing):
        on_file(name)
        write_people(folder / name, poses)
    if can_draw():
        from skelsplat.run import people_page  # matplotlib takes long to load

        on_file(PICTURE)
        people_page.write_people_figure(run, folder / PICTURE)
        if writing.html:
            people_page.write_people_page(run, folder / folders.PAGE)
    atomic_write_text(folder / REPORT, to_text(run.report))
    return replace(run, people=people)


def _tell_of(on_file: Callable[[str], None], folder: str, name: str) -> None:
    on_file(f"{folder}/{name}")


def _together(writing: folders.Writing) -> list[str]:
    """Return the files that hold or show everybody."""
    shown = [PICTURE, *([folders.PAGE] if writing.html else [])] if can_draw() else []
    return [*_poses_together(writing), *shown]


def _poses_together(writing: folders.Writing) -> list[str]:
    return [f"people.{kind}" for kind in writing.formats if kind in PEOPLE_FORMATS]
