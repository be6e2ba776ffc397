"""Tables on the console, none of which breaks a name; and what a run prints, at most 80 columns wide."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from skelsplat._escape import escaped
from skelsplat._words import Table as Cells
from skelsplat._words import listed, number
from skelsplat.cli.output import print_findings
from skelsplat.findings import Finding
from skelsplat.run import PeopleRun, Run, tables
from skelsplat.run.folder import left_of_earlier
from skelsplat.run.report import solved_in_words, thinned_in_words
from skelsplat.run.solve import default_threads
from skelsplat.run.summary import finite_median, is_biased

_MOST_JOINTS = 5
# heads of the columns that fit
_ADJUSTED = ("status", "turned by [°]", "moved by [mm]", "focal [%]", "clock [frames]", "error [px]")
_CAMERAS = ("median [px]", "90th percentile [px]", "used", "missing", "rejected", "weight")
_JOINTS = ("median [px]", "missing", "rejected", "error bar [mm]", "moved [mm]")
_PEOPLE = ("frames", "seen", "views", "error [px]", "rejected", "error bar [mm]", "limbs")
_REASONS = {"max_steps": "at the step limit", "no_observations": "without detections"}


def new_table(title: str | None, first: str, columns: Sequence[str] = ()) -> Table:
    """Return a table of names, headed `first`, with these columns of numbers; a head may have two lines."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column(first)
    for name in columns:
        table.add_column(Text(name), justify="right")
    return table


def print_table(console: Console, table: Table) -> None:
    """Print a table without breaking words, or names in its first column; wider than the console if needed.

    A first column that folds is broken between words. The title may be wider than the table.
    """
    own = console.width
    console.width = max(own, _least_width(console, table))
    if table.title:
        console.print(table.title, style="table.title")
        table.title = None
    console.print(table, crop=False)
    console.width = own


