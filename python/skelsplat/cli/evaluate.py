"""``skelsplat evaluate``: methods on a data set with ground truth, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from skelsplat import datasets
from skelsplat.cli import options
from skelsplat.cli._evaluation import WIDTH, print_evaluation, progress, write_evaluation
from skelsplat.cli.config import NAME_OR_PATH
from skelsplat.cli.output import print_json
from skelsplat.cli.table import tell
from skelsplat.datasets import Dataset
from skelsplat.datasets._registry import options_of
from skelsplat.evaluation import export, methods, protocols, report
from skelsplat.evaluation._protocol import Protocol
from skelsplat.findings import collected_warnings
from skelsplat.run.folder import output_folder

EPILOG = (
    "Results: report.md, report.csv, report.json and bars.png in FOLDER; the poses of every take under "
    "FOLDER/runs, from where a stopped evaluation goes on. Exit status: 0 ok, 1 failed, 2 bad usage, 130 "
    "interrupted."
)
_LENSES = {"undistorted": True, "as-paper": False}
_DATA, _METHODS, _OUTPUT = "Data and protocol", "Method", "Output"

Name = Annotated[str, typer.Argument(metavar="DATASET", help=", ".join(datasets.names()) + ".")]
Root = Annotated[Path, typer.Argument(readable=False, metavar="ROOT", help="Its folder.")]
Detections = Annotated[
    str | None,
    NAME_OR_PATH,
    typer.Option(
        metavar="WHICH",
        help="Name of a detector that the data set has, or a folder of detections.",
        show_default="the reader's choice",
        rich_help_panel=_DATA,
    ),
]
Lens = Annotated[
    str,
    typer.Option(
        "--protocol",
        metavar="undistorted|as-paper",
        help="Remove lens distortion from detections, or ignore it as published evaluations do.",
        rich_help_panel=_DATA,
    ),
]
Views = Annotated[
    int | None,
    typer.Option(
        min=2,
        metavar="M",
        help="Number of views, where the protocol has a choice: panoptic 4 to 8, occlusion-person 4 or 8.",
        show_default="the protocol's",
        rich_help_panel=_DATA,
    ),
]
Every = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="K",
        help="One frame in K of each take.",
        show_default="the protocol's",
        rich_help_panel=_DATA,
    ),
]
Counting = Annotated[
    str,
    typer.Option(
        metavar="all|adafuse",
        help="adafuse counts only joints that at least two views see unoccluded.",
        rich_help_panel=_DATA,
    ),
]
Setting = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="An option of the data set's reader: format=karfly, subjects=S9,S11. May be repeated.",
        rich_help_panel=_DATA,
    ),
]
MethodNames = Annotated[
    list[str] | None,
    typer.Option(
        "--methods",
        "-m",
        metavar="NAMES",
        help=f"Comma between them, or repeated: {', '.join(methods.names)}; or all.",
        show_default="all that the data allow but paper",
        rich_help_panel=_METHODS,
    ),
]
Start = Annotated[
    str | None,
    typer.Option(
        metavar="dlt|fusion|none",
        help="Where annealed, paper-closed-form and paper start.",
        show_default="none; the paper's for the last two",
        rich_help_panel=_METHODS,
    ),
]
InitSigma = Annotated[
    float,
    typer.Option(
        metavar="MM",
        help="Standard deviation per axis of the fused start of annealed-prior.",
        rich_help_panel=_METHODS,
    ),
]
Seed = Annotated[
    int, typer.Option(min=0, metavar="S", help="Of the pairs RANSAC draws.", rich_help_panel=_METHODS)
]
Out = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FOLDER",
        help="Folder for results.",
        show_default="skelsplat-evaluation/NAME",
        rich_help_panel=_OUTPUT,
    ),
]
PerJoint = Annotated[
    bool,
    typer.Option("--per-joint", metavar="", help="Print the table of joints too.", rich_help_panel=_OUTPUT),
]


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
    setting: Setting = None,
    start: Start = None,
    init_sigma: InitSigma = methods.DEFAULT_INIT_SIGMA_MM,
    seed: Seed = 0,
    threads: options.Threads = None,
    out: Out = None,
    per_joint: PerJoint = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Run methods on a data set with ground truth and print their errors beside published ones.

    An evaluation that was stopped goes on where it was when it is started
    again with the same options; changed options or data are computed anew.

    [bold]Examples[/bold]

    skelsplat synth human36m-like data/h36m-like

    skelsplat evaluate synthetic data/h36m-like

    skelsplat evaluate human36m data/h36m --detections cpn --protocol as-paper

    skelsplat evaluate panoptic data/panoptic --views 6 -m annealed,dlt
    """
    names = _method_names(method)
    chosen = methods.Options(
        undistort=_LENSES[_one_of("--protocol", lens, tuple(_LENSES))],
        start=None if start is None else _one_of("--start", start, methods.STARTS),
        init_sigma_mm=_positive("--init-sigma", init_sigma),
        seed=seed,
        n_threads=threads,
    )
    _one_of("DATASET", dataset, datasets.names())
    _one_of("--counting", counting, ("all", "adafuse"))
    with collected_warnings(tell):
        data = datasets.read(dataset, root, **_reader_options(dataset, detections, views, setting or []))
        for finding in datasets.verify(data):
            typer.echo(f"warning: {', '.join(finding.subject.files)}: {finding.text}", err=True)
        rules = protocols.get(data.name).with_options(n_views=views, every=every, counting=counting)
        folder = Path("skelsplat-evaluation") / data.name if out is None else out
        with output_folder(folder):
            found = _run(data, names, chosen, rules, folder, shown=not quiet)
            files = write_evaluation(folder, found)
    if as_json:
        print_json(export.as_dict(found))
    elif not quiet:
        console = Console(highlight=False, markup=False)
        console.width = min(console.width, WIDTH) if console.is_terminal else WIDTH
        print_evaluation(console, found, per_joint=per_joint)
        console.print(f"Wrote to {folder}/: {', '.join(files)}")


