"""Runs of a job, of one person or of everybody: read, refine, count, find, and write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, collected_warnings, warn
from skelsplat.io.poses import check_pose_format
from skelsplat.run import folder as folders
from skelsplat.run import read
from skelsplat.run._run import PeopleRun, Run, in_order, summed_up
from skelsplat.run.cameras import read_adjusted
from skelsplat.run.job import Job
from skelsplat.run.over_time import try_over_time
from skelsplat.run.parts import in_parts
from skelsplat.run.people import find_over_people
from skelsplat.run.read import Inputs, open_files
from skelsplat.run.report import build_people_report
from skelsplat.run.solve import Progress, refine_inputs, silent
from skelsplat.run.tracked import follow_everybody, read_inputs

Tell = Callable[[Finding], None]


def run(job: Job, *, progress: Progress = silent, tell: Tell | None = None) -> Run:
    """Do one job: read, refine, check, and write the results if the job names a folder.

    A recording of more than 2 million detections (frames × cameras × joints) is done in parts, in memory that
    hardly grows with it, if its results are written and no option needs all frames at once (`Job.at_once`).
    Pose files, counts, means and findings on single frames are of all frames; medians, largest values, other
    findings, figures, the page and the `Run` are from every so many-th frame, as the report says under
    ``thinned``. Where several people are seen about as well, each part may follow another.

    ``progress`` is called with (frames done, frames in all), ``tell`` with each finding on the input.

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
        gathered = None
        with collected_warnings(tell) as notes:
            try_over_time(job)
            opened = open_files(job)
            if place is not None and opened.size > read.LONG and not job.at_once:
                _check_output(job, opened.nobody(job))
                _note_output(job, opened.nobody(job))
                scratch = stack.enter_context(folders.scratch(place))
                inputs, outcome, gathered = in_parts(opened, job, scratch, progress)
            else:
                inputs = read_inputs(opened, job, progress, lambda found: _check_output(job, found))
                _note_output(job, inputs)
                outcome = refine_inputs(inputs, job, progress)
        found = summed_up(inputs, outcome, job, notes, gathered)
        if place is not None:
            return folders.write_folder(found, place, job, gathered=gathered, tell=tell)
    return found


def run_people(job: Job, *, progress: Progress = silent, tell: Tell | None = None) -> PeopleRun:
    """Do one job for everybody in the recording: who is who, then a run for each person; otherwise as `run`.

    The frame rate must be known; ``people`` of the job limits their number.

    Raises
    ------
    SkelSplatError
        As `run`; also if the frame rate is unknown, or no two views agree on anybody.
    """
    job = replace(job, people="all" if job.people is None else job.people)
    with _output(job) as place:
        with collected_warnings(tell) as notes:
            try_over_time(job)
            people, whole = read_adjusted(open_files(job), job)
            _check_output(job, whole)
            everybody = follow_everybody(people, whole, job, progress)
            _note_output(job, whole)
            outcomes = [refine_inputs(inputs, job) for inputs in everybody.people]
        pairs = zip(everybody.people, outcomes, strict=True)
        runs = {int(one.person): summed_up(one, outcome, job) for one, outcome in pairs}
        over_people = find_over_people({who: one.findings for who, one in runs.items()}, whole.rig.names)
        findings = in_order([*notes, *everybody.whole.doubts, *over_people])
        found = PeopleRun(runs, findings, build_people_report(everybody, runs, findings, job.people))
        return found if place is None else folders.write_everybody(found, place, job, tell)


@contextmanager
def _output(job: Job) -> Iterator[Path | None]:
    """Check and make the folder of the results, if there is one; no other run writes there in the block."""
    if job.output is None:
        yield None
        return
    folders.keep_input(job)
    for kind in job.pose_formats:
        check_pose_format(kind)
    with folders.run_folder(Path(job.output)):
        yield Path(job.output)


def _check_output(job: Job, inputs: Inputs) -> None:
    """Check, once the frames of the input are known, that the results can be written."""
    if job.output is not None:
        folders.keep_input(job, inputs.sources)
        folders.check_files(job, inputs)


def _note_output(job: Job, inputs: Inputs) -> None:
    """Warn of notes on how the results are written."""
    for note in folders.find_in_files(job, inputs) if job.output is not None else ():
        warn(note)
