"""The runs of everybody in a recording: who is there when, findings on all, one folder per person."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Index
from skelsplat._atomic import atomic_write_text
from skelsplat._json import plain, to_text
from skelsplat._optional import can_draw
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, collected_warnings
from skelsplat.io import write_people
from skelsplat.io._run_files import REPORT, UNFINISHED, folders_of_run
from skelsplat.io.poses import PEOPLE_FORMATS
from skelsplat.run import folder as folders
from skelsplat.run._run import ORDER, Run, check_output, summed_up
from skelsplat.run.over_time import try_over_time
from skelsplat.run.people import limb_spread
from skelsplat.run.read import read_everybody
from skelsplat.run.report import input_of, versions
from skelsplat.run.solve import refine_inputs
from skelsplat.run.summary import finite_median
from skelsplat.run.tracked import Everybody, check_times, follow_everybody

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
        report = json.loads((path / REPORT).read_bytes())
        if report.get(UNFINISHED):
            expected = "the report of a run that has written all its files"
            raise DatasetError(path / REPORT, UNFINISHED, expected, "one that was stopped: run it again")
        runs = [Run.open(path / name) for name in names]
        found = tuple(Finding.from_dict(entry) for entry in report["findings"])
        return cls(
            {entry["id"]: run for entry, run in zip(report["people"], runs, strict=True)}, found, report
        )

    def write(
        self, folder: str | os.PathLike[str], formats: Sequence[str] = ("npz", "csv", "trc"), **options: Any
    ) -> list[str]:
        """Write everything, as ``skelsplat refine --people`` does; return the names of files and folders.

        ``options`` are those of `Run.write`.
        """
        kinds = tuple(dict.fromkeys(["npz", *formats]))
        with folders.output_folder(Path(folder)):
            report = write_everybody(self, Path(folder), folders.Writing(kinds, **options)).report
        return [*report["files"], *report["folders"], REPORT]

    def __repr__(self) -> str:
        return (
            f"PeopleRun({len(self.people)} people, {len(self.frames)} frames, {len(self.findings)} findings)"
        )


def run_people(
    job: Job,
    *,
    progress: Progress | None = None,
    tell: Callable[[Finding], None] | None = None,
) -> PeopleRun:
    """Do one job for everybody in the recording: who is who, then a run for each person.

    Parameters
    ----------
    job : Job
        Its frame rate must be known; ``people`` limits their number.
    progress, tell
        As for `run`.

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
    with folders.output_folder(output):
        return write_everybody(_run_people(job, progress, tell), output, writing)


def _run_people(job: Job, progress: Progress | None, tell: Callable[[Finding], None] | None) -> PeopleRun:
    job = replace(job, people="all" if job.people is None else job.people)
    with collected_warnings(tell) as notes:
        try_over_time(job)
        people, whole = read_everybody(job)
        check_times(whole, job)
        for note in check_output(job, whole):
            notes.append(note)
            if tell is not None:
                tell(note)
        everybody = follow_everybody(people, whole, job, progress)
        outcomes = [refine_inputs(inputs, job) for inputs in everybody.people]
    pairs = zip(everybody.people, outcomes, strict=True)
    runs = {int(inputs.person): summed_up(inputs, outcome, job) for inputs, outcome in pairs}
    found = sorted([*notes, *everybody.whole.doubts], key=lambda finding: ORDER.index(finding.severity))
    return PeopleRun(runs, tuple(found), _report(everybody, runs, found, job))


def folder_of(identity: int) -> str:
    """Return the name of a person's folder."""
    return f"person_{identity}"


