"""What a run of several people prints: a table of the people, then the findings on each."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from rich.console import Console
from rich.table import Table

from skelsplat._words import length, number
from skelsplat.cli.findings import print_findings
from skelsplat.cli.table import new_table, print_paragraphs, print_table
from skelsplat.findings import Finding
from skelsplat.run import PeopleRun

_LEGEND = (
    "seen: frames in which a view sees the person; views: median per frame; error: median reprojection "
    "error; bar: median error bar, one standard deviation per axis; limbs: range of the lengths of arms and "
    "legs frame by frame, 5th to 95th percentile"
)


def print_people(console: Console, run: PeopleRun, told: Collection[Finding] = ()) -> None:
    """Print the table of people, the warnings on everybody not ``told``, and the findings on each person."""
    print_table(console, _people(run))
    console.print(_LEGEND, style="dim")
    console.print()
    note = run.report["note"]
    print_paragraphs(console, [note] if note else [])
    print_findings(console, [one for one in run.findings if one.severity == "warning" and one not in told])
    for identity, person in run.people.items():
        own = [one for one in person.findings if one.severity != "note"]
        print_findings(console, own, f"person {identity}: ")


def _people(run: PeopleRun) -> Table:
    cameras = len(next(iter(run.people.values())).cameras)
    columns = ["frames", "seen", f"views\nof {cameras}", "error\n[px]", "bar\n[mm]", "rejected", "limbs"]
    title = "1 person" if len(run.people) == 1 else f"{len(run.people)} people"
    table = new_table(title, "person", columns)
    for entry in run.report["people"]:
        table.add_row(*_cells(entry))
    return table


def _cells(entry: dict[str, Any]) -> list[str]:
    seen = sum(last - first + 1 for first, last in entry["seen"])
    return [
        str(entry["id"]),
        f"{entry['first_frame']}–{entry['last_frame']}",
        str(seen),
        f"{entry['views_median']:g}",
        number(_known(entry["median_error_px"])),
        length(_known(entry["error_bar_median_mm"])),
        _percent(entry["rejected_share"]),
        _percent(entry["limb_range"]),
    ]


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f}%"
