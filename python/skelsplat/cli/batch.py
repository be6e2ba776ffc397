"""``skelsplat batch``: many recordings, each as ``skelsplat refine`` does it, and one table of them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from os import cpu_count
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from skelsplat._budget import read_toml
from skelsplat._words import number
from skelsplat.cli import options
from skelsplat.cli._app import FAILED
from skelsplat.cli.command import Answer, Command, answers, takes
from skelsplat.cli.config import MisfitError, entries_of, options_in, source_of, unknown
from skelsplat.cli.output import print_findings, print_message, print_text, progress
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_adjusted, print_table
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.run import Batch, Job, run_batch
from skelsplat.run.batch import DONE, RECORD, TABLE, UNCHANGED, trials
from skelsplat.run.batch import FAILED as FAILED_RECORDING
from skelsplat.run.found import Found, output_of

_EPILOG = (
    "SESSIONS.toml has a table session per recording, with calibration, detections, optionally name and "
    "output, and any option of refine; a table defaults has what all share. In a project of Pose2Sim, a "
    "recording is a folder with pose-sync or else pose; its calibration is in a folder with calib in its "
    "name, there or above. FOLDER/NAME has the results of a recording; batch.csv and batch.json the table. "
    "Exit status 1 if a recording failed, or none of its detections could be used."
)
# The last part of a path of detections that names no recording.
_USUAL = ("pose", "pose-sync", "pose-associated", "openpose", "detections", "pose-2d")

OPTIONS = (
    *rows("SESSIONS  TOML file with the recordings, or the folder of a Pose2Sim project."),
    *options.JOB[2:],
    *rows(
        """
        Computation:
        * --jobs N  Recordings refined at the same time, each in a process of its own. [one per core]
        Output:
        * --overwrite  Also refine recordings that have not changed.
        """
    ),
)

_program = typer.Typer(add_completion=False)
_program.command("refine", cls=Command)(takes(*options.JOB)(options.job_of))
_refine: Any = typer.main.get_command(_program)
typed_for_refine: Callable[[str], str] = _refine.worded
"""Return a sentence of the package with its keywords typed as options of refine."""


@answers(*OPTIONS, short=True, epilog=_EPILOG)
def batch(
    context: typer.Context,
    sessions: Path,
    *,
    output: Path,
    jobs: int | None = None,
    overwrite: bool,
    **_of_jobs: Any,
) -> Answer:
    """Refine many recordings, listed in a file or in the folders of a Pose2Sim project.

    A recording is skipped if its results are complete and neither its files nor
    its options have changed, so a batch that was stopped continues.

    [bold]Examples[/bold]

    skelsplat batch sessions.toml -o results --write trc,c3d --jobs 1

    skelsplat batch Project/ -o results --unit m --layout halpe26 --people all
    """
    names = [row.name for row in options.JOB[2:] if row.name != "output"]
    usual, stated = (
        {name: context.params[name] for name in names if source_of(context, name) == source}
        for source in ("DEFAULT_MAP", "COMMANDLINE")
    )
    wanted = {
        name: _job(sessions, name, {**usual, **values, **stated}) for name, values in _recordings(sessions)
    }
    with progress("recordings") as count:
        found = run_batch(
            wanted,
            output,
            overwrite=overwrite,
            processes=jobs or cpu_count() or 1,
            progress=lambda done, total: count("refining", done, total),
        )
    told = [(one.name, text) for one in found.recordings for text in one.errors]
    errors = [f"error: {name}: {typed_for_refine(text)}" for name, text in told]
    for text in errors:
        print_message(text)
    return Answer(found.to_dict(), partial(_print, found, output), status=FAILED if errors else 0)


def _recordings(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name and the options of each recording of a project, or of each session of a file."""
    if path.is_dir():
        for name, (calibration, detections) in trials(path).items():
            yield name, {"calibration": calibration, "detections": detections}
        return
    document = read_toml(path)
    try:
        yield from _sessions(document, path.parent)
    except MisfitError as misfit:
        raise typer.BadParameter(str(DatasetError(path, *misfit.args)), param_hint="SESSIONS") from misfit