def print_parts(console: Console, table: Table) -> None:
    """Print a table in the fewest parts that fit, each with the first column."""
    names, *others = table.columns
    parts: list[Table] = []
    for count in range(1, len(others) + 1):
        most = -(-len(others) // count)
        parts = [copy(table) for _ in range(0, len(others), most)]
        for k, part in enumerate(parts):
            part.columns = [copy(one) for one in (names, *others[k * most : (k + 1) * most])]
            part.title = None if k else table.title
        if all(_least_width(console, part) <= console.width for part in parts):
            break
    for part in parts:
        print_table(console, part)


def _least_width(console: Console, table: Table) -> int:
    """Set the columns' widths so that no word breaks, nor a name in the first column; return the least sum.

    What the console has beyond that goes to the columns that want more, in proportion to how much.
    """
    own, first = console.width, table.columns[0]
    console.width = 10_000  # to measure what it would take
    wanted = []
    for column in table.columns:
        words = [console.measure(cell) for cell in (column.header, *column.cells)]
        column.no_wrap = whole = column.no_wrap or (column is first and first.overflow != "fold")
        most = max(size.maximum for size in words)
        column.min_width = most if whole else max(size.minimum for size in words)
        wanted.append(most - column.min_width)
    size = console.measure(table)
    console.width = own
    if size.maximum > own:  # rich itself would take from all columns alike, and go beyond the width
        share = max(0, own - size.minimum) / max(1, sum(wanted))
        for column, more in zip(table.columns, wanted, strict=True):
            column.width = (column.min_width or 0) + int(share * more)
    return size.minimum


def print_run(console: Console, run: Run, told: Collection[Finding] = ()) -> None:
    """Print the table of cameras, the lines on the run, the least certain joints, warnings not ``told``."""
    left_out = ["left out"] if run.statistics.total["left_out"] else []
    print_adjusted(console, run.report.get("cameras_adjusted", ()))
    print_rows(console, tables.of_cameras(run), [*_CAMERAS, *left_out], explained=[*_CAMERAS[3:], *left_out])
    for line in _lines(run):
        console.print(line)
    joints = replace(tables.of_joints(run), title="Joints with the largest error bars")
    print_rows(console, joints, _JOINTS, explained=_JOINTS[-2:], some=_least_certain(run))
    _print_note_and_warnings(console, run, told)
    gaps = run.report["over_time"]["gaps"]
    if gaps is not None and not gaps["filled"]:
        most = f"none of at most {gaps['max_frames']} frames lies between known positions"
        print_paragraphs(console, [f"No gaps were filled: {most}."])
    print_paragraphs(console, run.poses.processing)


def print_adjusted(console: Console, cameras: Sequence[Mapping[str, Any]]) -> None:
    """Print the table of cameras before and after they were adjusted, if there are any."""
    print_rows(console, tables.of_adjusted({"cameras_adjusted": cameras}), _ADJUSTED)


def print_rows(
    console: Console,
    rows: Cells,
    heads: Collection[str],
    *,
    explained: Collection[str] = (),
    some: Sequence[int] | None = None,
) -> None:
    """Print the columns with these heads of a table, if it has rows, then what ``explained`` ones mean.

    ``some`` are the places of the rows to print; None: all.
    """
    if not rows.rows:
        return
    shown = [k for k, (head, _) in enumerate(rows.columns) if head in heads]
    columns = [rows.columns[k] for k in shown]
    table = new_table(rows.title, rows.columns[0][0], [head.replace(" [", "\n[") for head, _ in columns])
    chosen = [*rows.rows] if some is None else [rows.rows[k] for k in some]
    for row in chosen:
        table.add_row(row[0], *(row[k] for k in shown), end_section=row is chosen[-1])
    if rows.total:
        table.add_row(rows.total[0], *(rows.total[k] for k in shown), style="bold")
    for column in table.columns:
        column.no_wrap = True
    print_table(console, table)
    words = "; ".join(
        f"{head.partition(' [')[0]}: {meaning}" for head, meaning in columns if head in explained
    )
    if words:
        console.print(words, style="dim")
        console.print()


def print_paragraphs(console: Console, texts: Sequence[str]) -> None:
    """Print sentences, each on lines of its own, and an empty line if there are any."""
    for text in texts:
        console.print(text)
    if texts:
        console.print()


def _print_note_and_warnings(console: Console, run: Run | PeopleRun, told: Collection[Finding]) -> None:
    numbers = tables.key_numbers(run) if isinstance(run, Run) else tables.numbers_of_people(run)
    risen = [
        f"{name.capitalize()}: {value} ({why})." for name, value, why in numbers if why == tables.WHY_RISEN
    ]
    print_paragraphs(console, [*risen, *filter(None, [run.report["note"]])])
    warnings = [one for one in run.findings if one.severity == "warning" and one not in told]
    print_findings(warnings, console)
    if warnings:
        console.print()


def print_files(console: Console, folder: Path, names: Sequence[str]) -> None:
    """Print where the results are, and what next to them belongs to an earlier run."""
    console.print(Text.assemble("Wrote to ", (escaped(f"{folder}/"), "bold"), f": {', '.join(names)}"))
    left = left_of_earlier(folder)
    if left:
        console.print(f"! {escaped(listed(left))} {'is' if len(left) == 1 else 'are'} from an earlier run")


def _lines(run: Run) -> Iterator[str]:
    """Yield what the run did and its results, a sentence or two per line."""
    outcome, statistics = run.outcome, run.statistics
    frames, joints = len(run.inputs.in_all), run.layout.n_joints
    threads = default_threads(outcome.config)
    each = 1000 * outcome.seconds / frames
    reasons = ", ".join(f"{n} {_REASONS.get(why, why)}" for why, n in statistics.stop_reasons.items())
    cores = f"{threads} thread{'s' * (threads != 1)}"
    yield f"{frames} frames of {joints} joints, solved in {each:.{2 if each < 1 else 1}f} ms each ({cores})."
    yield from solved_in_words(run.report)
    yield from thinned_in_words(run.inputs)
    yield f"Frames stopped: {reasons}."
    digits = statistics.decimals
    moved = number(finite_median(statistics.moved_mm), digits)
    yield f"Median distance of the joints from the {outcome.start_name}: {moved} mm."
    noise = f"{number(statistics.noise_mm, digits)} mm across the ray, {number(statistics.noise_px)} px"
    yield f"Estimated noise of the detections: {noise}."
    swapped = ", ".join(f"{one['name']} {one['swapped']}" for one in statistics.cameras if one["swapped"])
    if swapped:
        yield f"Left–right swaps were corrected in {statistics.total['swapped']} detections: {swapped}."
    yield ""
    bar = number(finite_median(statistics.error_bar_mm), digits)
    scatter = number(finite_median(statistics.scatter_mm), digits)
    rest = ". They include no bias of the detector (--joint-bias-mm states one)."
    if is_biased(run.result):
        others = "the detector's bias" + (" and the cameras' errors" if run.inputs.rig.joint_sigma else "")
        rest = f" (against anatomical joints); scatter {scatter} mm; the rest is {others}, in quadrature."
    yield from wrap(f"Error bars, one standard deviation per axis: median {bar} mm{rest}", 80)


def _least_certain(run: Run) -> list[int]:
    """Return the joints with the largest median error bars, without those that the files lack."""
    bars = np.array([finite_median(bar) for bar in run.statistics.error_bar_mm.T])
    order = np.argsort(np.where(np.isfinite(bars), -bars, -np.inf), kind="stable")
    names, lacking = run.layout.joints, run.inputs.lacking
    return [int(j) for j in order if names[j] not in lacking][:_MOST_JOINTS]


def print_people(console: Console, run: PeopleRun, told: Collection[Finding] = ()) -> None:
    """Print the table of people, the warnings on everybody not ``told``, and the findings on each person."""
    print_adjusted(console, run.report.get("cameras_adjusted", ()))
    print_rows(console, tables.of_people(run), _PEOPLE, explained=_PEOPLE[1:])
    _print_note_and_warnings(console, run, told)
    for identity, person in run.people.items():
        own = [one for one in person.findings if one.severity != "note"]
        print_findings(own, console, f"person {identity}: ")
        if own:
            console.print()