def _run(
    data: Dataset,
    names: Sequence[str],
    chosen: methods.Options,
    rules: Protocol,
    folder: Path,
    *,
    shown: bool,
) -> report.Evaluation:
    with progress(shown=shown) as hear:
        return report.evaluate(data, names, chosen, protocol=rules, folder=folder / "runs", report=hear)


def _method_names(given: Sequence[str] | None) -> list[str]:
    names = [name.strip() for text in given or () for name in text.split(",") if name.strip()]
    if names == ["all"]:
        return list(methods.names)
    for name in names:
        _one_of("--methods", name, methods.names)
    return names


def _reader_options(
    dataset: str, detections: str | None, views: int | None, settings: Sequence[str]
) -> dict[str, Any]:
    """Return the options of the reader: those given as KEY=VALUE, the detections, the views."""
    known = options_of(dataset)
    found: dict[str, Any] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        if not equals or key not in known:
            raise typer.BadParameter(
                f"expected KEY=VALUE with a KEY among {', '.join(known)}, got {text!r}", param_hint="--set"
            )
        parts = [_value(part) for part in value.split(",") if part]
        found[key] = parts if "," in value else _value(value)
    if detections is not None:
        is_path = Path(detections).exists() and "detections" in known
        found["detections" if is_path else "detector"] = Path(detections) if is_path else detections
    if views is not None and "views" in known and dataset != "synthetic":  # there the protocol chooses
        found.setdefault("views", views)
    return found


def _value(text: str) -> int | str:
    return int(text) if text.lstrip("-").isdecimal() else text


def _one_of(option: str, value: str, choices: Sequence[str]) -> str:
    if value not in choices:
        raise typer.BadParameter(f"expected one of {', '.join(choices)}, got {value!r}", param_hint=option)
    return value


def _positive(option: str, value: float) -> float:
    if not 0 < value < float("inf"):
        raise typer.BadParameter(f"expected a positive number, got {value:g}", param_hint=option)
    return value
