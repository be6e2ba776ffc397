"""``skelsplat datasets``: which data sets can be read, and whether one on disk is whole and usable."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from skelsplat import datasets
from skelsplat.cli import options
from skelsplat.cli._dataset_report import print_list, print_report
from skelsplat.cli.config import Application
from skelsplat.cli.output import print_json
from skelsplat.datasets import _registry as registry
from skelsplat.exceptions import InvalidInputError

app = Application(
    help="Data sets with ground truth: list them, check one on disk.\n\n[bold]Examples[/bold]\n\n"
    "skelsplat datasets list\n\nskelsplat datasets check human36m data/human36m",
    invoke_without_command=True,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

Name = Annotated[str, typer.Argument(metavar="NAME", help=", ".join(datasets.names()) + ".")]
Root = Annotated[Path, typer.Argument(readable=False, metavar="ROOT", help="Folder of the data set.")]
Format = Annotated[
    str | None, typer.Option(metavar="NAME", help="Layout on disk.", show_default="as the files say")
]
Detector = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Which detections, such as metrabs, cpn.", show_default="those there"),
]
Detections = Annotated[
    Path | None, typer.Option(metavar="PATH", help="Detections that are kept apart from the data.")
]
Other = Annotated[
    list[str] | None,
    typer.Option(
        "--option",
        metavar="NAME=VALUE",
        help="Another option of the data set; a list is a,b or a, with one entry. Can be repeated.",
    ),
]


_NamesOnly = Annotated[
    bool,
    typer.Option("--quiet", "-q", metavar="", help="Only the names, a line each.", rich_help_panel="Output"),
]


@app.callback()
def _root(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command("list")
def list_(quiet: _NamesOnly = False, as_json: options.AsJson = False) -> None:
    """List the data sets that can be read.

    [bold]Examples[/bold]

    skelsplat datasets list

    skelsplat datasets list --json
    """
    entries = [
        {
            "name": name,
            "description": registry.reader(name).DESCRIPTION,
            "options": list(registry.options_of(name)),
        }
        for name in datasets.names()
    ]
    if as_json:
        print_json(entries)
    elif quiet:
        typer.echo("\n".join(datasets.names()))
    else:
        print_list(_console(), entries)


@app.command("check")
def check(
    name: Name,
    root: Root,
    format: Format = None,
    detector: Detector = None,
    detections: Detections = None,
    option: Other = None,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Say what is there, what is missing, and whether units, joints and cameras are right.

    The ground truth is projected onto the detections of up to 24 frames of
    every take. Exit status 1 if something is missing or cannot be used.

    [bold]Examples[/bold]

    skelsplat datasets check human36m data/human36m --detector cpn

    skelsplat datasets check human36m-occ data --option variant=3-hard

    skelsplat datasets check panoptic data/panoptic --json

    skelsplat datasets check human36m labels.npy --option subjects=S9,S11
    """
    if name not in datasets.names():
        raise typer.BadParameter(
            f"expected one of {', '.join(datasets.names())}, got {name!r}", param_hint="NAME"
        )
    given = {"format": format, "detector": detector, "detections": detections}
    chosen = {key: value for key, value in given.items() if value is not None}
    chosen.update(_parsed(text) for text in option or [])
    try:
        report = datasets.check(name, root, **chosen)
    except InvalidInputError as error:
        raise typer.BadParameter(str(error), param_hint="options") from error
    if as_json:
        print_json(report.to_dict())
    elif not (quiet and report.ok and not report.findings):
        print_report(_console(), report)
    if not report.ok:
        raise typer.Exit(1)


def _console() -> Console:
    return Console(highlight=False, markup=False)


def _parsed(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``: a whole number, a list with commas, or text."""
    name, equals, value = text.partition("=")
    if not (equals and name.isidentifier()):
        raise typer.BadParameter(f"expected NAME=VALUE, got {text!r}", param_hint="--option")
    if "," in value:
        return name, [_scalar(entry) for entry in value.split(",") if entry]
    return name, _scalar(value)


def _scalar(text: str) -> int | str:
    return int(text) if text.isdecimal() else text
