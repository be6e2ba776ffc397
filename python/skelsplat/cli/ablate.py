"""``skelsplat ablate``: one ablation of the paper, with the paper's figures beside ours."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from skelsplat.cli import options as common
from skelsplat.cli._ablation_view import draw, print_record, progress_bar
from skelsplat.cli.output import print_json
from skelsplat.evaluation import ablations
from skelsplat.evaluation.ablations import Choices, OnDisk, Simulated, Source
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM
from skelsplat.exceptions import InvalidInputError

_DATA, _METHOD, _OUTPUT = "Data", "Method", "Output"
# Of tables that go into a file or a pipe.
_WIDTH = 100

EPILOG = (
    "Without --data the data are simulated, which every table says; they are made in memory from the seed."
)

Name = Annotated[str, typer.Argument(metavar="NAME", help=f"{', '.join(ablations.names)}.")]
Data = Annotated[
    tuple[str, Path] | None,
    typer.Option(metavar="DATASET FOLDER", help="A data set on disk.", rich_help_panel=_DATA),
]
Detections = Annotated[
    list[str] | None,
    typer.Option(
        metavar="DETECTOR", help="Detections of the data set; may be repeated.", rich_help_panel=_DATA
    ),
]
Setting = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="An option of the data set's reader, such as variant=3; may be repeated.",
        rich_help_panel=_DATA,
    ),
]
Poses = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Poses of each data set, evenly from its takes.",
        show_default="so many that it ends within about a minute",
        rich_help_panel=_DATA,
    ),
]
Full = Annotated[bool, typer.Option("--full", metavar="", help="All poses.", rich_help_panel=_DATA)]
Seed = Annotated[
    int, typer.Option(min=0, metavar="S", help="Of all that is drawn at random.", rich_help_panel=_DATA)
]
Start = Annotated[
    Literal["paper", "dlt", "fusion"],
    typer.Option(help="Initial poses; paper: as in the paper's experiment.", rich_help_panel=_METHOD),
]
InitSigma = Annotated[
    float,
    typer.Option(
        min=0.1,
        metavar="MM",
        help="Standard deviation per axis of fused poses where they are a prior.",
        rich_help_panel=_METHOD,
    ),
]
Lens = Annotated[
    Literal["as-paper", "undistorted"],
    typer.Option("--protocol", help="as-paper: lens distortion is ignored.", rich_help_panel=_METHOD),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FOLDER",
        help="Write NAME.md, .csv, .json and .png into this folder.",
        rich_help_panel=_OUTPUT,
    ),
]


def ablate(
    name: Name,
    data: Data = None,
    detections: Detections = None,
    setting: Setting = None,
    poses: Poses = None,
    full: Full = False,
    seed: Seed = 0,
    start: Start = "paper",
    init_sigma: InitSigma = DEFAULT_INIT_SIGMA_MM,
    protocol: Lens = "undistorted",
    out: Out = None,
    quiet: common.Quiet = False,
    as_json: common.AsJson = False,
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
    ablation = _known(name)
    choices = Choices(
        poses=None if full else poses or ablation.poses,
        seed=seed,
        start=start,
        init_sigma_mm=init_sigma,
        undistort=protocol == "undistorted",
    )
    with progress_bar(shown=not quiet) as progress:
        source: Source
        if data is None:
            if detections or setting:
                raise typer.BadParameter(
                    "expected a data set for --detections and --set, got none", param_hint="--data"
                )
            source = Simulated(choices, progress)
        else:
            source = OnDisk(choices, data[0], data[1], detections or (), _pairs(setting or ()), progress)
        record = ablations.run(name, source, command=shlex.join(["skelsplat", *sys.argv[1:]]))
    files = [] if out is None else [*ablations.write(out, record), *draw(out, record)]
    if as_json:
        print_json(ablations.as_dict(record))
    elif not quiet:
        console = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else _WIDTH)
        print_record(console, record)
        if files:
            console.print(f"{out}: {', '.join(file.name for file in files)}")


def _known(name: str) -> ablations.Ablation:
    try:
        return ablations.get(name)
    except InvalidInputError as error:
        raise typer.BadParameter(str(error).removeprefix("name: "), param_hint="NAME") from error


def _pairs(given: list[str] | tuple[()]) -> dict[str, str | int]:
    """Split KEY=VALUE; whole numbers become such."""
    out: dict[str, str | int] = {}
    for text in given:
        key, equals, value = text.partition("=")
        if not equals:
            raise typer.BadParameter(f"expected KEY=VALUE, got {text!r}", param_hint="--set")
        out[key] = int(value) if value.lstrip("-").isdecimal() else value
    return out
