"""Runs of a job, of one person or of everybody: read, refine, count, find, and write."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, collected_warnings, warn
from skelsplat.io._run_files import CAMERAS, DETECTIONS
from skelsplat.run import folder as folders
from skelsplat.run import read
from skelsplat.run._run import PeopleRun, Run, in_order, summed_up
from skelsplat.run.adjust import read_adjusted
from skelsplat.run.job import Job
from skelsplat.run.over_time import try_over_time
from skelsplat.run.parts import in_parts
from skelsplat.run.people import find_over_people
from skelsplat.run.read import Inputs, open_files
from skelsplat.run.report import build_people_report, folder_of
from skelsplat.run.solve import Progress, refine_inputs
from skelsplat.run.tracked import check_times, follow_everybody, read_inputs

Tell = Callable[[Finding], None]
# Findings whose cause check-cameras looks for.
_CHECKED = ("camera_disagrees", "camera_displaced", "no_match", "views_apart", "limb_lengths_vary")


def run(
    job: Job,
    *,
    progress: Progress | None = None,
    tell: Tell | None = None,
    on_file: Callable[[str], None] | None = None,
) -> Run:
    """Do one job: read, refine, check, and write the results if the job names a folder.

    A recording of more than 2 million detections (frames × cameras × joints) is done in parts, in
    memory that hardly grows with it, if its results are written and no option needs all frames at once
    (`Job.at_once`). Its pose files, counts, means and findings on single frames are of all frames; where
    several people are seen about as well, another may be followed, as each part is judged alone. Medians,
    largest values, other findings, figures and the page are from every so many-th frame, as the report says
    under ``thinned``; so is the `Run`.

    Parameters
    ----------
    job : Job
    progress : callable, optional
        Called with (frames done, frames in all).
    tell : callable, optional
        Called with each finding on the input, before the poses are known.
    on_file : callable, optional
        Called with the name of each large file of the results before it is written.

    Returns
    -------
    Run

    Raises
    ------
    SkelSplatError
        If an input is missing, malformed or does not fit, results would be written over the input, or a
        result cannot be written.
    """
    if job.people is not None:
        expected = "None (skelsplat.run.run_people refines several)"
        raise InvalidInputError(f"people: expected {expected}, got {job.people!r}")
    with _output(job) as place, ExitStack() as stack:
        if place is None:
            return _refined(job, None, progress, tell)
        found = _refined(job, lambda: stack.enter_context(folders.scratch(place)), progress, tell)
        return replace(folders.write_folder(found, place, _writing(job), on_file=on_file), whole=None)


def run_people(
    job: Job,
    *,
    progress: Progress | None = None,
    tell: Tell | None = None,
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
    job = replace(job, people="all" if job.people is None else job.people)
    with _output(job) as place:
        found = _everybody(job, progress, tell)
        return found if place is None else folders.write_everybody(found, place, _writing(job), on_file)


@contextmanager
def _output(job: Job) -> Iterator[Path | None]:
    """Check and make the folder of the results, if there is one; no other run writes there in the block."""
    if job.output is None:
        yield None
        return
    place, writing = Path(job.output), _writing(job)
    folders.keep_input(job)
    several = job.people is not None
    names = writing.together if several else writing.names(job.settings.method)
    folders.check_places(place, names, several=several)
    writing.check()
    with folders.run_folder(place):
        yield place


def _writing(job: Job) -> folders.Writing:
    return folders.Writing.of(job)


def _refined(
    job: Job, scratch: Callable[[], Path] | None, progress: Progress | None, tell: Tell | None
) -> Run:
    """Refine one person: in parts, in the folder of ``scratch``, if the recording is long and allows it."""
    gathered = None
    with collected_warnings(tell) as notes:
        try_over_time(job)
        opened = open_files(job)
        if scratch is not None and opened.size > read.LONG and not job.at_once:
            _check_output(job, opened.nobody(job))
            _note_output(job, opened.nobody(job))
            inputs, outcome, gathered = in_parts(opened, job, scratch(), progress)
        else:
            inputs = read_inputs(opened, job, progress, lambda found: _check_output(job, found))
            _note_output(job, inputs)
            outcome = refine_inputs(inputs, job, progress)
    return summed_up(inputs, outcome, job, notes, gathered)


def _check_output(job: Job, inputs: Inputs) -> None:
    """Check, once the frames of the input are known, that the results can be written."""
    if job.output is not None:
        folders.keep_input(job, inputs.sources)
        _writing(job).check(inputs)


def _note_output(job: Job, inputs: Inputs) -> None:
    """Warn of notes on how the results are written."""
    for note in _writing(job).notes(inputs) if job.output is not None else ():
        warn(note)


def _everybody(job: Job, progress: Progress | None, tell: Tell | None) -> PeopleRun:
    with collected_warnings(tell) as notes:
        try_over_time(job)
        people, whole = read_adjusted(open_files(job), job)
        check_times(whole, job)
        _check_output(job, whole)
        _note_output(job, whole)
        everybody = follow_everybody(people, whole, job, progress)
        outcomes = [refine_inputs(inputs, job) for inputs in everybody.people]
    pairs = zip(everybody.people, outcomes, strict=True)
    runs = {int(one.person): summed_up(one, outcome, job) for one, outcome in pairs}
    runs = _in_proportion(runs, job)
    over_people = find_over_people(
        {identity: one.findings for identity, one in runs.items()}, whole.rig.names
    )
    found = in_order([*notes, *everybody.whole.doubts, *over_people])
    return PeopleRun(runs, found, build_people_report(everybody, runs, found, job))


def _in_proportion(runs: Mapping[int, Run], job: Job) -> dict[int, Run]:
    """Turn into a note that a camera disagrees, unless it does for most of the people whom it sees.

    Who stands before whom makes any camera disagree about somebody; a wrong one does about everybody. What
    looks for the cause looks at the detections of that person.
    """
    everyone = runs.values()
    found = [one for run in everyone for one in run.findings if one.kind == "camera_disagrees"]
    named = Counter(one.subject.cameras[0] for one in found)
    seen = Counter(group.name for run in everyone for group in run.statistics.cameras if group.used)

    def changed(identity: int, finding: Finding) -> Finding:
        (camera, *_) = finding.subject.cameras or ("",)
        if finding.kind == "camera_disagrees" and 2 * named[camera] <= seen[camera]:
            finding = replace(finding, severity="note")
        if job.output is not None and finding.kind in _CHECKED:
            place = Path(job.output) / folder_of(identity)
            files = [str(place / name) for name in (CAMERAS, DETECTIONS)]
            check = shlex.join(["skelsplat", "check-cameras", *files])
            words = f"{finding.text} {check} looks for the cause."
            finding = replace(finding, numbers={**finding.numbers, "check": check}, sentence=words)
        return finding

    return {
        identity: _with_findings(run, [changed(identity, one) for one in run.findings])
        for identity, run in runs.items()
    }


def _with_findings(run: Run, findings: Sequence[Finding]) -> Run:
    found = in_order(findings)
    report = {**run.report, "findings": [finding.to_dict() for finding in found]}
    return replace(run, findings=found, report=report)
