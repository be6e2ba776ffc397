"""``skelsplat ablate``: one ablation of the paper, with the paper's figures next to ours."""

from __future__ import annotations

import contextlib
import shlex
import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.progress import TimeElapsedColumn
from rich.text import Text

from skelsplat import datasets
from skelsplat.cli import options
from skelsplat.cli.datasets import LENSES, InitSigma, Lens, Settings, reader_options
from skelsplat.cli.findings import telling
from skelsplat.cli.output import described, print_json
from skelsplat.cli.table import in_parts, new_table, print_parts, print_table, wide_console
from skelsplat.evaluation import ablations
from skelsplat.evaluation.ablations import Choices, OnDisk, Simulated, Source
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM
from skelsplat.findings import Finding
from skelsplat.run.folder import output_folder

_data, _method, _output = (
    partial(typer.Option, rich_help_panel=panel) for panel in ("Data", "Method", "Output")
)
# Beyond so many settings they become rows.
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
        undistort=LENSES[options.one_of("--protocol", protocol, tuple(LENSES))],
    )
    place = contextlib.nullcontext() if out is None else output_folder(out)
    with place, described("reading", shown=not quiet, time=TimeElapsedColumn()) as progress:
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
    files = [] if out is None else ablations.write(out, record)
    if files and files[-1].suffix != ".png":
        telling(quiet=quiet)(Finding("no_figures", "note"))
    if as_json:
        print_json(ablations.as_dict(record))
    elif not quiet:
        console = wide_console()
        _print_record(console, record)
        if files:
            console.print(f"{out}: {', '.join(file.name for file in files)}")


def _print_record(console: Console, record: ablations.Record) -> None:
    """Print tables, each with its source under it, claims and notes."""
    for table in record.outcome.tables:
        _print_figures(console, table)
        console.print(record.line, style="yellow" if record.simulated else "")
        console.print()
    _print_claims(console, record)
    for note in (*record.notes, *record.sources):
        console.print(f"· {note}", style="dim")


def _print_figures(console: Console, table: ablations.Table) -> None:
    """Print a table whose rows are methods; or its columns, if there are too many settings for the width."""
    lines = [[ablations.cell(value, table.digits) for value in row.values] for row in table.rows]
    styles = [_STYLES[row.origin] for row in table.rows]
    heads, names = list(table.columns), [row.name for row in table.rows]
    turned = len(heads) > _MOST_COLUMNS
    if turned:
        heads, names = [name.replace(", ", ",\n") for name in names], heads
        lines = [list(line) for line in zip(*lines, strict=True)]

    shown = new_table(f"{table.title} ({table.unit})", table.corner, heads)
    for column, style in zip(shown.columns[1:], styles if turned else (), strict=False):
        column.style = style
    for k, (name, line) in enumerate(zip(names, lines, strict=True)):
        shown.add_row(name, *line, style=None if turned else styles[k])
    print_parts(console, len(heads), partial(in_parts, shown, 1))


def _print_claims(console: Console, record: ablations.Record) -> None:
    """Print what became of the paper's claims."""
    shown = new_table("Claims of the paper", "claim")
    shown.columns[0].overflow = "fold"
    for column in ("reported", "here", ""):
        shown.add_column(column, no_wrap=not column)
    for claim in record.outcome.claims:
        outcome = Text(claim.verdict, "green" if claim.reproduced else "red")
        shown.add_row(claim.claim, claim.paper, claim.measured, outcome)
    print_table(console, shown)
