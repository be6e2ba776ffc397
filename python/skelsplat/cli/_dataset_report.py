"""What ``skelsplat datasets`` prints: for people at most 80 columns wide, for programs as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from skelsplat import DatasetError
    from skelsplat.datasets import Dataset, Report
    from skelsplat.findings import Finding

_MOST_FILES = 12


def print_list(console: Console, entries: Sequence[dict[str, Any]]) -> None:
    """Print the data sets, what they are and their options."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("data set", style="bold", no_wrap=True)
    table.add_column("what it is, and the options of its reader")
    for entry in entries:
        table.add_row(entry["name"], f"{entry['description']}\n{', '.join(entry['options'])}")
    console.print(table)


def print_report(console: Console, report: Report) -> None:
    """Print what `datasets.check` found."""
    layout = f", format {report.survey.format}" if report.survey.format else ""
    console.print(Text.assemble((report.name, "bold"), f" in {report.root}{layout}"))
    _print_files(console, report)
    if report.dataset is not None:
        _print_dataset(console, report.dataset)
        _print_errors(console, report)
    if report.error is not None:
        _print_error(console, report.error)
    for finding in report.findings:
        _print_finding(console, finding)
    console.print(_verdict(report), style="green" if report.ok else "red")


def _print_files(console: Console, report: Report) -> None:
    there, missing = report.survey.there, report.survey.missing
    console.print(f"{len(there)} files and folders are there, {len(missing)} missing.")
    for path, what in missing[:_MOST_FILES]:
        console.print(f"  missing: {what}, expected at", style="yellow")
        console.print(f"    {path}", style="yellow", soft_wrap=True)
    if len(missing) > _MOST_FILES:
        console.print(f"  … and {len(missing) - _MOST_FILES} more (--json lists all)", style="yellow")


def _print_dataset(console: Console, dataset: Dataset) -> None:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("subject", "takes", "frames", "views", "joints", "detected", "truth"):
        table.add_column(name, justify="left" if name == "subject" else "right")
    for subject in dict.fromkeys(take.subject for take in dataset):
        takes = [take for take in dataset if take.subject == subject]
        views = sorted({len(take.rig) for take in takes})
        table.add_row(
            subject,
            str(len(takes)),
            str(sum(map(len, takes))),
            "–".join(map(str, views[:: max(1, len(views) - 1)])),
            str(dataset.layout.n_joints),
            _percent([take.detected for take in takes]),
            _percent([take.labelled for take in takes]),
        )
    console.print(table)
    console.print(f"{dataset.source}.")
    for note in dataset.notes:
        console.print(f"Note: {note}.")


def _percent(shares: Sequence[float | None]) -> str:
    known = [share for share in shares if share is not None]
    return f"{100 * sum(known) / len(known):.1f} %" if known else "–"


def _print_errors(console: Console, report: Report) -> None:
    """Print the reprojection errors per camera."""
    rows = [row for row in report.errors if math.isfinite(row.as_given)]
    if not rows:
        console.print("No detections: units and cameras are judged by the truth alone.")
        return
    table = Table(
        title="Truth projected onto the detections, median error [px]",
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    table.add_column("camera")
    for name in ("as given", "left/right exchanged", "best other camera"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            row.camera,
            *(_pixels(value) for value in (row.as_given, row.sides_exchanged, row.best_other_camera)),
        )
    console.print(table)


def _pixels(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "–"


def _print_finding(console: Console, finding: Finding) -> None:
    mark, style = ("✗", "red") if finding.severity == "error" else ("!", "yellow")
    console.print(f"{mark} {finding.text}", style=style)
    console.print(f"  {', '.join(finding.subject.files)}", style="dim", soft_wrap=True)


def _print_error(console: Console, error: DatasetError) -> None:
    words = " ".join(f"{error.field}: expected {error.expected}, got {error.actual}".split())
    console.print(f"✗ cannot be read: {words}", style="red")
    console.print(f"  {error.path}", style="dim", soft_wrap=True)


def _verdict(report: Report) -> str:
    if report.ok:
        count = len(report.findings)
        warnings = f", with {count} warning{'s' * (count > 1)}" if count else ""
        return f"All there and usable{warnings}."
    if report.error is not None or any(finding.severity == "error" for finding in report.findings):
        return "These data cannot be used as they are."
    return "Something is missing; what is there can be used."
