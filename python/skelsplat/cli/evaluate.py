"""``skelsplat evaluate`` and ``ablate``: methods on data with ground truth, and the paper's ablations."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.progress import TimeElapsedColumn
from rich.text import Text

from skelsplat import datasets
from skelsplat._escape import escaped
from skelsplat.cli import options
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.datasets import INIT_SIGMA, LENS, SETTINGS, reader_options
from skelsplat.cli.output import progress, tell
from skelsplat.cli.rows import NAME_OR_PATH, choice, one_of, rows
from skelsplat.cli.table import new_table, print_parts
from skelsplat.datasets import Dataset
from skelsplat.datasets._registry import detections_option, options_of
from skelsplat.evaluation import ablations, methods, people, protocols, single
from skelsplat.evaluation.ablations import Source
from skelsplat.evaluation.tables import Report, Table
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.run.folder import output_folder

_EVALUATE_EPILOG = "FOLDER has report.md, report.csv and report.json."
_EVALUATE_OPTIONS = (
    *rows(
        f"""
        DATASET  {", ".join(datasets.names())}.
        ROOT  Its folder.
        Method:
        --methods, -m NAMES  Comma between them, or repeated: {", ".join(methods.names)}; or all. Where
            nothing says who is who: {", ".join(people.names)}.
            [all that the data allow but paper; with several people, the last three]
        --seed SEED  Seed of the pairs that RANSAC draws. [= 0]
        Data:
        --detections WHICH  Name of a detector that the data set has, or a folder or file of detections.
            [the reader's choice]
        --views M  Number of views, where the protocol has a choice: panoptic 4 to 8, occlusion-person 4 or 8.
            [the protocol's]
        --every N  One frame in N of each take. [the protocol's]
        --fps HZ  Frames per second, for annealed-butterworth and over-time. [the data set's]
        Output:
        -o, --output FOLDER  Folder for results. [skelsplat-evaluation/NAME]
        --per-joint  Print the table of joints too.
        """,
        dataset=choice(*datasets.names()),
        methods={"name": "names", "many": True, "read": lambda _option, given: _method_names(given)},
        detections={"marks": (NAME_OR_PATH,)},
        views={"kind": int, "limits": {"min": 2}},
    ),
    *(SETTINGS, LENS, INIT_SIGMA, *options.of_job("n_threads")),
)


@answers(*_EVALUATE_OPTIONS, epilog=_EVALUATE_EPILOG)
def evaluate(
    *,
    dataset: str,
    root: Path,
    names: list[str],
    detections: str | None = None,
    protocol: bool,
    fps: float | None = None,
    set: list[str],
    output: Path | None = None,
    per_joint: bool,
    **given: Any,
) -> Answer:
    """Run methods on a data set with ground truth and print their errors with published ones.

    [bold]Examples[/bold]

    skelsplat evaluate human36m data/h36m --detections cpn --protocol as-paper

    skelsplat evaluate panoptic data/panoptic --views 6 -m annealed,dlt

    skelsplat evaluate synthetic data/people -m track,affinity,oracle
    """
    views = given.pop("views", None)
    every = given.pop("every", None)
    chosen = methods.Options(undistort=protocol, **given)
    data = _read(dataset, root, detections, views, set)
    for finding in datasets.verify(data):
        tell(finding, f"{', '.join(finding.subject.files)}: ")
    if fps is not None:
        data = data.with_fps(fps)
    rules = protocols.get(data.name).with_options(n_views=views, every=every)
    folder = Path("skelsplat-evaluation") / data.name if output is None else output
    with output_folder(folder), progress("poses", first="evaluating") as bar:

        def hear(name: str, take: str, done: int, total: int) -> None:
            bar(f"{name}, {take}", done, total)

        run: dict[str, Any] = {"protocol": rules, "report": hear}
        if _of_people(names, data):
            found = people.evaluate(data, [] if names == ["all"] else names, chosen, **run).report()
        else:
            found = single.evaluate(data, names, chosen, **run).report()
        files = found.write(folder)
    shown = found.tables if per_joint else found.tables[: found.shown]

    def show(console: Console) -> None:
        for table in shown:
            print_experiment(console, table)
        for note in shown[0].notes:
            console.print(note, style="dim")

    return answer(found, show, folder, files)


def answer(report: Report, show: Callable[[Console], None], folder: Path | None, files: list[str]) -> Answer:
    """Return the answer of evaluate and ablate: what ``show`` prints, and which files were written."""

    def print_all(console: Console) -> None:
        show(console)
        if files:
            console.print(f"Wrote to {folder}/: {', '.join(files)}")

    return Answer(dict(report.values), print_all)


def print_experiment(console: Console, whole: Table) -> None:
    """Print a table in parts that fit, its best figures in bold, and reported ones apart."""
    for table in whole.by_figures():
        drawn = new_table(table.heading or None, table.first, [column.header for column in table.columns])
        reported = False
        for row in table.rows:
            if row.origin != "measured" and not reported:
                reported = True
                drawn.add_section()
                drawn.add_row(Text("reported:", style="dim"))
            styles = ["bold" if table.is_best(row, k) else "" for k in range(len(table.columns))]
            cells = [Text(table.text(row, k), style) for k, style in enumerate(styles)]
            drawn.add_row(Text(escaped(row.label)), *cells, style="italic" if reported else "")
        print_parts(console, drawn)


def _of_people(names: Sequence[str], data: Dataset) -> bool:
    """Whether the methods are those of several people; refuse them with others."""
    whole = list(names) in ([], ["all"])
    kinds = {bool(data.scenes)} if whole else {name in people.names for name in names}
    if len(kinds) > 1:
        expected = f"either {', '.join(people.names)} or methods of one person"
        raise InvalidInputError(f"--methods: expected {expected}, got {', '.join(names)}")
    return kinds.pop()


def _method_names(given: Sequence[str] | None) -> list[str]:
    names = [name.strip() for text in given or () for name in text.split(",") if name.strip()]
    for name in names if names != ["all"] else ():
        one_of("--methods", name, (*methods.names, *people.names))
    return names


def _read(name: str, root: Path, detections: str | None, views: int | None, own: Sequence[str]) -> Dataset:
    """Read a data set with the options of its reader: those given as KEY=VALUE, the detections, the views."""
    known, found = options_of(name), reader_options(own, name)
    if detections is not None:
        found |= detections_option(name, detections)
    if views is not None and "views" in known and name != "synthetic":  # there the protocol chooses
        found.setdefault("views", views)
    try:
        return datasets.read(name, root, **found)
    except DatasetError as error:
        if detections is None or not error.field.startswith("detector"):
            raise
        expected = f"expected {error.expected}, or a folder or file, got {error.actual}"
        raise typer.BadParameter(expected, param_hint="--detections") from error


# Beyond so many settings they become rows.
_MOST_COLUMNS = 6

_ABLATE_EPILOG = "Without --data, data are simulated in memory from the seed, which every table says."

_ABLATE_OPTIONS = (
    *rows(
        f"""
        NAME  {", ".join(ablations.names)}.
        Data:
        --data DATASET FOLDER  A data set on disk.
        --detections DETECTOR  Detections of the data set; may be repeated.
        --poses N  Poses of each data set, evenly from its takes. [so many that it ends within about a minute]
        --full  All poses.
        --seed SEED  Seed of all random numbers. [= 0]
        Method:
        --start paper|dlt|fusion  Initial poses; paper: as in the paper's experiment. [= paper]
        Output:
        -o, --output FOLDER  Write NAME.md, .csv, .json and .png into this folder.
        """,
        name=choice(*ablations.names),
        data={"kind": tuple[str, Path]},
        detections={"many": True},
    ),
    *(SETTINGS, LENS, INIT_SIGMA),
)


@answers(*_ABLATE_OPTIONS, epilog=_ABLATE_EPILOG)
def ablate(
    *,
    name: str,
    data: tuple[str, Path] | None = None,
    detections: list[str],
    set: list[str],
    poses: int | None = None,
    full: bool,
    protocol: bool,
    output: Path | None = None,
    **given: Any,
) -> Answer:
    """Repeat an ablation of the paper and print its tables with the paper's rows.

    All settings have the same poses, detections and starts.

    [bold]Examples[/bold]

    skelsplat ablate noise --poses 50

    skelsplat ablate views --data panoptic data/panoptic --detections metrabs --full -o out
    """
    if full and poses is not None:
        raise typer.BadParameter("expected either a number of poses or --full", param_hint="--poses")
    ablation = ablations.get(name)
    choices = {"poses": None if full else poses or ablation.poses, "undistort": protocol, **given}
    if data is not None:
        dataset, root = one_of("--data", data[0], datasets.names()), data[1]
        sets = protocols.get(dataset).view_sets if dataset in protocols.names and name == "views" else ()
        views = max(sets, default=None)
        choices["data"] = [_read(dataset, root, one, views, set) for one in detections or (None,)]
    elif detections or set:
        expected = "expected a data set for --detections and --set, got none"
        raise typer.BadParameter(expected, param_hint="--data")
    place = contextlib.nullcontext() if output is None else output_folder(output)
    with place, progress("poses", first="reading", time=TimeElapsedColumn()) as bar:
        command = shlex.join(["skelsplat", *sys.argv[1:]])
        report = ablation.run(Source(progress=bar, **choices), command=command)
    files = [] if output is None else report.write(output, name)
    return answer(report, partial(_print_ablation, report), output, files)


def _print_ablation(report: Report, console: Console) -> None:
    """Print tables, turned if there are too many settings for the width, each above its source; and notes."""
    for table in report.tables:
        print_experiment(console, table.turned() if len(table.columns) > _MOST_COLUMNS else table)
        console.print(*table.notes, style="yellow" if report.values["simulated"] else "")
        console.print()
    for note in report.values["notes"]:
        console.print(f"· {note}", style="dim")
