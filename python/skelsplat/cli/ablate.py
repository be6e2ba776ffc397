"""``skelsplat ablate``: one ablation of the paper, with the paper's figures next to ours."""

from __future__ import annotations

import contextlib
import shlex
import sys
from functools import partial
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.progress import TimeElapsedColumn
from rich.text import Text

from skelsplat import datasets
from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.datasets import INIT_SIGMA, LENS, SETTINGS, reader_options
from skelsplat.cli.evaluate import print_experiment, print_report
from skelsplat.cli.output import progress
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_table
from skelsplat.evaluation import ablations
from skelsplat.evaluation.ablations import Source
from skelsplat.run.folder import output_folder

# Beyond so many settings they become rows.
_MOST_COLUMNS = 6

EPILOG = (
    "Without --data the data are simulated, which every table says; they are made in memory from the seed."
)

OPTIONS = (
    *rows("", f"NAME  {', '.join(ablations.names)}."),
    *rows(
        "Data",
        """
        --data DATASET FOLDER  A data set on disk.
        --detections DETECTOR  Detections of the data set; may be repeated.
        """,
        data={"kind": tuple[str, Path]},
        detections={"many": True},
    ),
    SETTINGS,
    *rows(
        "Data",
        """
        --poses N  Poses of each data set, evenly from its takes. [so many that it ends within about a minute]
        --full  All poses.
        --seed S  Seed of all random numbers. [= 0]
        """,
        poses={"kind": int, "limits": {"min": 1}},
        seed={"kind": int, "default": 0, "limits": {"min": 0}},
    ),
    LENS,
    *rows(
        "Method",
        "--start paper|dlt|fusion  Initial poses; paper: as in the paper's experiment. [= paper]",
        start=lambda option, name: options.one_of(option, name, ("paper", "dlt", "fusion")),
    ),
    INIT_SIGMA,
    *rows(
        "Output", "-o, --output FOLDER  Write NAME.md, .csv, .json and .png into this folder.", output=Path
    ),
    options.QUIET,
    options.AS_JSON,
)


@takes(*OPTIONS)
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
    quiet: bool,
    as_json: bool,
    **given: Any,
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
    choices = {"poses": None if full else poses or ablation.poses, "undistort": protocol, **given}
    if data is not None:
        dataset = options.one_of("--data", data[0], datasets.names())
        choices |= {"dataset": dataset, "root": data[1], "detectors": detections}
        choices["options"] = reader_options(set, dataset)
    elif detections or set:
        expected = "expected a data set for --detections and --set, got none"
        raise typer.BadParameter(expected, param_hint="--data")
    place = contextlib.nullcontext() if output is None else output_folder(output)
    with place, progress("poses", first="reading", shown=not quiet, time=TimeElapsedColumn()) as bar:
        command = shlex.join(["skelsplat", *sys.argv[1:]])
        record = ablation.run(Source(progress=bar, **choices), command=command)
    report = record.report()
    files = [] if output is None else report.write(output, name, f"{name}.png")
    print_report(report, partial(_print_record, record), output, files, quiet=quiet, as_json=as_json)


def _print_record(record: ablations.Record, console: Console) -> None:
    """Print tables, each with its source under it, claims and notes.

    The rows of a table are methods; or its columns, if there are too many settings for the width.
    """
    for table in record.outcome.tables:
        print_experiment(console, table.turned() if len(table.columns) > _MOST_COLUMNS else table)
        console.print(record.source.line(), style="yellow" if record.source.simulated else "")
        console.print()
    shown = new_table("Claims of the paper", "claim")
    shown.columns[0].overflow = "fold"
    shown.add_column("method, data")
    shown.add_column("", no_wrap=True)
    for claim in record.outcome.claims:
        shown.add_row(claim.claim, claim.data, Text(claim.verdict, "green" if claim.reproduced else "red"))
    print_table(console, shown)
    for note in record.outcome.notes:
        console.print(f"· {note}", style="dim")
