"""Many recordings: each is a run with a folder of its own, and one table has the findings of all."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from skelsplat._atomic import atomic_write_text
from skelsplat._budget import opened
from skelsplat._json import plain, to_text
from skelsplat._lock import locked
from skelsplat.exceptions import DatasetError, InvalidInputError, SkelSplatError
from skelsplat.io._files import VIDEO_SUFFIXES, listed, load_json
from skelsplat.io._run_files import REPORT, RUN, check_people, check_run, files_of_run, folders_of_run
from skelsplat.io.calibration import find_format
from skelsplat.io.calibration._json import to_json
from skelsplat.io.poses._csv import csv_text
from skelsplat.run.batch_cameras import CAMERAS, AdjustedTogether, adjust_together
from skelsplat.run.engine import run, run_people
from skelsplat.run.folder import keep_inputs, output_folder
from skelsplat.run.job import Job
from skelsplat.run.process import Child
from skelsplat.run.read import OF_CALIBRATION, read_rig
from skelsplat.run.report import versions

TABLE, RECORD = "batch.csv", "batch.json"
DONE, UNCHANGED, FAILED = "done", "unchanged", "failed"
COLUMNS = (
    *("recording", "status", "person", "frames", "frame_rate_hz", "median_error_px", "rejected_share"),
    *("errors", "warnings", "findings", "output", "error"),
)
_TOLD = ("camera_adjusted", "cameras_estimated", "clocks_applied")  # notes that the table has
_NOT_AS_TEXT = ("output", "calibration", "detections", "init", "config")  # content counts, or nothing
_PROGRAM = "from skelsplat.run.batch import _work; _work()"


@dataclass(frozen=True)
class Recording:
    """One recording of a batch."""

    name: str
    status: str  # "done"; "unchanged": refined by an earlier batch, and left as it is; or "failed"
    output: Path  # the folder of its run
    error: str = ""  # why it failed
    report: Mapping[str, Any] = field(default_factory=dict)  # ``report.json`` of its run
    state: Mapping[str, Any] = field(default_factory=dict)  # by which the next batch sees changes

    @property
    def errors(self) -> tuple[str, ...]:
        """Why it failed, or the errors among the findings of its run: no detection could be used."""
        if self.error:
            return (self.error,)
        runs = [self.report, *self.report.get("people", ())]
        found = [finding for run in runs for finding in run["findings"]]
        return tuple(finding["text"] for finding in found if finding["severity"] == "error")

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of the table: one, or one per person; by `COLUMNS`, None where nothing is known."""
        row = dict.fromkeys(COLUMNS) | {"recording": self.name, "status": self.status}
        row |= {"output": None if self.error else str(self.output), "error": self.error or None}
        if not self.report:
            return [row]
        row["frame_rate_hz"] = self.report["input"]["frame_rate_hz"]
        people = self.report.get("people")
        if people is None:
            total, frames = self.report["reprojection_error"]["all"], self.report["input"]["frames"]
            numbers = {"median_error_px": total["after_px"], "rejected_share": total["rejected_share"]}
            people = [{"id": None, "frames": frames, "findings": [], **numbers}]
        return [
            row
            | {name: person[name] for name in ("frames", "median_error_px", "rejected_share")}
            | {"person": person["id"], **_summed_up([*self.report["findings"], *person["findings"]])}
            for person in people
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the recording as JSON values: its rows, and its findings in full."""
        rows, findings = self.rows(), self.report.get("findings", [])
        own = {key: rows[0][key] for key in ("status", "output", "error")}
        return {"name": self.name, **own, "rows": rows, "findings": findings, **self.state}


def _summed_up(findings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the numbers of errors and warnings, and the kinds, also of adjustments, with cameras."""
    told = [one for one in findings if one["severity"] != "note" or one["kind"] in _TOLD]
    errors, warned = (sum(one["severity"] == severity for one in told) for severity in ("error", "warning"))
    texts = []
    for finding in told:
        cameras = ", ".join(finding["subject"].get("cameras", ()))
        texts.append(finding["kind"].replace("_", " ") + (f" ({cameras})" if cameras else ""))
    return {"errors": errors, "warnings": warned, "findings": "; ".join(dict.fromkeys(texts))}


@dataclass(frozen=True)
class Batch:
    """What became of all recordings, in the order given, and of cameras that were adjusted for several."""

    recordings: tuple[Recording, ...]
    sessions: tuple[AdjustedTogether, ...] = ()

    @property
    def failed(self) -> tuple[Recording, ...]:
        """Those that failed."""
        return tuple(one for one in self.recordings if one.status == FAILED)

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of the table, one per recording, or per person of one."""
        return [row for one in self.recordings for row in one.rows()]

    def to_dict(self) -> dict[str, Any]:
        """Return the batch as JSON values."""
        entries = [one.to_dict() for one in self.recordings]
        sessions = [one.to_dict() for one in self.sessions]
        document: dict[str, Any] = plain(
            {"versions": versions(), "sessions": sessions, "recordings": entries}
        )
        return document


def run_batch(
    jobs: Mapping[str, Job],
    folder: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Batch:
    """Refine many recordings, and write ``batch.json`` and ``batch.csv``.

    Recordings of one calibration whose jobs adjust cameras get the same cameras, adjusted by all of them and
    written to ``folder``. A recording that an earlier batch has refined is left as it is if its folder is
    complete and neither its input nor its options have changed. One that fails does not stop the others. The
    results do not depend on the number of processes. A `SkelSplatError` if there are no jobs, two have the
    same output, or ``folder`` holds input or cannot be written.

    Parameters
    ----------
    jobs : mapping of str to Job
        By name. Without ``output``, the results are in the folder of that name in ``folder``.
    folder : path
        For the two files, written after each recording, so that a batch which is stopped goes on.
    overwrite : bool
        Refine every recording again.
    processes : int
        How many recordings are refined at the same time, on the same cores.
    progress : callable, optional
        Called with (recordings done, recordings in all).
    """
    top = Path(folder)
    jobs = {name: replace(job, output=job.output or top / name) for name, job in jobs.items()}
    _check(jobs, processes)
    keep_inputs(jobs.values(), top, (TABLE, RECORD, CAMERAS))
    with output_folder(top), locked(top, ".skelsplat-batch.lock"):
        sessions = tuple(adjust_together(jobs, top, key_of, () if overwrite else _sessions(top / RECORD)))
        _clear(top, {Path(one.output) for one in sessions} | {Path(job.calibration) for job in jobs.values()})
        jobs |= {name: one.of(name, jobs[name]) for one in sessions for name in one.recordings}
        keys = {name: key_of(job) for name, job in jobs.items()}
        earlier = {} if overwrite else _earlier(top / RECORD, keys)
        found: dict[str, Recording] = {}

        def keep() -> None:
            left = [entry for name, entry in earlier.items() if name not in found]  # as their folders are
            _write(top, Batch(tuple(found[name] for name in jobs if name in found), sessions), left)
            if progress is not None:
                progress(len(found), len(jobs))

        for name, entry in earlier.items():
            if _complete(Path(str(jobs[name].output)), entry):
                found[name] = _read(name, jobs[name], keys[name], UNCHANGED)
        keep()
        try:
            for name, error in _refined({n: job for n, job in jobs.items() if n not in found}, processes):
                found[name] = _read(name, jobs[name], keys[name], FAILED if error else DONE, error)
                keep()
        except KeyboardInterrupt as stop:
            done = f"{len(found)} of {len(jobs)} recordings are done"
            raise KeyboardInterrupt(f"{done}: run it again for the others") from stop
    return Batch(tuple(found[name] for name in jobs), sessions)


def _check(jobs: Mapping[str, Job], processes: int) -> None:
    if processes < 1:
        raise InvalidInputError(f"processes: expected at least 1, got {processes}")
    if not jobs:
        raise InvalidInputError("jobs: expected at least one recording, got none")
    places: dict[Path, str] = {}
    for name, job in jobs.items():
        other = places.setdefault(Path(str(job.output)).resolve(), name)
        if other != name:
            got = f"{job.output} for {other} and {name}"
            raise InvalidInputError(f"output: expected a folder of its own for each recording, got {got}")


def key_of(job: Job) -> str:
    """Return a text that differs if the results of a job may; of videos, only size and time count."""
    settings = job.settings.to_dict()
    settings.pop("n_threads")  # the results do not depend on it
    options = {one.name: getattr(job, one.name) for one in fields(job) if one.name not in _NOT_AS_TEXT}
    options |= {"settings": settings, "version": versions()["skelsplat"], "cameras": _cameras(job)}
    found = hashlib.sha256(json.dumps(options, sort_keys=True, default=_text).encode())
    given = (job.detections, job.init, job.layout)
    places = [Path(path) for path in given if isinstance(path, str | os.PathLike)]
    if job.fps is None:
        places.append(Path(job.detections).parent / "videos")
    for place in places:
        inside = sorted(place.rglob("*")) if place.is_dir() else [place]
        for path in (path for path in inside if path.is_file()):
            found.update(f"{path.relative_to(place.parent)}\0".encode())
            if path.suffix.lower() in VIDEO_SUFFIXES:
                found.update(f"{path.stat().st_size} {path.stat().st_mtime_ns}".encode())
                continue
            with opened(path) as stream:
                for part in iter(lambda: stream.read(2**20), b""):
                    found.update(part)
    return found.hexdigest()


def _cameras(job: Job) -> str:
    """Return the cameras as text: a folder that is a calibration may have the results in it as well."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run repeats them
        try:
            given = {name: getattr(job, name) for name in OF_CALIBRATION}
            return to_json(read_rig(Path(job.calibration), **given))
        except SkelSplatError as error:
            return str(error)


def _text(value: object) -> str:
    """Return a path, or what a layout or a filter consists of, as text."""
    return os.fspath(value) if isinstance(value, os.PathLike) else pickle.dumps(value).hex()


def _earlier(path: Path, keys: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return the entries of an earlier batch with the same keys, by name; none if it cannot be read."""
    with suppress(SkelSplatError, AttributeError, KeyError, TypeError):
        entries = load_json(path, "a batch")["recordings"] if path.is_file() else []
        return {entry["name"]: entry for entry in entries if entry.get("key") == keys.get(entry["name"], "")}
    return {}


def _clear(folder: Path, used: Collection[Path]) -> None:
    """Remove cameras that an earlier batch has adjusted, unless they are used."""
    kept = {path.resolve() for path in used}
    for path in folder.glob(f"*{CAMERAS}"):
        if path.resolve() not in kept:
            path.unlink()


def _sessions(path: Path) -> tuple[AdjustedTogether, ...]:
    """Return the sessions of an earlier batch; none if it cannot be read."""
    with suppress(SkelSplatError, AttributeError, KeyError, TypeError):
        entries = load_json(path, "a batch")["sessions"] if path.is_file() else []
        return tuple(map(AdjustedTogether.of_dict, entries))
    return ()


def _complete(folder: Path, entry: Mapping[str, Any]) -> bool:
    """Whether a folder holds the run that a batch has written there, with all its files and no others'."""
    places = [folder, *(folder / name for name in folders_of_run(folder))]
    try:
        if load_json(folder / REPORT, "a report").get(RUN) != entry.get("run"):
            return False
        check_people(folder / REPORT)
        for place in places:
            check_run(place)
    except (DatasetError, AttributeError):  # no object
        return False
    return all((place / name).is_file() for place in places for name in files_of_run(place) or [""])


def _read(name: str, job: Job, key: str, status: str, error: str = "") -> Recording:
    """Return what became of a recording, from the folder of its run."""
    folder = Path(str(job.output))
    if error:
        left = f"; {folder} has the results of an earlier run" if (folder / REPORT).is_file() else ""
        return Recording(name, status, folder, error + left)
    report = load_json(folder / REPORT, "a report")
    return Recording(name, status, folder, report=report, state={"key": key, "run": report[RUN]})


def _write(folder: Path, batch: Batch, left: Sequence[Mapping[str, Any]]) -> None:
    """Write both files; ``left`` are the entries of an earlier batch of recordings still to come."""
    document = batch.to_dict()
    document["recordings"] += left
    atomic_write_text(folder / RECORD, to_text(document))
    rows = ([row[name] for name in COLUMNS] for row in batch.rows())
    atomic_write_text(folder / TABLE, csv_text([COLUMNS, *rows]))


def _refined(jobs: Mapping[str, Job], processes: int) -> Iterator[tuple[str, str]]:
    """Refine recordings, and yield the name of each as it is done, with its error or ""."""
    if processes == 1 or len(jobs) < 2:
        yield from ((name, attempt(job)) for name, job in jobs.items())
        return
    processes = min(processes, len(jobs))
    threads = max(1, (os.cpu_count() or 1) // processes)
    with ThreadPoolExecutor(processes) as pool:
        waiting = {}
        for name, job in jobs.items():
            count = job.settings.n_threads or threads  # the results are the same
            job = replace(job, config=job.settings.replace(n_threads=count))
            waiting[pool.submit(_in_a_process, job)] = name
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def attempt(job: Job) -> str:
    """Do a job, and return why it failed, or ""."""
    try:
        (run if job.people is None else run_people)(job)
    except (SkelSplatError, OSError) as error:
        return " ".join(str(error).split())
    except Exception as error:  # a defect, of which the other recordings know nothing
        return " ".join(f"{type(error).__name__}: {error}".split())
    return ""


def _in_a_process(job: Job) -> str:
    """Do a job in a process of its own, which may end in any way: Python's lock is not shared, nor memory."""
    said: list[str] = []
    status, printed = Child(_PROGRAM, given=pickle.dumps(job), hear=said.append).outcome()
    if status == 0:
        return str(json.loads(printed.splitlines()[-1]))
    last = [line for line in said if line.strip()][-1:]
    return f"its process ended with status {status}" + (f": {last[0].strip()}" if last else "")


def _work() -> None:
    """Do the job on stdin, and print the outcome as a line of JSON."""
    print(json.dumps(attempt(pickle.load(sys.stdin.buffer))), flush=True)


def trials(project: str | os.PathLike[str]) -> dict[str, tuple[Path, Path]]:
    """Find the trials of a Pose2Sim project: by name, the calibration and the folder of detections.

    A trial is a folder with ``pose-sync`` or else ``pose``. Its calibration is the TOML, or else another, in
    the nearest folder with *calib* in its name. A `DatasetError` if there is no trial, or not one calibration
    of it.
    """
    root, found = Path(project), {}
    for place, names, _ in os.walk(root):
        trial = Path(place)
        detections = [trial / name for name in ("pose-sync", "pose") if (trial / name).is_dir()]
        filled = next((folder for folder in detections if any(folder.iterdir())), None)
        names[:] = sorted(name for name in names if not name.startswith((".", "pose")))
        if filled is not None:
            name = "/".join(trial.relative_to(root).parts) or root.resolve().name
            found[name] = (_calibration_of(trial, root), filled)
    if not found:
        raise DatasetError(root, "folder", "trials: folders with a folder pose or pose-sync", "none")
    return found


def _calibration_of(trial: Path, root: Path) -> Path:
    for place in (trial, *trial.parents):
        folders = sorted(path for path in place.iterdir() if path.is_dir() and "calib" in path.name.lower())
        files = [path for folder in folders for path in sorted(folder.glob("*.toml"))]
        files = files or [folder for folder in folders if find_format(folder)]
        if len(files) > 1:
            names = listed([path.name for path in files], 5)
            raise DatasetError(trial, "calibration", "one in the folder of calibrations", names)
        if files:
            return files[0]
        if place == root:
            break
    raise DatasetError(trial, "calibration", "one in a folder calibration, here or above", "none")
