"""``skelsplat evaluate``: methods on a data set with ground truth, and their table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table as Drawn
from rich.text import Text

from skelsplat import datasets
from skelsplat._escape import escaped
from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.datasets import INIT_SIGMA, LENS, SETTINGS, reader_options
from skelsplat.cli.findings import tell, telling
from skelsplat.cli.output import print_json, progress
from skelsplat.cli.rows import NAME_OR_PATH, rows
from skelsplat.cli.table import new_table, print_parts, wide_console
from skelsplat.datasets import Dataset
from skelsplat.datasets._registry import detections_option, options_of
from skelsplat.evaluation import methods, people, protocols, single
from skelsplat.evaluation.protocols import Protocol
from skelsplat.evaluation.tables import Report, Table
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import collected_warnings, no_pictures
from skelsplat.run.folder import output_folder

EPILOG = (
    "Results: report.md, report.csv, report.json and, of methods of one person, bars.png in FOLDER and the "
    "poses of every take under FOLDER/runs, from where a stopped evaluation goes on. Exit status: 0 ok, "
    "1 failed, 2 bad usage, 130 interrupted."
)
OPTIONS = (
    *rows("", f"DATASET  {', '.join(datasets.names())}.\nROOT  Its folder.", root=Path),
    *rows(
        "Method",
        f"""
        --methods, -m NAMES  Comma between them, or repeated: {", ".join(methods.names)}; or all. Where
            nothing says who is who: {", ".join(people.names)}.
            [all that the data allow but paper; with several people, the last three]
        """,
        methods={"name": "names", "many": True, "read": lambda _option, given: _method_names(given)},
    ),
    *rows(
        "Data",
        """
        --detections WHICH  Name of a detector that the data set has, or a folder or file of detections.
            [the reader's choice]
        """,
        detections={"marks": (NAME_OR_PATH,)},
    ),
    LENS,
    *rows(
        "Data",
        """
        --views M  Number of views, where the protocol has a choice: panoptic 4 to 8, occlusion-person 4 or 8.
            [the protocol's]
        --every K  One frame in K of each take. [the protocol's]
        --fps HZ  Frames per second, for annealed-butterworth and over-time. [the data set's]
        """,
        views={"kind": int, "limits": {"min": 2}},
        every={"kind": int, "limits": {"min": 1}},
        fps={"kind": float, "read": options.positive},
    ),
    SETTINGS,
    INIT_SIGMA,
    *rows(
        "Method",
        "--seed S  Seed of the pairs that RANSAC draws.",
        seed={"kind": int, "default": 0, "limits": {"min": 0}},
    ),
    options.THREADS,
    *rows(
        "Output",
        """
        -o, --output FOLDER  Folder for results. [skelsplat-evaluation/NAME]
        --per-joint  Print the table of joints too.
        """,
        output=Path,
    ),
    options.QUIET,
    options.AS_JSON,
)


@takes(*OPTIONS)
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
    quiet: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Run methods on a data set with ground truth and print their errors with published ones.

    A stopped evaluation continues when it is started again with the same
    options; after changes of options or data it is computed again.

    [bold]Examples[/bold]

    skelsplat synth human36m-like data/h36m-like

    skelsplat evaluate synthetic data/h36m-like

    skelsplat evaluate human36m data/h36m --detections cpn --protocol as-paper

    skelsplat evaluate panoptic data/panoptic --views 6 -m annealed,dlt

    skelsplat evaluate synthetic data/people -m track,affinity,oracle
    """
    views = given.pop("views", None)
    every = given.pop("every", None)
    chosen = methods.Options(undistort=protocol, **given)
    options.one_of("DATASET", dataset, datasets.names())
    with collected_warnings(telling(quiet=quiet)):
        data = datasets.read(dataset, root, **_reader_options(dataset, detections, views, set))
        for finding in datasets.verify(data):
            tell(finding, f"{', '.join(finding.subject.files)}: ")
        if fps is not None:
            data = data.with_fps(fps)
        rules = protocols.get(data.name).with_options(n_views=views, every=every)
        folder = Path("skelsplat-evaluation") / data.name if output is None else output
        with output_folder(folder), progress("poses", first="evaluating", shown=not quiet) as bar:
            several = _of_people(names, data)
            report = _evaluated(data, names, chosen, rules, None if several else folder / "runs", bar)
            files = report.write(folder)
    shown = report.tables if per_joint else report.tables[: report.shown]

    def show(console: Console) -> None:
        for table in shown:
            print_experiment(console, table)
        for note in shown[0].notes:
            console.print(note, style="dim")

    print_report(report, show, folder, files, quiet=quiet, as_json=as_json)


def _evaluated(
    data: Dataset,
    names: Sequence[str],
    chosen: methods.Options,
    rules: Protocol,
    runs: Path | None,
    bar: Callable[[str, int, int], object],
) -> Report:
    """Run methods of one person, whose poses are kept in a folder, or, without one, of several people."""

    def hear(name: str, take: str, done: int, total: int) -> None:
        bar(f"{name}, {take}", done, total)

    if runs is None:
        picked = [] if list(names) == ["all"] else names
        return people.evaluate(data, picked, chosen, protocol=rules, report=hear).report()
    return single.evaluate(data, names, chosen, protocol=rules, folder=runs, report=hear).report()


def print_report(
    report: Report,
    show: Callable[[Console], None],
    folder: Path | None,
    files: Sequence[str],
    *,
    quiet: bool,
    as_json: bool,
) -> None:
    """Print what ``show`` prints, and which files were written; or JSON."""
    if files and report.draw is not None and not files[-1].endswith(".png"):
        telling(quiet=quiet)(no_pictures("Figures"))
    if as_json:
        print_json(dict(report.values))
    elif not quiet:
        console = wide_console()
        show(console)
        if files:
            console.print(f"Wrote to {folder}/: {', '.join(files)}")


def print_experiment(console: Console, table: Table) -> None:
    """Print a table in parts that fit, its best figures in bold, and reported ones apart."""
    for one in table.by_figures():
        print_parts(console, _drawn(one))


def _drawn(table: Table) -> Drawn:
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
    return drawn


def _of_people(names: Sequence[str], data: Dataset) -> bool:
    """Whether the methods are those of several people; refuse them with others."""
    whole = list(names) in ([], ["all"])
    kinds = {name in people.names for name in names} if not whole else {bool(data.scenes)}
    if len(kinds) > 1:
        expected = f"either {', '.join(people.names)} or methods of one person"
        raise InvalidInputError(f"--methods: expected {expected}, got {', '.join(names)}")
    return kinds.pop()


def _method_names(given: Sequence[str] | None) -> list[str]:
    names = [name.strip() for text in given or () for name in text.split(",") if name.strip()]
    if names == ["all"]:
        return names
    for name in names:
        options.one_of("--methods", name, (*methods.names, *people.names))
    return names


def _reader_options(
    dataset: str, detections: str | None, views: int | None, settings: Sequence[str]
) -> dict[str, Any]:
    """Return the options of the reader: those given as KEY=VALUE, the detections, the views."""
    known, found = options_of(dataset), reader_options(settings, dataset)
    if detections is not None:
        found |= detections_option(dataset, detections)
    if views is not None and "views" in known and dataset != "synthetic":  # there the protocol chooses
        found.setdefault("views", views)
    return found
