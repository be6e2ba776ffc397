"""The files in the folder of a run by name, and how such a folder is told from any other."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import load_npz
from skelsplat.io._files import head, json_document, load_json

POSES, CAMERAS, DETECTIONS, REPORT = "pose.npz", "cameras.json", "detections.npz", "report.json"
LAYOUT = "layout.toml"
"""The layout of a run, if it is not a built-in one."""
UNFINISHED = "unfinished"
"""Key of a report whose run still writes its files, or was stopped there."""

RUN, MARKED = "run", (POSES, CAMERAS, DETECTIONS, LAYOUT)
"""Key in a report of what tells runs apart, and the files that have it, too; earlier versions wrote none."""


def is_run(folder: Path) -> bool:
    """Say whether a run wrote into this folder, whole or not, by how its report begins: with the versions."""
    start = head(folder / REPORT)[:1024]
    return '"versions"' in start and '"skelsplat"' in start


def files_of_run(folder: Path) -> list[str] | None:
    """Return the names of the files that the run which wrote into this folder lists; None without one."""
    return _listed(folder, "files")


def folders_of_run(folder: Path) -> list[str]:
    """Return the names of the people's folders that a run of several people lists."""
    return [name for name in _listed(folder, "folders") or [] if is_person(name)]


def _listed(folder: Path, key: str) -> list[str] | None:
    """Return the names under a key of a run's report; None without a run."""
    if not is_run(folder):
        return None
    try:
        report = json_document(folder / REPORT, "a report")
        if "skelsplat" not in report["versions"] or "settings" not in report:
            return None
        return report[key].names()
    except DatasetError:
        return None


def is_person(name: str) -> bool:
    """Whether a folder has the name of one person's, ``person_0``."""
    return re.fullmatch(r"person_\d+", name) is not None


def mark(run: str) -> str:
    """Return the text that says in the cameras and the layout which run they are of."""
    return f"run {run}"


def of_person(run: str, folder: str) -> str:
    """Return the run of one person in a run of several, whose folder is ``person_0``."""
    return f"{run}_{folder}"


def check_run(folder: Path) -> None:
    """Raise `DatasetError` if the run that wrote into a folder was stopped, or files there are of another."""
    if is_run(folder):
        check_finished(folder / REPORT, load_json(folder / REPORT, "the report of a run"))
        there = (folder / name for name in MARKED)
        check_one_run(folder / REPORT, (path for path in there if path.is_file()))


def check_finished(path: Path, report: Any) -> None:
    """Raise `DatasetError` if a report, as its file holds it, is of a run that was stopped while it wrote."""
    if isinstance(report, dict) and report.get(UNFINISHED):
        expected = "the report of a run that has written all its files"
        raise DatasetError(path, UNFINISHED, expected, "one that was stopped while it wrote: run it again")


def check_one_run(report: Path, files: Iterable[Path]) -> None:
    """Raise `DatasetError`, which names both, if a file is of another run than a report."""
    run = _run_of(report)
    for path in files:
        _check(path, run, report)


def check_people(report: Path) -> None:
    """Raise `DatasetError` if the report in a folder of a run of several people is not that person's."""
    run = _run_of(report)
    for name in folders_of_run(report.parent):
        _check(report.parent / name / REPORT, None if run is None else of_person(run, name), report)


def _check(path: Path, run: str | None, report: Path) -> None:
    found = _run_of(path)
    if found != run:
        actual = f"{found or 'none'}: files of two runs or people are mixed, run it again"
        raise DatasetError(path, RUN, f"{run or 'none'}, as in {report}", actual)


def run_in(folder: Path) -> str:
    """Return what tells the run in a folder apart; nothing of earlier versions."""
    return _run_of(folder / REPORT) or ""


def _run_of(path: Path) -> str | None:
    """Return the run that a file is of; None if it is not marked."""
    if path.suffix == ".npz":
        return next((str(run) for run in load_npz(path, (RUN,)).found.values()), None)
    if path.suffix == ".json":
        document = json_document(path, "a file of a run")
        if path.name != CAMERAS:
            return document.value.get(RUN) if RUN in document else None
        text = str(document["note"].value)
    else:
        text = head(path).partition("\n")[0].removeprefix("# ")
    return text.removeprefix(mark("")) if text.startswith(mark("")) else None
