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
from skelsplat.cli.evaluate import print_experiment
from skelsplat.cli.findings import telling
from skelsplat.cli.output import described, print_json
from skelsplat.cli.table import new_table, print_table, wide_console
from skelsplat.evaluation import ablations
from skelsplat.evaluation.ablations import Choices, OnDisk, Source
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM
from skelsplat.findings import Finding
from skelsplat.run.folder import output_folder

_data, _method, _output = (
    partial(typer.Option, rich_help_panel=panel) for panel in ("Data", "Method", "Output")
)
# Beyond so many settings they become rows.
_MOST_COLUMNS = 6

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
        on_disk = None
        if data is not None:
            dataset = options.one_of("--data", data[0], datasets.names())
            settings = reader_options(setting or (), dataset)
            on_disk = OnDisk(dataset, data[1], tuple(detections or ()), settings)
        elif detections or setting:
            expected = "expected a data set for --detections and --set, got none"
            raise typer.BadParameter(expected, param_hint="--data")
        command = shlex.join(["skelsplat", *sys.argv[1:]])
        record = ablations.run(name, Source(choices, on_disk, progress), command=command)
    report = record.report()
    files = [] if out is None else report.write(out, name, f"{name}.png")
    if files and not files[-1].endswith(".png"):
        telling(quiet=quiet)(Finding("no_figures", "note"))
    if as_json:
        print_json(dict(report.values))
    elif not quiet:
        console = wide_console()
        _print_record(console, record)
        if files:
            console.print(f"{out}: {', '.join(files)}")


def _print_record(console: Console, record: ablations.Record) -> None:
    """Print tables, each with its source under it, claims and notes.

    The rows of a table are methods; or its columns, if there are too many settings for the width.
    """
    for table in record.outcome.tables:
        print_experiment(console, table.turned() if len(table.columns) > _MOST_COLUMNS else table)
        console.print(record.line, style="yellow" if record.simulated else "")
        console.print()
    shown = new_table("Claims of the paper", "claim")
    shown.columns[0].overflow = "fold"
    for column in ("reported", "here", ""):
        shown.add_column(column, no_wrap=not column)
    for claim in record.outcome.claims:
        outcome = Text(claim.verdict, "green" if claim.reproduced else "red")
        shown.add_row(claim.claim, claim.paper, claim.measured, outcome)
    print_table(console, shown)
    for note in record.notes:
        console.print(f"· {note}", style="dim")
