"""``skelsplat evaluate``: methods on a data set with ground truth, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table as Drawn
from rich.text import Text

from skelsplat import datasets
from skelsplat._arrays import positive
from skelsplat._escape import escaped
from skelsplat.cli import options
from skelsplat.cli.config import NAME_OR_PATH
from skelsplat.cli.datasets import LENSES, InitSigma, Lens, Settings, reader_options
from skelsplat.cli.findings import tell, telling
from skelsplat.cli.output import described, print_json
from skelsplat.cli.table import new_table, print_parts, wide_console
from skelsplat.datasets import Dataset
from skelsplat.datasets._registry import detections_option, options_of
from skelsplat.evaluation import methods, people, protocols, single
from skelsplat.evaluation.report import Report
from skelsplat.evaluation.tables import Table
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, collected_warnings
from skelsplat.run.folder import output_folder

EPILOG = (
    "Results: report.md, report.csv, report.json and, of methods of one person, bars.png in FOLDER and the "
    "poses of every take under FOLDER/runs, from where a stopped evaluation goes on. Exit status: 0 ok, "
    "1 failed, 2 bad usage, 130 interrupted."
)
_data, _method, _output = (
    partial(typer.Option, rich_help_panel=panel) for panel in ("Data", "Method", "Output")
)

Name = Annotated[str, typer.Argument(metavar="DATASET", help=", ".join(datasets.names()) + ".")]
Root = Annotated[Path, typer.Argument(readable=False, metavar="ROOT", help="Its folder.")]
Detections = Annotated[
    str | None,
    NAME_OR_PATH,
    _data(
        metavar="WHICH",
        help="Name of a detector that the data set has, or a folder or file of detections.",
        show_default="the reader's choice",
    ),
]
Views = Annotated[
    int | None,
    _data(
        min=2,
        metavar="M",
        help="Number of views, where the protocol has a choice: panoptic 4 to 8, occlusion-person 4 or 8.",
        show_default="the protocol's",
    ),
]
Every = Annotated[
    int | None, _data(min=1, metavar="K", help="One frame in K of each take.", show_default="the protocol's")
]
Fps = Annotated[
    float | None,
    _data(
        metavar="HZ",
        help="Frames per second, for annealed-butterworth, annealed-kalman and over-time.",
        show_default="the data set's",
    ),
]
Counting = Annotated[
    str,
    _data(metavar="all|adafuse", help="adafuse counts only joints that at least two views see unoccluded."),
]
MethodNames = Annotated[
    list[str] | None,
    _method(
        "--methods",
        "-m",
        metavar="NAMES",
        help=f"Comma between them, or repeated: {', '.join(methods.names)}; or all. Where nothing says who "
        f"is who: {', '.join(people.names)}.",
        show_default="all that the data allow but paper; with several people, the last three",
    ),
]
Start = Annotated[
    str | None,
    _method(
        metavar="dlt|fusion|none",
        help="Where annealed, paper-closed-form and paper start.",
        show_default="none; the paper's for the last two",
    ),
]
Seed = Annotated[int, _method(min=0, metavar="S", help="Seed of the pairs that RANSAC draws.")]
Out = Annotated[
    Path | None,
    _output(
        "-o",
        "--output",
        metavar="FOLDER",
        help="Folder for results.",
        show_default="skelsplat-evaluation/NAME",
    ),
]
PerJoint = Annotated[bool, _output("--per-joint", metavar="", help="Print the table of joints too.")]


# long: a parameter per option
def evaluate(
    dataset: Name,
    root: Root,
    *,
    method: MethodNames = None,
    detections: Detections = None,
    lens: Lens = "undistorted",
    views: Views = None,
    every: Every = None,
    fps: Fps = None,
    counting: Counting = "all",
    setting: Settings = None,
    start: Start = None,
    init_sigma_mm: InitSigma = methods.DEFAULT_INIT_SIGMA_MM,
    seed: Seed = 0,
    threads: options.Threads = None,
    out: Out = None,
    per_joint: PerJoint = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
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
    names = _method_names(method)
    chosen = methods.Options(
        undistort=LENSES[options.one_of("--protocol", lens, tuple(LENSES))],
        start=start,
        init_sigma_mm=init_sigma_mm,
        seed=seed,
        n_threads=threads,
    )
    if fps is not None:
        positive("fps", fps)
    options.one_of("DATASET", dataset, datasets.names())
    options.one_of("--counting", counting, ("all", "adafuse"))
    with collected_warnings(telling(quiet=quiet)):
        data = datasets.read(dataset, root, **_reader_options(dataset, detections, views, setting or []))
        for finding in datasets.verify(data):
            tell(finding, f"{', '.join(finding.subject.files)}: ")
        if fps is not None:
            data = data.with_fps(fps)
        rules = protocols.get(data.name).with_options(n_views=views, every=every, counting=counting)
        folder = Path("skelsplat-evaluation") / data.name if out is None else out
        with output_folder(folder), described("evaluating", shown=not quiet) as bar:

            def hear(name: str, take: str, done: int, total: int) -> None:
                bar(f"{name}, {take}", done, total)

            found: people.PeopleEvaluation | single.Evaluation
            if _of_people(names, data, start, counting):
                picked = [] if names == ["all"] else names
                found = people.evaluate(data, picked, chosen, protocol=rules, report=hear)
            else:
                kept = folder / "runs"
                found = single.evaluate(data, names, chosen, protocol=rules, folder=kept, report=hear)
            report = found.report()
            files = report.write(folder)
    shown = report.tables if per_joint else report.tables[: report.shown]
    print_report(report, shown, f"{folder}/", files, quiet=quiet, as_json=as_json)


def print_report(
    report: Report, shown: Sequence[Table], place: str, files: Sequence[str], *, quiet: bool, as_json: bool
) -> None:
    """Print tables, what the columns of the first mean, and which files were written; or JSON."""
    if files and report.draw is not None and not files[-1].endswith(".png"):
        telling(quiet=quiet)(Finding("no_figures", "note"))
    if as_json:
        print_json(dict(report.values))
    elif not quiet:
        console = wide_console()
        for table in shown:
            print_experiment(console, table)
        for note in shown[0].notes:
            console.print(note, style="dim")
        console.print(f"Wrote to {place}: {', '.join(files)}")


def print_experiment(console: Console, table: Table) -> None:
    """Print a table in parts that fit, its best figures in bold, and reported ones apart."""
    for one in table.by_figures():
        print_parts(console, len(one.columns), partial(_parts, one))


def _parts(table: Table, size: int) -> list[Drawn]:
    return list(map(_drawn, table.split(size)))


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


def _of_people(names: Sequence[str], data: Dataset, start: str | None, counting: str) -> bool:
    """Whether the methods are those of several people; refuse them with others, or what does not apply."""
    whole = list(names) in ([], ["all"])
    kinds = {name in people.names for name in names} if not whole else {bool(data.scenes)}
    if len(kinds) > 1:
        expected = f"either {', '.join(people.names)} or methods of one person"
        raise InvalidInputError(f"--methods: expected {expected}, got {', '.join(names)}")
    several = kinds.pop()
    if several and (start is not None or counting != "all"):
        raise InvalidInputError("--start, --counting: expected with methods of one person only")
    return several


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
