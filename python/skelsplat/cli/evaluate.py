"""``skelsplat evaluate``: methods on a data set with ground truth, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table as Drawn
from rich.text import Text

from skelsplat import datasets
from skelsplat._optional import can_draw
from skelsplat.cli import options
from skelsplat.cli.config import NAME_OR_PATH
from skelsplat.cli.datasets import Settings, reader_options
from skelsplat.cli.output import described, print_json, print_warning
from skelsplat.cli.table import tell
from skelsplat.datasets._registry import detections_option, options_of
from skelsplat.evaluation import export, methods, protocols, report, tables
from skelsplat.evaluation.report import Evaluation
from skelsplat.evaluation.tables import Row, Table
from skelsplat.findings import Finding, collected_warnings
from skelsplat.run.folder import output_folder

if TYPE_CHECKING:
    from skelsplat.viz import BarData

EPILOG = (
    "Results: report.md, report.csv, report.json and bars.png in FOLDER; the poses of every take under "
    "FOLDER/runs, from where a stopped evaluation goes on. Exit status: 0 ok, 1 failed, 2 bad usage, 130 "
    "interrupted."
)
_WIDTH, _NAME_WIDTH = 100, 32
_LENSES = {"undistorted": True, "as-paper": False}
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
Lens = Annotated[
    str,
    _data(
        "--protocol",
        metavar="undistorted|as-paper",
        help="Remove lens distortion from detections, or ignore it as published evaluations do.",
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
InitSigma = Annotated[
    float, _method(metavar="MM", help="Standard deviation per axis of the fused start of annealed-prior.")
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
    options.positive("--init-sigma-mm", init_sigma_mm)
    chosen = methods.Options(
        undistort=_LENSES[options.one_of("--protocol", lens, tuple(_LENSES))],
        start=None if start is None else options.one_of("--start", start, methods.STARTS),
        init_sigma_mm=init_sigma_mm,
        seed=seed,
        n_threads=threads,
    )
    options.one_of("DATASET", dataset, datasets.names())
    options.one_of("--counting", counting, ("all", "adafuse"))
    with collected_warnings(tell):
        data = datasets.read(dataset, root, **_reader_options(dataset, detections, views, setting or []))
        for finding in datasets.verify(data):
            print_warning(f"{', '.join(finding.subject.files)}: {finding.text}")
        rules = protocols.get(data.name).with_options(n_views=views, every=every, counting=counting)
        folder = Path("skelsplat-evaluation") / data.name if out is None else out
        with output_folder(folder):
            with described("evaluating", shown=not quiet) as bar:
                runs, hear = folder / "runs", lambda method, take, *count: bar(f"{method}, {take}", *count)
                found = report.evaluate(data, names, chosen, protocol=rules, folder=runs, report=hear)
            files = _write_evaluation(folder, found)
    if as_json:
        print_json(export.as_dict(found))
    elif not quiet:
        console = Console(highlight=False, markup=False)
        console.width = min(console.width, _WIDTH) if console.is_terminal else _WIDTH
        _print_evaluation(console, found, per_joint=per_joint)
        console.print(f"Wrote to {folder}/: {', '.join(files)}")


def _method_names(given: Sequence[str] | None) -> list[str]:
    names = [name.strip() for text in given or () for name in text.split(",") if name.strip()]
    if names == ["all"]:
        return list(methods.names)
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
    for table in shown:
        for part, gap in _fitting(table, console.width):
            console.print(_drawn(part, gap))
    for note in overall.notes:
        console.print(note, style="dim")


def _fitting(table: Table, width: int) -> list[tuple[Table, int]]:
    """Cut a table that is too wide into parts of about equally many columns; with the gap between columns."""
    name = _least_name(table)
    widths = [
        max(_longest_word(column.header), *(len(table.text(row, k)) for row in table.rows))
        for k, column in enumerate(table.columns)
    ]
    for parts in range(1, len(widths) + 1):
        count = -(-len(widths) // parts)
        groups = [widths[k : k + count] for k in range(0, len(widths), count)]
        for gap in (2, 1):
            if count == 1 or all(name + sum(g) + (gap + 1) * len(g) <= width - 2 for g in groups):
                return [(part, gap) for part in table.split(count)]
    return [(table, 1)]


def _least_name(table: Table) -> int:
    """Return the width at which no measured name is broken; reported ones may be, between words."""
    return max(_longest_word(row.name) if row.reported else len(row.name) for row in table.rows)


def _longest_word(header: str) -> int:
    return max(len(word) for word in header.replace("-", "- ").replace("/", "/ ").split())


def _drawn(table: Table, gap: int) -> Drawn:
    drawn = Drawn(
        title=Text(table.title) if table.title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, gap, 0, 0),
        pad_edge=False,
    )
    drawn.add_column(table.first, min_width=_least_name(table), max_width=_NAME_WIDTH)
    for column in table.columns:
        drawn.add_column(_breakable(column.header), justify="right")
    measured = [row for row in table.rows if not row.reported]
    reported = [row for row in table.rows if row.reported]
    for row in measured:
        drawn.add_row(*_cells(table, row), end_section=bool(reported) and row is measured[-1])
    if reported:
        drawn.add_row(Text("reported:", style="dim"))
    for row in reported:
        drawn.add_row(*_cells(table, row), style="italic")
    return drawn


def _breakable(header: str) -> str:
    return (
        header.replace("-", "-\n").replace("/", "/\n").replace("PCK ", "PCK\n").replace("95 % CI", "95 %\nCI")
    )


def _cells(table: Table, row: Row) -> list[Text]:
    return [
        Text(row.name),
        *(
            Text(table.text(row, k), style="bold" if table.is_best(row, k) else "")
            for k in range(len(table.columns))
        ),
    ]


def _write_evaluation(folder: Path, evaluation: Evaluation) -> list[str]:
    """Write ``report.md``, ``.csv``, ``.json`` and ``bars.png``; return their names."""
    names = export.write(folder, evaluation)
    if not can_draw():
        tell(Finding("no_figures", "note"))
        return names
    from skelsplat import viz  # matplotlib takes long to load, and --help does without

    viz.write_bars(folder / "bars.png", _bars(evaluation))
    return [*names, "bars.png"]


def _bars(evaluation: Evaluation) -> BarData:
    from skelsplat import viz  # as in _write_evaluation

    overall = tables.overall(evaluation)
    rows = [row for row in overall.rows if row.cells[0] is not None]
    intervals = {s.method: (s.absolute.low, s.absolute.high) for s in evaluation.scores}
    ends = [(np.nan, np.nan) if row.reported else intervals[row.name] for row in rows]
    real = " on the real data set" if evaluation.simulated else ""
    others = f" Grey: reported{real}, not measured here." if evaluation.published else ""
    return viz.BarData(
        names=tuple(row.name for row in rows),
        values=np.array([row.cells[0] for row in rows], dtype=np.float64),
        low=np.array([low for low, _ in ends]),
        high=np.array([high for _, high in ends]),
        measured=np.array([not row.reported for row in rows]),
        title=overall.title.partition(":")[0],
        axis="absolute MPJPE, mm, with 95 % interval over takes",
        caption=f"{evaluation.dataset.source or evaluation.dataset.name}.{others}",
    )
