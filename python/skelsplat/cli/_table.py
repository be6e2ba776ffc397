"""What a run prints: a table for people, at most 80 columns wide."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table
from rich.text import Text

from skelsplat.cli._pipeline import default_threads
from skelsplat.cli._statistics import POOR_SHARE, finite_median

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from rich.console import Console

    from skelsplat.cli._job import Job
    from skelsplat.cli._pipeline import Inputs, Outcome
    from skelsplat.cli._statistics import Group, Statistics

_MOST_JOINTS = 8
_REASONS = {
    "converged": "converged",
    "max_steps": "at the step limit",
    "no_observations": "without detections",
    "diverged": "diverged",
}


def print_summary(
    console: Console, job: Job, inputs: Inputs, outcome: Outcome, statistics: Statistics
) -> None:
    """Print the table of cameras, the line on the run and the joints to distrust."""
    console.print(_cameras(statistics))
    console.print(_poor_limit(statistics), style="dim")
    console.print()
    console.print(_run_line(inputs, outcome, statistics))
    console.print(_moved_line(job, statistics))
    console.print()
    _print_joints(console, statistics)
    if job.note:
        console.print(job.note)
        console.print()


def print_doubts(console: Console, doubts: Sequence[str]) -> None:
    """Print what a person should look at, a paragraph each."""
    for doubt in doubts:
        console.print(f"! {doubt}")
    if doubts:
        console.print()


def print_files(console: Console, folder: Path, names: Sequence[str]) -> None:
    """Print where the results are."""
    console.print(Text.assemble("Wrote to ", (f"{folder}/", "bold"), f": {', '.join(names)}"))


def _cameras(statistics: Statistics) -> Table:
    table = Table(
        title="Reprojection error before → after [px], and detections",
        title_justify="left",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("camera")
    for name in ("median", "90th percentile", "used", "missing", "poor"):
        table.add_column(name, justify="right")
    left_out = statistics.total.left_out > 0
    if left_out:
        table.add_column("left out", justify="right")
    for group in statistics.cameras:
        table.add_row(*_cells(group, left_out), end_section=group is statistics.cameras[-1])
    table.add_row(*_cells(statistics.total, left_out), style="bold")
    return table


def _cells(group: Group, left_out: bool) -> list[str]:
    median = f"{_number(group.before_px)} → {_number(group.after_px)}"
    p90 = f"{_number(group.p90_before_px)} → {_number(group.p90_after_px)}"
    cells = [group.name, median, p90]
    cells += [str(group.used), str(group.missing), str(group.poor)]
    return [*cells, str(group.left_out)] if left_out else cells


def _number(value: float, digits: int = 1) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _poor_limit(statistics: Statistics) -> str:
    limits = sorted({round(float(limit)) for limit in statistics.poor_px})
    pixels = f"{limits[0]}" if len(limits) == 1 else f"{limits[0]} to {limits[-1]}"
    share = f"{100 * POOR_SHARE:g} % of the image's diagonal"
    return f"poor: more than {pixels} px ({share}) from the refined pose"


def _run_line(inputs: Inputs, outcome: Outcome, statistics: Statistics) -> str:
    frames, joints = len(inputs.frames), inputs.layout.n_joints
    threads = default_threads(outcome.config)
    each = 1000 * outcome.seconds / frames
    reasons = _listed(f"{n} {_REASONS.get(reason, reason)}" for reason, n in statistics.stop_reasons.items())
    cores = f"{threads} thread{'s' * (threads != 1)}"
    return (
        f"{frames} frames of {joints} joints, {each:.1f} ms per frame (refinement alone, {cores}).\n"
        f"Frames stopped: {reasons}."
    )


def _moved_line(job: Job, statistics: Statistics) -> str:
    start = "triangulated start" if job.init is None else f"start in {job.init}"
    return f"The median joint moved {_number(finite_median(statistics.moved_mm))} mm from the {start}."


def _print_joints(console: Console, statistics: Statistics) -> None:
    doubtful = [group for group in statistics.joints if group.missing + group.poor + group.left_out]
    doubtful.sort(key=lambda group: group.missing + group.poor + group.left_out, reverse=True)
    if not doubtful:
        console.print("No joint has missing or poor detections.")
    else:
        console.print(f"Joints with most missing or poor detections ({_hidden(len(doubtful))}):")
        table = Table(box=None, padding=(0, 3, 0, 0), show_header=False)
        for group in doubtful[:_MOST_JOINTS]:
            out = f"{group.left_out} left out" if group.left_out else ""
            total = f"of {group.used + group.missing + group.left_out}"
            table.add_row(f"  {group.name}", f"{group.missing} missing", f"{group.poor} poor", out, total)
        console.print(table)
    console.print()


def _hidden(count: int) -> str:
    return f"first {_MOST_JOINTS} of {count}" if count > _MOST_JOINTS else f"{count} in all"


def _listed(parts: Iterable[str]) -> str:
    return ", ".join(parts)
