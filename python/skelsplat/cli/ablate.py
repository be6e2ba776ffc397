"""``skelsplat ablate``: one ablation of the paper, with the paper's figures next to ours."""

from __future__ import annotations

import shlex
import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich import box
from rich.console import Console
from rich.progress import TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from skelsplat import datasets
from skelsplat._optional import can_draw
from skelsplat.cli import options
from skelsplat.cli.datasets import Settings, reader_options
from skelsplat.cli.output import described, print_json
from skelsplat.cli.table import print_table, tell
from skelsplat.evaluation import ablations
from skelsplat.evaluation.ablations import Choices, OnDisk, Simulated, Source
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM
from skelsplat.findings import Finding

_data, _method, _output = (
    partial(typer.Option, rich_help_panel=panel) for panel in ("Data", "Method", "Output")
)
# Of tables that go into a file or a pipe.
_WIDTH = 100
# Beyond so many settings they become rows, for 80 columns.
_MOST_COLUMNS = 6
_STYLES = {"measured": "bold", "paper": "dim", "theory": "dim"}

EPILOG = (
    "Without --data the data are simulated, which every table says; they are made in memory from the seed."
)

Name = Annotated[str, typer.Argument(metavar="NAME", help=f"{', '.join(ablations.names)}.")]
Data = Annotated[tuple[str, Path] | None, _data(metavar="DATASET FOLDER", help="A data set on disk.")]
Detections = Annotated[
    list[str] | None, _data(metavar="DETECTOR", help="Detections of the data set; may be repeated.")
]
Poses = Annotated[
    int | None,
    _data(
        min=1,
        metavar="N",
        help="Poses of each data set, evenly from its takes.",
        show_default="so many that it ends within about a minute",
    ),
]
Full = Annotated[bool, _data("--full", metavar="", help="All poses.")]
Seed = Annotated[int, _data(min=0, metavar="S", help="Seed of all random numbers.")]
Start = Annotated[
    Literal["paper", "dlt", "fusion"], _method(help="Initial poses; paper: as in the paper's experiment.")
]
InitSigma = Annotated[
    float,
    _method(min=0.1, metavar="MM", help="Standard deviation per axis of fused poses where they are a prior."),
]
Lens = Annotated[
    Literal["as-paper", "undistorted"], _method("--protocol", help="as-paper: lens distortion is ignored.")
]
Out = Annotated[
    Path | None,
    _output("-o", "--output", metavar="FOLDER", help="Write NAME.md, .csv, .json and .png into this folder."),
]


# long: a parameter per option
def ablate(
    name: Name,
    data: Data = None,
    detections: Detections = None,
    setting: Settings = None,
    poses: Poses = None,
    full: Full = False,
    seed: Seed = 0,
    start: Start = "paper",
    init_sigma_mm: InitSigma = DEFAULT_INIT_SIGMA_MM,
    protocol: Lens = "undistorted",
    out: Out = None,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Repeat an ablation of the paper and print its tables with the paper's rows.

    Each of the paper's claims is checked on the measured figures and marked
    as reproduced or not. "Beats" means by more than twice the standard error
    of the difference, over the same poses.

    [bold]Examples[/bold]

    skelsplat ablate noise

    skelsplat ablate symmetry --poses 50 --json > symmetry.json

    skelsplat ablate views --data panoptic data/panoptic --detections metrabs --full -o out
    """
    if full and poses is not None:
        raise typer.BadParameter("expected either a number of poses or --full", param_hint="--poses")
    ablation = ablations.get(options.one_of("NAME", name, ablations.names))
    choices = Choices(
        poses=None if full else poses or ablation.poses,
        seed=seed,
        start=start,
        init_sigma_mm=init_sigma_mm,
        undistort=protocol == "undistorted",
    )
    with described("reading", shown=not quiet, time=TimeElapsedColumn()) as progress:
        source: Source
        if data is None:
            if detections or setting:
                raise typer.BadParameter(
                    "expected a data set for --detections and --set, got none", param_hint="--data"
                )
            source = Simulated(choices, progress)
        else:
            dataset = options.one_of("--data", data[0], datasets.names())
            settings = reader_options(setting or (), dataset)
            source = OnDisk(choices, dataset, data[1], detections or (), settings, progress)
        record = ablations.run(name, source, command=shlex.join(["skelsplat", *sys.argv[1:]]))
    files = [] if out is None else [*ablations.write(out, record), *_draw(out, record)]
    if as_json:
        print_json(ablations.as_dict(record))
    elif not quiet:
        console = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else _WIDTH)
        _print_record(console, record)
        if files:
            console.print(f"{out}: {', '.join(file.name for file in files)}")


def _print_record(console: Console, record: ablations.Record) -> None:
    """Print tables, each with its source under it, claims and notes."""
    for table in record.outcome.tables:
        print_table(console, _shown(table))
        console.print(record.line, style="yellow" if record.simulated else "")
        console.print()
    _print_claims(console, record)
    for note in (*record.notes, *record.sources):
        console.print(f"· {note}", style="dim")


def _shown(table: ablations.Table) -> Table:
    """Return a table whose rows are methods; or its columns, if there are too many settings for the width."""
    shown = Table(title=f"{table.title} ({table.unit})", box=box.SIMPLE_HEAD, title_justify="left")
    names = [_name(row) for row in table.rows]
    cells = [[ablations.cell(value, table.digits) for value in row.values] for row in table.rows]
    styles = [_STYLES[row.origin] for row in table.rows]
    if len(table.columns) <= _MOST_COLUMNS:
        shown.add_column(table.corner, overflow="fold")
        for column in table.columns:
            shown.add_column(column, justify="right")
        for name, row, style in zip(names, cells, styles, strict=True):
            shown.add_row(name, *row, style=style)
    else:
        shown.add_column(table.corner)
        for name, style in zip(names, styles, strict=True):
            shown.add_column(name.replace(", ", ",\n"), justify="right", style=style)
        for column, *figures in zip(table.columns, *cells, strict=True):
            shown.add_row(column, *figures)
    return shown


def _name(row: ablations.Row) -> str:
    return ", ".join(part for part in (row.method, row.data) if part)


def _print_claims(console: Console, record: ablations.Record) -> None:
    """Print what became of the paper's claims."""
    shown = Table(title="Claims of the paper", box=box.SIMPLE_HEAD, title_justify="left")
    for column in ("claim", "reported", "here", ""):
        shown.add_column(column, overflow="fold")
    for claim in record.outcome.claims:
        outcome = Text(claim.verdict, "green" if claim.reproduced else "red")
        shown.add_row(claim.claim, claim.paper, claim.measured, outcome)
    console.print(shown)


def _draw(folder: Path, record: ablations.Record) -> list[Path]:
    """Write the chart ``NAME.png``; without the extra ``viz`` say what it needs."""
    if not can_draw():
        tell(Finding("no_figures", "note"))
        return []
    from skelsplat import viz  # matplotlib takes long to load, and --help does without

    panels = [
        viz.Panel(
            table.title,
            table.corner,
            table.unit,
            table.columns,
            [
                viz.Line(
                    _name(row),
                    [float("nan") if value is None else value for value in row.values],
                    row.origin != "measured",
                )
                for row in table.rows
            ],
        )
        for table in record.outcome.tables
        if table.chart
    ]
    return [viz.write_panels(folder / f"{record.ablation.name}.png", panels, caption=record.line)]