def _sessions(document: dict[str, Any], folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    known = entries_of(_refine)
    for key in document:
        if key not in ("defaults", "session"):
            raise unknown(key, "[defaults] or [[session]]", ["defaults", "session"])
    tables, shared = document.get("session"), document.get("defaults", {})
    if not isinstance(shared, dict):
        raise MisfitError("defaults", "a table [defaults] of options", "something else")
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise MisfitError("session", "a table [[session]] per recording", "something else")
    defaults, names = options_in(shared, known, folder, "defaults."), set()
    for place, table in enumerate(tables, 1):
        prefix, options_of = f"session {place}.", {k: v for k, v in table.items() if k != "name"}
        values = defaults | options_in(options_of, known, folder, prefix)
        for argument in ("calibration", "detections"):
            if argument not in values:
                expected = f"a path in [[session]] {place} or in [defaults]"
                raise MisfitError(prefix + argument, expected, "none")
        name = table.get("name", _named_by(values["detections"], folder))
        if not isinstance(name, str) or not name or Path(name).is_absolute() or ".." in Path(name).parts:
            raise MisfitError(f"{prefix}name", "text that can be the name of a folder", repr(name))
        if name in names:
            raise MisfitError(f"{prefix}name", "a name of its own for each session", f"{name} twice")
        names.add(name)
        yield name, values


def _named_by(detections: Path, folder: Path) -> str:
    """Return the name of a recording: the path of its detections from the file's folder, without ``pose``."""
    path = Path(os.path.relpath(detections, folder))
    parts = [part for part in path.with_suffix("").parts if part != ".."]
    if len(parts) > 1 and parts[-1].lower() in _USUAL:
        parts.pop()
    return "/".join(parts)


def _job(sessions: Path, name: str, values: Mapping[str, Any]) -> Job:
    """Return the job of a recording, whose options are checked as those of the command line."""
    try:
        job = job_of([], {"output": Path(), **values})
    except InvalidInputError as error:
        raise typer.BadParameter(f"{sessions}: {name}: {error}", param_hint="SESSIONS") from error
    return replace(job, output=None) if job.output == Path() else job


def sessions_of(folder: Path, recordings: Sequence[Found], given: Mapping[str, Any]) -> str:
    """Return a file of sessions: recordings in folders of one, and the texts of settings for all."""
    shared = [(row.flag[2:], given[row.name]) for row in options.JOB if row.name in given]
    lines = ["[defaults]", *(f"{key} = {json.dumps(value)}" for key, value in shared)]
    for one in recordings:
        name = one.folder.relative_to(folder).as_posix()
        files = {"calibration": one.calibration, "detections": one.detections}
        lines += ["", "[[session]]", f"name = {json.dumps(name)}"]  # texts of JSON are texts of TOML
        files["output"] = output_of(one.folder)
        lines += [f"{key} = {json.dumps(f'{name}/{path}')}" for key, path in files.items()]
    return "\n".join([*lines, ""])


def job_of(words: Sequence[str], usual: Mapping[str, Any] | None = None) -> Job:
    """Return the job of the words after ``skelsplat refine``; an error of usage is an `InvalidInputError`."""
    try:
        job: Job = _refine.main([*words], prog_name="refine", standalone_mode=False, default_map=usual)
    except Exception as error:
        if not hasattr(error, "format_message"):  # what every error of usage has
            raise
        text = error.format_message().replace("Invalid value for ", "", 1).replace("'", "", 2)
        raise InvalidInputError(text) from error
    return job


def _print(found: Batch, folder: Path, console: Console) -> None:
    table = new_table(None, "recording", ["frames", "error\n[px]", "rejected"])
    table.add_column("findings")
    for row in found.rows():
        person = "" if row["person"] is None else f", person {row['person']}"
        told = row["findings"] if row["status"] != FAILED_RECORDING else "failed"
        share = row["rejected_share"]
        table.add_row(
            row["recording"] + person,
            "–" if row["frames"] is None else str(row["frames"]),
            "–" if row["median_error_px"] is None else number(row["median_error_px"]),
            "–" if share is None else f"{100 * share:.0f}%",
            told or "none",
            style="red" if row["status"] == FAILED_RECORDING or row["errors"] else None,
        )
    print_table(console, table)
    console.print()
    for session in found.sessions:
        names = f"{len(session.offsets)} recordings of {session.calibration}"
        print_text(console, f"{session.output}: adjusted by {names}:")
        print_adjusted(console, session.cameras)
        print_findings(session.findings, console)
    count = {status: sum(one.status == status for one in found.recordings) for status in (DONE, UNCHANGED)}
    total = len(found.recordings)
    words = f"{total} recording{'s' * (total != 1)}: {count[DONE]} refined"
    if count[UNCHANGED]:
        words += f", {count[UNCHANGED]} unchanged (--overwrite refines them again)"
    if found.failed:
        words += f", {len(found.failed)} failed"
    console.print(f"{words}.")
    folders = ", and a folder per refined recording" if any(count.values()) else ""
    console.print(f"Wrote to {folder}/: {TABLE}, {RECORD}{folders}")
