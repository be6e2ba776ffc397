"""The folder of a run: checked first, cleared of an earlier run, the report written last."""

from __future__ import annotations

import contextlib
import hashlib
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat import layouts
from skelsplat._atomic import atomic_write_text, opening, remove_left
from skelsplat._json import to_text
from skelsplat._lock import locked
from skelsplat._optional import can_draw, pip_line
from skelsplat._words import listed
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, Remedy, Subject, collected_warnings, warn
from skelsplat.io import write_people, write_pose
from skelsplat.io._files import load_json
from skelsplat.io._run_files import (
    CAMERAS,
    DETECTIONS,
    LAYOUT,
    REPORT,
    RUN,
    UNFINISHED,
    files_of_run,
    folders_of_run,
    is_person,
    is_run,
    of_person,
)
from skelsplat.io.detections import FORMATS
from skelsplat.io.poses import (
    OPENSIM_FILES,
    PEOPLE_FORMATS,
    POSE_FORMATS,
    check_opensim,
    check_pose_format,
    write_opensim,
)
from skelsplat.io.run_folder import write_run_inputs
from skelsplat.run.angles import FILES as ANGLE_FILES
from skelsplat.run.angles import check_angles, vertical_of, world_up, write_angles
from skelsplat.run.strides import FILE as STRIDES
from skelsplat.run.strides import strides_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt

    from skelsplat.io.poses._pose_data import Poses
    from skelsplat.run._run import PeopleRun, Run
    from skelsplat.run.job import Job, Writing
    from skelsplat.run.parts import Gathered
    from skelsplat.run.read import Inputs

PAGE = "report.html"
SCRATCH = ".skelsplat-long-"  # begins the name of the folder for the parts of a long recording
_PICTURES = ("overview.png", "weights.png")
_POSSIBLE = (
    *(f"pose.{kind}" for kind in POSE_FORMATS),
    *(f"people.{kind}" for kind in PEOPLE_FORMATS),
    *(*ANGLE_FILES, STRIDES, *OPENSIM_FILES, CAMERAS, DETECTIONS, LAYOUT, *_PICTURES, PAGE),
)
# of other commands, perhaps the work of hours
_OF_OTHERS = ("plots", "overlay")
_OPENSIM = Path(OPENSIM_FILES[0]).parent.name
_ASSUMED_FPS = 30.0
# animations, which turn the world and need somebody in it
_ANIMATIONS = [kind for kind, entry in POSE_FORMATS.items() if "up" in entry.options]
# formats that state times, which a frame rate has to be assumed for
_TIMED = [kind for kind, entry in POSE_FORMATS.items() if {"y_up", "up"} & set(entry.options)]


def _names(writing: Writing, run: Run, strides: str) -> list[str]:
    """Return the names of the files, but for the report; pictures need the extra viz."""
    wanted = {*(f"pose.{kind}" for kind in writing.pose_formats), CAMERAS, DETECTIONS}
    if not np.isfinite(run.poses.pose).any():
        wanted -= {f"pose.{kind}" for kind in _ANIMATIONS}
    wanted |= set(ANGLE_FILES) if writing.angles else set()
    wanted |= {STRIDES} if strides else set()
    wanted |= set(OPENSIM_FILES) if writing.opensim else set()
    wanted |= set() if layouts.is_built_in(run.layout) else {LAYOUT}
    if can_draw():
        wanted |= set(_PICTURES)
        wanted |= {PAGE} if writing.html else set()
    return [name for name in _POSSIBLE if name in wanted]


def check_files(writing: Writing, inputs: Inputs) -> None:
    """Raise before the work if a format or the angles cannot be written of these inputs."""
    for kind in writing.pose_formats:
        check_pose_format(kind, inputs.frames, inputs.layout.joints)
    if writing.angles:
        check_angles(inputs.layout)
    if writing.opensim:
        check_opensim(inputs.layout)


