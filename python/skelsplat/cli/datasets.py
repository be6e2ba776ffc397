"""``skelsplat datasets`` and ``synth``: data sets that can be read, checked on disk, and simulated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.text import Text

from skelsplat import datasets, synthetic
from skelsplat._escape import escaped
from skelsplat.cli.command import Answer, Command, Group, answers
from skelsplat.cli.output import say
from skelsplat.cli.rows import choice, one_of, rows
from skelsplat.cli.table import new_table, print_table
from skelsplat.datasets import Dataset, Report
from skelsplat.datasets import _registry as registry
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic.sets import PEOPLE_SET

_MOST_FILES = 12

app = typer.Typer(
    cls=Group,
    help="Data sets with ground truth: list them, check one on disk.\n\n[bold]Examples[/bold]\n\n"
    "skelsplat datasets list\n\nskelsplat datasets check human36m data/human36m",
    invoke_without_command=True,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

LENSES = {"undistorted": True, "as-paper": False}
SETTINGS, LENS, INIT_SIGMA = rows(
    f"""
    Data:
    --set KEY=VALUE  An option of the data set's reader: format=videopose3d, subjects=S9,S11. Repeatable.
    --protocol {"|".join(LENSES)}  Remove lens distortion from detections, or ignore it as published
        evaluations do. [= undistorted]
    Method:
    --init-sigma-mm MM  Standard deviation per axis of fused poses where they are a prior.
    """,
    set={"many": True},
    protocol=lambda option, name: LENSES[one_of(option, name, tuple(LENSES))],
    init_sigma_mm={"kind": float, "default": DEFAULT_INIT_SIGMA_MM},
)
"""Options of evaluate and ablate, the first of `check` too."""


@app.callback()
def _root(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command("list", cls=Command)
@answers(*rows("Output:\n--quiet, -q  Only the names, a line each."))
def list_() -> Answer:
    """List the data sets that can be read.

    [bold]Examples[/bold]

    skelsplat datasets list
    """
    entries = [
        {"name": name, "description": reader.description, "options": list(registry.options_of(name))}
        for name, reader in registry.READERS.items()
    ]

    def show(console: Console) -> None:
        table = new_table(None, "data set")
        table.add_column("what it is, and the options of its reader")
        for name, reader in registry.READERS.items():
            table.add_row(name, Text(f"{reader.description}\n{', '.join(registry.options_of(name))}"))
        print_table(console, table)

    return Answer(entries, show, lambda _: say(*datasets.names()))


@app.command("check", cls=Command)
@answers(
    *rows(
        f"""
        NAME  {", ".join(datasets.names())}.
        ROOT  Folder of the data set.
        --format NAME  Layout on disk. [as the files say]
        --detector NAME  Which detections, such as metrabs, cpn. [those there]
        --detections PATH  Detections that are kept apart from the data.
        """,
        name=choice(*datasets.names()),
    ),
    SETTINGS,
)
def check(*, name: str, root: Path, set: list[str], **chosen: Any) -> Answer:
    """Check a data set: what it contains, what is missing, and whether units, joints and cameras are right.

    The ground truth is projected onto the detections of up to 24 frames of
    every take. Exit status 1 if something is missing or cannot be used.

    [bold]Examples[/bold]

    skelsplat datasets check human36m data/human36m --detector cpn

    skelsplat datasets check human36m data/human36m --set subjects=S9,S11
    """
    chosen.update(reader_options(set, name))
    try:
        report = datasets.check(name, root, **chosen)
    except InvalidInputError as error:
        raise typer.BadParameter(str(error), param_hint="options") from error
    show = partial(_print_report, report)
    fine = report.ok and not report.findings
    return Answer(report.to_dict(), show, None if fine else show, status=0 if report.ok else 1)


def reader_options(given: Sequence[str], dataset: str) -> dict[str, Any]:
    """Return options of a data set's reader from KEY=VALUE: whole numbers, lists with commas, or texts."""
    known, found = registry.options_of(dataset), {}
    for text in given:
        key, equals, value = text.partition("=")
        if not equals or key not in known:
            expected = f"KEY=VALUE with a KEY among {', '.join(known)}"
            raise typer.BadParameter(f"expected {expected}, got {text!r}", param_hint="--set")
        parts = [int(part) if part.lstrip("-").isdecimal() else part for part in value.split(",")]
        found[key] = [part for part in parts if part != ""] if "," in value else parts[0]
    return found


