"""A run of a long recording: the order of the steps, as of `skelsplat.run.run`."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat._atomic import opening
from skelsplat.findings import Finding, collected_warnings, warn
from skelsplat.run import folder as folders
from skelsplat.run import read
from skelsplat.run._run import Run, Whole, check_output, in_order, reported, warn_of_output
from skelsplat.run.findings import find_findings
from skelsplat.run.job import Job
from skelsplat.run.long._follow import follow
from skelsplat.run.long._gather import Gathered
from skelsplat.run.long._solve import solve
from skelsplat.run.over_time import apply_over_time
from skelsplat.run.read import Inputs, Opened, open_files
from skelsplat.run.solve import Progress, poses_of, why_alone

# Bytes of files of so many detections, at least.
_LEAST_BYTES = 16 * 2**20
# Detections in memory at a time, but 600 frames or more: 100 MB with their results.
_PER_PART, _LEAST_FRAMES = 400_000, 600


def run_long(
    job: Job,
    *,
    progress: Progress | None = None,
    tell: Callable[[Finding], None] | None = None,
    on_file: Callable[[str], None] | None = None,
) -> Run | None:
    """Do a job whose recording is long, in memory that hardly grows with it; None if it is not.

    The pose files are those of `skelsplat.run.run`, and so are counts, means and findings on single frames;
    where several people are seen about as well, another may be followed, as each part is judged alone.
    Medians, largest values, other findings, figures and the page are from every so many-th frame, as the
    report says under ``thinned``; so is the `Run`.

    Long is a recording of more than 2 million detections, that is, frames × cameras × joints. Jobs whose
    options need all frames at once (`Job.at_once`) are not done in parts: ``people``, ``init``,
    ``adjust_cameras``, ``fill_gaps``, ``filter``, ``angles``, the paper's method, another ``person`` than
    ``"consistent"``, and ``pose.c3d``.

    Parameters and errors are those of `skelsplat.run.run`.
    """
    if job.output is None or job.at_once or _bytes(Path(job.detections)) < _LEAST_BYTES:
        return None
    folders.keep_input(job)
    with collected_warnings() as early:
        opened = open_files(job)
    if opened.size <= read.LONG:
        return None
    output, writing = Path(job.output), folders.Writing.of(job)
    folders.check_places(output, writing.names(job.settings.method))
    writing.check()
    with folders.run_folder(output), _scratch(output) as scratch:
        with collected_warnings(tell) as notes:
            for finding in early:
                warn(finding)
            inputs = _nobody(job, opened)
            check_output(job, inputs)
            warn_of_output(job, inputs)
            found, left_out = _refined(job, opened, inputs, scratch, progress)
        findings = in_order([*notes, *found.findings])
        nothing = apply_over_time(found.poses, None)[1]
        found = reported(replace(found, findings=findings), job, nothing, left_out)
        return replace(folders.write_folder(found, output, writing, on_file=on_file), whole=None)


@contextmanager
def _scratch(folder: Path) -> Iterator[Path]:
    """Make a folder for the parts, removed afterwards."""
    room = opening(folder, "a folder with room for the parts of the recording", "output")
    with room, tempfile.TemporaryDirectory(prefix=folders.SCRATCH, dir=folder) as scratch:
        yield Path(scratch)


def _bytes(path: Path) -> int:
    """Return the bytes of a file, or of the files in a folder and those beneath, as far as it matters."""
    if path.is_file():
        return path.stat().st_size
    total = 0
    for folder, _, names in os.walk(path):
        for name in names:
            total += Path(folder, name).stat().st_size
            if total >= _LEAST_BYTES:
                return total
    return total


def _nobody(job: Job, opened: Opened) -> Inputs:
    """Return the inputs of all frames without their detections."""
    views, joints = len(opened.rig), opened.detections.skeleton.n_joints
    return opened.inputs(job, np.empty((0, views, joints, 3)), np.empty((0, views), dtype=np.bool_))


def _refined(
    job: Job, opened: Opened, inputs: Inputs, folder: Path, progress: Progress | None
) -> tuple[Run, int]:
    """Return the run of the frames drawn, with the whole and the findings that are not warnings.

    And how many findings on single frames it leaves out.
    """
    if progress is not None:
        progress(0, len(inputs.frames))
    size = max(_LEAST_FRAMES, _PER_PART // (len(opened.rig) * opened.detections.skeleton.n_joints))
    person = follow(opened, folder, size, _half(progress, 0))
    inputs = replace(inputs, crowd=person.crowd, apart=person.apart)
    gathered, seconds = Gathered(inputs, job.settings, folder), 0.0
    begin = time.perf_counter()
    for part, result in solve(inputs, person.detections, job, size, _half(progress, 1)):
        seconds += time.perf_counter() - begin
        own = replace(
            inputs,
            detections=person.detections.read(part.start, part.stop),
            unmatched=person.unmatched.read(part.start, part.stop),
            frames=inputs.frames[part],
        )
        gathered.add(part, own, result)
        begin = time.perf_counter()
    drawn, outcome, statistics = gathered.sample(seconds, why_alone(inputs, job))
    counts = {} if gathered.named_all else gathered.joint_counts
    findings = find_findings(drawn, outcome, statistics, gathered.joint_frames, counts)
    in_frames, left_out = gathered.in_frames(drawn, outcome, statistics)
    whole = Whole(gathered.poses(size), person.detections)
    poses = poses_of(drawn, outcome.result)
    run = Run(poses, tuple(findings), tuple(in_frames), {}, statistics, drawn, outcome, whole)
    return run, left_out


def _half(progress: Progress | None, done: int) -> Progress | None:
    """Return the progress of one of two passes, ``done`` of which are over: a frame counts half in each."""
    if progress is None:
        return None
    return lambda frames, total: progress((done * total + frames) // 2, total)