def find_in_files(writing: Writing, inputs: Inputs) -> Iterator[Finding]:
    """Yield findings on the files: no vertical, assumed times, no pictures."""
    timed = tuple(f"pose.{kind}" for kind in writing.pose_formats if kind in _TIMED)
    timed = (*timed, ANGLE_FILES[-1]) if writing.angles else timed
    timed = (*timed, OPENSIM_FILES[0]) if writing.opensim else timed
    turned = ["opensim/"] if writing.opensim else []
    turned += [f"pose.{kind}" for kind in writing.pose_formats if kind in _ANIMATIONS]
    if (writing.angles or turned) and vertical_of(inputs.rig) is None:
        effects = ["angles of trunk and pelvis are left out"] if writing.angles else []
        effects += [f"the nearest one is y in {listed(turned)}"] if turned else []
        words = f"The cameras do not show which axis of the world is vertical: {listed(effects)}."
        yield Finding("vertical_unknown", "note", sentence=words)
    if timed and inputs.fps is None:
        words = f"The frame rate is unknown: the times in {listed(timed)} assume {_ASSUMED_FPS:g} frames "
        words += "per second."
        numbers, remedy = {"fps": _ASSUMED_FPS}, (Remedy("fps", None),)
        yield Finding("times_assumed", "warning", Subject(files=timed), numbers, remedy, sentence=words)
    if not can_draw():
        sentence = f"report.html and figures need skelsplat[viz]: {pip_line('viz')}"
        yield Finding("no_pictures", "note", sentence=sentence)


def name_of(run: Run, whole: Gathered | None = None) -> str:
    """Return a hash of poses, detections and report: the same run done again has the same."""
    found = hashlib.sha256(to_text({**run.report, "timing": None, RUN: None}).encode())
    arrays: Iterator[npt.NDArray[Any]] = iter((run.poses.pose, run.poses.uncertainty, run.detections))
    if whole is not None:
        rows = (*map(whole.poses.rows.__getitem__, ("pose", "uncertainty")), whole.detections)
        arrays = chain.from_iterable(one.pieces() for one in rows)
    for array in arrays:
        found.update(array.tobytes())
    return found.hexdigest()[:16]


def write_folder(
    run: Run,
    folder: Path,
    writing: Writing,
    name: str = "",
    gathered: Gathered | None = None,
    tell: Callable[[Finding], None] | None = None,
) -> Run:
    """Write the folder of a run, its report last; of a long one all frames are ``gathered``.

    ``name`` is that of a person in a run of several; ``tell`` is called with findings on the files.
    """
    name = name or name_of(run, gathered)
    with collected_warnings(tell) as notes:
        strides = strides_of(run) if writing.angles else ""
        run = replace(run, report=_report(run, writing, name, strides))
        begin_writing(folder, run.report)
        whole = gathered or run
        _write_poses(run, folder, writing, whole.poses)
    rate, frames, names = run.poses.frame_rate, whole.poses.frames, run.report["files"]
    told = [*run.report["findings"], *(note.to_dict() for note in notes)]
    run = replace(run, findings=(*run.findings, *notes), report={**run.report, "findings": told})
    if writing.angles:
        write_angles(run, folder, _ASSUMED_FPS)
    if strides:
        atomic_write_text(folder / STRIDES, strides)
    if writing.opensim:
        write_opensim(folder, run.poses, world_up(run.cameras), rate or _ASSUMED_FPS)
    write_run_inputs(folder, run.cameras, run.layout, whole.detections, frames, rate, name)
    if can_draw():
        run.write_figures(folder)
    if PAGE in names:
        run.write_html(folder / PAGE)
    atomic_write_text(folder / REPORT, to_text(run.report))  # last: the run is whole
    return run


def _report(run: Run, writing: Writing, name: str, strides: str) -> dict[str, Any]:
    """Return the report with the name of the run and those of the files."""
    report = {**run.report, RUN: name, "files": _names(writing, run, strides)}
    report.pop("joint_angles", None)
    if writing.angles:
        up = vertical_of(run.cameras)
        report["joint_angles"] = {"names": [*run.angles.names], "up": None if up is None else up.tolist()}
    return report