def _print_report(report: Report, console: Console) -> None:
    """Print what `datasets.check` found."""
    layout = f", format {report.survey.format}" if report.survey.format else ""
    console.print(Text.assemble((report.name, "bold"), escaped(f" in {report.root}{layout}")))
    there, missing = report.survey.there, report.survey.missing
    console.print(f"{len(there)} files and folders are there, {len(missing)} missing.")
    for path, what in missing[:_MOST_FILES]:
        console.print(f"  missing: {what}, expected at {path}", style="yellow", soft_wrap=True)
    if len(missing) > _MOST_FILES:
        console.print(f"  … and {len(missing) - _MOST_FILES} more (--json lists all)", style="yellow")
    if report.dataset is not None:
        _print_dataset(console, report.dataset)
        known = [f"{name} {px:.1f}" for name, px in report.errors.items() if math.isfinite(px)]
        errors = f"Truth projected onto the detections, median error in px: {', '.join(known)}."
        console.print(errors if known else "No detections: units and cameras are judged by the truth alone.")
    if (error := report.error) is not None:
        console.print(f"✗ cannot be read: {error}", style="red", soft_wrap=True)
    for finding in report.findings:
        mark, style = ("✗", "red") if finding.severity == "error" else ("!", "yellow")
        console.print(f"{mark} {finding.text}", style=style)
        console.print(f"  {', '.join(finding.subject.files)}", style="dim", soft_wrap=True)
    if report.ok:
        verdict = f"All there and usable{', with warnings' if report.findings else ''}."
    elif error is not None or any(finding.severity == "error" for finding in report.findings):
        verdict = "These data cannot be used as they are."
    else:
        verdict = "Something is missing; what is there can be used."
    console.print(verdict, style="green" if report.ok else "red")


def _print_dataset(console: Console, dataset: Dataset) -> None:
    table = new_table(None, "subject", ("takes", "frames", "views", "joints", "detected", "truth"))
    for subject in dict.fromkeys(take.subject for take in dataset):
        takes = [take for take in dataset if take.subject == subject]
        views = sorted({len(take.rig) for take in takes})
        table.add_row(
            subject,
            str(len(takes)),
            str(sum(map(len, takes))),
            "–".join(map(str, views[:: max(1, len(views) - 1)])),
            str(dataset.layout.n_joints),
            _percent([take.detected for take in takes]),
            _percent([take.labelled for take in takes]),
        )
    print_table(console, table)
    console.print(f"{dataset.source}.")
    for note in dataset.notes:
        console.print(f"Note: {note}.")


def _percent(shares: Sequence[float | None]) -> str:
    known = [share for share in shares if share is not None]
    return f"{100 * sum(known) / len(known):.1f} %" if known else "–"


NAMES = (*synthetic.set_names, PEOPLE_SET)
_DEFAULTS = {"people": 3, "views": 4, "scenes": 5, "frames": 300}

_SYNTH_OPTIONS = rows(
    f"""
    NAME  {", ".join(NAMES)}.
    FOLDER  Folder to create; must not exist or be empty.
    --poses N  Poses over all takes. [that of the data set]
    --seed SEED  Same seed, same files. [= 0]
    --openpose  Also write OpenPose JSON: many small files.
    Options of {PEOPLE_SET}:
    --people Q  People, 2 to 6. [{_DEFAULTS["people"]}]
    --views M  Cameras, 3 to 8. [{_DEFAULTS["views"]}]
    --scenes K  Number of scenes. [{_DEFAULTS["scenes"]}]
    --frames F  Frames of each scene, at 30 Hz. [{_DEFAULTS["frames"]}]
    """,
    name=choice(*NAMES),
    **dict.fromkeys(_DEFAULTS, int),
)


@answers(*_SYNTH_OPTIONS)
def synth(
    *, name: str, folder: Path, seed: int, poses: int | None = None, openpose: bool, **of_people: int
) -> Answer:
    """Write a simulated data set: known poses, simulated detections of two detectors.

    Rig, joints, actions and number of poses are like those of the data set
    in the name; people has scenes in which several people meet. Results on it
    are results on simulated detections, and must be reported as such.

    [bold]Examples[/bold]

    skelsplat synth dome data/dome --poses 100 --openpose

    skelsplat synth people data/people --people 4 --views 5 --scenes 10
    """
    if name == PEOPLE_SET and poses is not None:
        raise typer.BadParameter(f"does not apply to {PEOPLE_SET}, but --frames does", param_hint="--poses")
    for key in of_people if name != PEOPLE_SET else ():
        raise typer.BadParameter(f"does not apply to {name}, only to {PEOPLE_SET}", param_hint=f"--{key}")
    if name == PEOPLE_SET:
        data = synthetic.simulate_people_set(**{**_DEFAULTS, **of_people}, seed=seed)
        what = ", ".join(f"{key} {data.parameters[key]}" for key in _DEFAULTS)
    else:
        data = synthetic.simulate_set(name, poses=poses, seed=seed)
        what = f"{data.parameters['poses']} poses in {len(data.recordings)} takes"
    write_simulated(folder, data, openpose=openpose)
    detectors = " and ".join(data.parameters["detectors"])
    sentence = f"{folder}: {name} (simulated), {what}, detectors {detectors}, seed {seed}"
    document = {"name": name, "takes": len(data.recordings), "parameters": data.parameters}
    return Answer({"folder": str(folder), **document}, lambda _: say(sentence))