def _report(
    everybody: Everybody, runs: Mapping[int, Run], findings: Sequence[Finding], job: Job
) -> dict[str, Any]:
    report = {
        "versions": versions(),
        "input": {**input_of(everybody.whole, job), "person": None, "people": job.people},
        "settings": next(iter(runs.values())).outcome.config.to_dict(),
        "people": [_entry(identity, run) for identity, run in runs.items()],
        "detections": {
            "meaning": "people detected, over all frames, and how many of them are one of those above",
            "cameras": [
                {"name": name, "detected": int(detected), "assigned": int(assigned)}
                for name, detected, assigned in zip(
                    everybody.whole.rig.names,
                    everybody.detected.sum(axis=0),
                    everybody.assigned.sum(axis=0),
                    strict=True,
                )
            ],
        },
        "findings": [finding.to_dict() for finding in findings],
        "note": job.note or None,
        "files": [],
        "folders": [folder_of(identity) for identity in runs],
    }
    cleaned: dict[str, Any] = plain(report)
    return cleaned


def _entry(identity: int, run: Run) -> dict[str, Any]:
    """Return what the report says of one person."""
    seen = np.isfinite(run.detections[..., 0]).any(axis=-1)  # (F, M)
    views = seen.sum(axis=1)
    total = run.statistics.total
    return {
        "id": identity,
        "folder": folder_of(identity),
        "first_frame": run.frames[0],
        "last_frame": run.frames[-1],
        "frames": len(run.frames),
        "seen": spans(run.frames[views > 0]),
        "seen_by_two": int((views >= 2).sum()),
        "views_median": float(np.median(views)),
        "cameras": [
            {"name": name, "frames": int(count)}
            for name, count in zip(run.cameras.names, seen.sum(axis=0), strict=True)
        ],
        "median_error_px": total.after_px,
        "rejected_share": total.rejected_share,
        "error_bar_median_mm": finite_median(run.statistics.error_bar_mm),
        "limb_range": limb_range(run),
        "findings": [finding.to_dict() for finding in run.findings],
    }


def spans(frames: Index) -> list[list[int]]:
    """Return the first and the last of every stretch of successive frame numbers."""
    ends = np.flatnonzero(np.diff(frames) > 1)
    first, last = np.concatenate([[0], ends + 1]), np.concatenate([ends, [len(frames) - 1]])
    return [[int(frames[a]), int(frames[b])] for a, b in zip(first, last, strict=True)] if len(frames) else []


def limb_range(run: Run) -> float:
    """Return how far the lengths of arms and legs range frame by frame, 5th to 95th percentile.

    As a part of the length, median over the limbs; a body has the same length in all frames.
    """
    result = run.result
    in_time = isinstance(result, sk.SequenceRefinement)
    pose = np.asarray(result.init_pose if in_time else result.pose)
    known = (np.asarray(result.joint_status) == "ok") & np.isfinite(pose).all(axis=-1)
    limbs = [limb for pair in run.layout.symmetric_pairs(2) for limb in pair]
    return finite_median(limb_spread(pose, np.asarray(result.uncertainty), known, limbs).relative)


def write_everybody(run: PeopleRun, folder: Path, writing: folders.Writing) -> PeopleRun:
    """Write the folders of all people, then the files of everybody, the report last; return the run."""
    run = replace(run, report={**run.report, "files": _together(writing)})
    folders.begin_writing(folder, run.report)
    people = {}
    for identity, one in run.people.items():
        with folders.output_folder(folder / folder_of(identity)):
            people[identity] = folders.write_folder(one, folder / folder_of(identity), writing)
    poses = {identity: one.poses for identity, one in run.people.items()}
    for name in _poses_together(writing):
        write_people(folder / name, poses)
    if can_draw():
        from skelsplat.run import people_page  # matplotlib takes long to load

        people_page.write_people_figure(run, folder / PICTURE)
        if writing.html:
            people_page.write_people_page(run, folder / folders.PAGE)
    atomic_write_text(folder / REPORT, to_text(run.report))
    return replace(run, people=people)


def _together(writing: folders.Writing) -> list[str]:
    """Return the files that hold or show everybody."""
    shown = [PICTURE, *([folders.PAGE] if writing.html else [])] if can_draw() else []
    return [*_poses_together(writing), *shown]


def _poses_together(writing: folders.Writing) -> list[str]:
    return [f"people.{kind}" for kind in writing.formats if kind in PEOPLE_FORMATS]