def _write_poses(run: Run, folder: Path, writing: Writing, poses: Poses) -> None:
    """Write the pose files of a run whose report names its files, of all frames."""
    every = {
        "run": run.report[RUN],
        "y_up": writing.y_up,
        "marker_names": writing.marker_names,
        "up": world_up(run.cameras),
        "limbs": run.layout.limbs,
    }
    for kind in (kind for kind in writing.pose_formats if f"pose.{kind}" in run.report["files"]):
        options = {name: value for name, value in every.items() if name in POSE_FORMATS[kind].options}
        timed = {"frame_rate": run.poses.frame_rate or _ASSUMED_FPS} if kind in _TIMED else {}
        write_pose(folder / f"pose.{kind}", poses, **options, **timed)


def write_everybody(
    run: PeopleRun, folder: Path, writing: Writing, tell: Callable[[Finding], None] | None = None
) -> PeopleRun:
    """Write the folders of all people, then the files of everybody, the report last; return the run."""
    names = "".join(name_of(one) for one in run.people.values())
    name = hashlib.sha256(names.encode()).hexdigest()[:16]
    shown = [_PICTURES[0], *([PAGE] if writing.html else [])] if can_draw() else []
    poses = [f"people.{kind}" for kind in writing.pose_formats if kind in PEOPLE_FORMATS]
    run = replace(run, report={**run.report, RUN: name, "files": [*poses, *shown]})
    with collected_warnings(tell) as notes:
        begin_writing(folder, run.report)
    told = [*run.report["findings"], *(note.to_dict() for note in notes)]
    run = replace(run, findings=(*run.findings, *notes), report={**run.report, "findings": told})
    people = {}
    for own, (identity, one) in zip(run.report["folders"], run.people.items(), strict=True):
        with run_folder(folder / own):
            people[identity] = write_folder(one, folder / own, writing, of_person(name, own))
        for note in people[identity].findings[len(one.findings) :]:
            if tell is not None:
                tell(replace(note, sentence=f"person {identity}: {note.sentence}"))
    for together in poses:
        write_people(folder / together, {identity: one.poses for identity, one in run.people.items()})
    if can_draw():
        from skelsplat.run.figures import write_people_figure  # matplotlib takes long to load

        write_people_figure(run, folder / _PICTURES[0])
    if PAGE in shown:
        from skelsplat.run.html import write_people_html

        write_people_html(run, folder / PAGE)
    atomic_write_text(folder / REPORT, to_text(run.report))
    return replace(run, people=people)


def keep_input(job: Job, sources: Sequence[Path] = ()) -> None:
    """Refuse a folder in which results would overwrite the input or ``sources``, or be mixed with them."""
    if job.output is None:
        return
    out, top = Path(job.output).resolve(), Path(job.detections).resolve()
    written = {(out / name).resolve() for name in (*_POSSIBLE, REPORT)}
    for path in (Path(file).resolve() for file in (job.calibration, job.detections, job.init) if file):
        of_a_person = any(place.parent == out and is_person(place.name) for place in (path, path.parent))
        if path in {out, *written} or of_a_person:
            raise in_the_way(path)
    for path in sources:
        place = path.resolve()
        folder = place if place.is_dir() else place.parent
        if place in written or (folder != top and folder != top.parent and folder in {out, *out.parents}):
            raise in_the_way(path)


def keep_inputs(jobs: Iterable[Job], folder: Path, names: Sequence[str]) -> None:
    """Refuse, as `keep_input` does, a folder for files with these ``names``, about several jobs."""
    out, suffixes = folder.resolve(), {suffix for form in FORMATS.values() for suffix in form.suffixes}
    for job in jobs:
        top = Path(job.detections).resolve()
        files = (path for path in top.glob("*.*") if path != Path(job.calibration).resolve())
        of_cameras = top in out.parents and not any(path.suffix.lower() in suffixes for path in files)
        if of_cameras or top in (out, *(out / name for name in names)):
            raise in_the_way(Path(job.detections))


