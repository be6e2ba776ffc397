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
from skelsplat.cli import options
from skelsplat.cli.config import NAME_OR_PATH
from skelsplat.cli.datasets import LENSES, InitSigma, Lens, Settings, reader_options
from skelsplat.cli.output import described, print_json, print_warning
from skelsplat.cli.table import new_table, print_parts, tell, wide_console
from skelsplat.datasets._registry import detections_option, options_of
from skelsplat.evaluation import export, methods, protocols, report, tables
from skelsplat.evaluation.report import Evaluation
from skelsplat.evaluation.tables import Table
from skelsplat.findings import Finding, collected_warnings
from skelsplat.run.folder import output_folder

EPILOG = (
    "Results: report.md, report.csv, report.json and bars.png in FOLDER; the poses of every take under "
    "FOLDER/runs, from where a stopped evaluation goes on. Exit status: 0 ok, 1 failed, 2 bad usage, 130 "
    "interrupted."
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
        help="Name of a detector that the data set has, or a folder of detections.",
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
        help="Frames per second, for annealed-butterworth, annealed-kalman and in-time.",
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
        help=f"Comma between them, or repeated: {', '.join(methods.names)}; or all.",
        show_default="all that the data allow but paper",
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
    with collected_warnings(tell):
        data = datasets.read(dataset, root, **_reader_options(dataset, detections, views, setting or []))
        for finding in datasets.verify(data):
            print_warning(f"{', '.join(finding.subject.files)}: {finding.text}")
        if fps is not None:
            data = data.with_fps(fps)
        rules = protocols.get(data.name).with_options(n_views=views, every=every, counting=counting)
        folder = Path("skelsplat-evaluation") / data.name if out is None else out
        with output_folder(folder):
            with described("evaluating", shown=not quiet) as bar:
                runs, hear = folder / "runs", lambda method, take, *count: bar(f"{method}, {take}", *count)
                found = report.evaluate(data, names, chosen, protocol=rules, folder=runs, report=hear)
            files = export.write(folder, found)
    if "bars.png" not in files:
        tell(Finding("no_figures", "note"))
    if as_json:
        print_json(export.as_dict(found))
    elif not quiet:
        console = wide_console()
        _print_evaluation(console, found, per_joint=per_joint)
        console.print(f"Wrote to {folder}/: {', '.join(files)}")


def _method_names(given: Sequence[str] | None) -> list[str]:
    names = [name.strip() for text in given or () for name in text.split(",") if name.strip()]
    if names == ["all"]:
        return names
    for name in names:
        options.one_of("--methods", name, methods.names)
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


def _print_evaluation(console: Console, evaluation: Evaluation, *, per_joint: bool) -> None:
    """Print the table of methods, that of actions if there are several, and what they mean."""
    overall = tables.overall(evaluation)
    shown = [overall]
    if len(evaluation.headers) > 1:
        shown.append(tables.actions(evaluation))
        if evaluation.protocol.parts:
            shown.append(tables.actions(evaluation, "pcp"))
    if per_joint:
        shown.append(tables.joints(evaluation))
    for table in (part for whole in shown for part in whole.by_figures()):
        print_parts(console, len(table.columns), partial(_parts, table))
    for note in overall.notes:
        console.print(note, style="dim")


def _parts(table: Table, size: int) -> list[Drawn]:
    return [_drawn(part) for part in table.split(size)]


def _drawn(table: Table) -> Drawn:
    drawn = new_table(table.title or None, table.first, [column.header for column in table.columns])
    reported = False
    for row in table.rows:
        if row.reported and not reported:
            drawn.add_section()
            drawn.add_row(Text("reported:", style="dim"))
        reported = row.reported
        styles = ["bold" if table.is_best(row, k) else "" for k in range(len(table.columns))]
        cells = [Text(table.text(row, k), style) for k, style in enumerate(styles)]
        drawn.add_row(Text(row.name), *cells, style="italic" if reported else "")
    return drawn
