"""A run of one person or of several, how it was asked for, and two of them side by side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from skelsplat.exceptions import SkelSplatError
from skelsplat.findings import Finding
from skelsplat.io._run_files import folders_of_run, is_run
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.run import tables
from skelsplat.run._run import PeopleRun, Run

AnyRun: TypeAlias = "Run | PeopleRun"
_STATED = ("unit", "layout", "person", "sequence", "order", "mapping", "adjust_cameras", "move")


def open_run(folder: Path) -> AnyRun | None:
    """Return the run in a folder; None if there is none that is whole."""
    if not is_run(folder):
        return None
    try:
        return PeopleRun.open(folder) if folders_of_run(folder) else Run.open(folder)
    except (SkelSplatError, OSError):
        return None


def options_of(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the `skelsplat.run.Job` that a report states, but for files and the method."""
    made = report["input"]
    found = {name: made.get(name) for name in _STATED}
    found["offsets"] = {camera: frames for camera, frames in made.get("offsets", {}).items() if frames}
    found["without"] = tuple(made.get("without", ()))
    found["frames"] = made.get("frame_mode")
    found["fps"] = made.get("frame_rates_hz") or made.get("frame_rate_hz")
    if "people" in report:
        found |= {"people": made["people"], "person": None}
    # files of several people are listed by the report of each
    names = [name.partition(".")[2] for name in report["files"] if name.startswith("pose.")]
    found["write"] = tuple(kind for kind in names if kind in POSE_FORMATS and kind != "npz")
    return {name: value for name, value in found.items() if value not in (None, "", False, (), {})}


def findings_of(run: AnyRun) -> list[tuple[str, Finding]]:
    """Return the findings, errors first, each after whom of several people it is on."""
    found = [("", one) for one in run.findings]
    for identity, person in run.people.items() if isinstance(run, PeopleRun) else ():
        found += [(f"Person {identity}: ", one) for one in person.findings]
    return sorted(found, key=lambda one: ("error", "warning", "note").index(one[1].severity))


def numbers_of(run: AnyRun) -> dict[str, str]:
    """Return the key numbers by name."""
    found = tables.numbers_of_people(run) if isinstance(run, PeopleRun) else tables.key_numbers(run)
    return {name: value for name, value, _ in found}


def compared(before: AnyRun, after: AnyRun) -> list[tuple[str, str, str]]:
    """Return what tells which of two runs is better, before and after: key numbers, warnings, errors."""
    old, new = _to_compare(before), _to_compare(after)
    return [(name, old.get(name, "–"), new.get(name, "–")) for name in {**old, **new}]


def _to_compare(run: AnyRun) -> dict[str, str]:
    rows = tables.of_people(run) if isinstance(run, PeopleRun) else tables.of_cameras(run)
    place = next(k for k, (head, _) in enumerate(rows.columns) if head in ("error [px]", "median [px]"))
    errors = {f"{row[0]}, error": f"{row[place]} px" for row in rows.rows}
    warnings = sum(one.severity != "note" for _, one in findings_of(run))
    return {**numbers_of(run), "warnings": str(warnings), **errors}