def in_the_way(path: Path) -> InvalidInputError:
    """Return the error that a folder for results is that of an input."""
    expected = "a folder in which no input is overwritten or mixed with results"
    return InvalidInputError(f"output: expected {expected}, got the one of {path}")


def begin_writing(folder: Path, report: dict[str, Any]) -> None:
    """Write the report as that of an unfinished run, then remove the files that an earlier run lists.

    Any others are not from a run. The same holds for the folders of people who are not of the new run.
    """
    earlier, people = files_of_run(folder) or [], folders_of_run(folder)
    new = {name for name in report["files"] if not (folder / name).exists()}
    unfinished = {
        UNFINISHED: True,
        **report,
        "files": [name for name in _POSSIBLE if name in {*earlier, *new}],
    }
    if people:
        unfinished["folders"] = list(dict.fromkeys([*report.get("folders", []), *people]))
    atomic_write_text(folder / REPORT, to_text(unfinished))
    _remove(folder, earlier)
    remove_left(folder, [*_POSSIBLE, REPORT])
    remove_left(folder / _OPENSIM, OPENSIM_FILES)
    left = [name for name in people if name not in report.get("folders", [])]
    if left:
        sentence = f"The files of {listed(left)}, folders of an earlier run, were removed."
        warn(Finding("earlier_removed", "note", Subject(files=tuple(left)), sentence=sentence))
    for gone in (folder / name for name in left):
        _remove(gone, files_of_run(gone) or [])
        with contextlib.suppress(OSError):  # missing, or it holds what is not from a run
            if is_run(gone):
                (gone / REPORT).unlink()
            gone.rmdir()


def _remove(folder: Path, names: Iterable[str]) -> None:
    """Remove the files of an earlier run that its report lists."""
    for path in (folder / name for name in _POSSIBLE if name in {*names}):
        with opening(path, "a file of an earlier run that can be removed"):
            path.unlink(missing_ok=True)
        if path.parent != folder:
            with contextlib.suppress(OSError):  # not empty, or never made
                path.parent.rmdir()


def left_of_earlier(folder: Path) -> list[str]:
    """Return the folders that other commands wrote and files that OpenSim did, which show an earlier run."""
    results = (f"{_OPENSIM}/{path.name}" for path in (folder / _OPENSIM).glob("*"))
    folders = [f"{name}/" for name in _OF_OTHERS if any((folder / name).glob("*"))]
    return [*folders, *sorted(set(results) - {*OPENSIM_FILES})]


@contextlib.contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """Make a folder for the parts of a long recording, removed afterwards."""
    room = opening(folder, "a folder with room for the parts of the recording", "output")
    with room, tempfile.TemporaryDirectory(prefix=SCRATCH, dir=folder) as place:
        yield Path(place)


@contextlib.contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """Make a folder as `output_folder` does, into which no other run writes during the block.

    A `KeyboardInterrupt` says whether anything was written.
    """
    with output_folder(folder), locked(folder):
        for left in folder.glob(f"{SCRATCH}*"):
            shutil.rmtree(left, ignore_errors=True)
        report = folder / REPORT
        before = report.stat().st_mtime_ns if report.exists() else 0
        try:
            yield
        except KeyboardInterrupt as stop:
            state = ""
            if (report.stat().st_mtime_ns if report.exists() else 0) == before:
                state = f"nothing was written to {folder}"
            elif UNFINISHED in load_json(report, "the report of a run"):
                state = f"{folder} is unfinished: run it again"
            raise KeyboardInterrupt(state) from stop


@contextlib.contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Make a folder and test that it can be written, before the work (`DatasetError`).

    If the block fails, the new folders that are still empty are removed.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        with opening(folder, "a folder that can be written", "output"):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        yield
    except BaseException:
        for path in missing:
            with contextlib.suppress(OSError):  # not empty, or never made
                path.rmdir()
        raise
