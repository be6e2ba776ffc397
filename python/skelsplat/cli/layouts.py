"""``skelsplat layouts``: the built-in joint layouts, and what one of them, or of a file, consists of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import typer
from rich.columns import Columns
from rich.console import Console
from rich.text import Text

import skelsplat as sk
from skelsplat._escape import escaped
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.output import say
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_table
from skelsplat.exceptions import InvalidInputError
from skelsplat.io import read_layout

_EPILOG = (
    "A layout file names the joints in the order of the arrays; limbs, left–right pairs, symmetric limbs and "
    "lengths of bones may follow. Edit what --toml prints to make your own, and give it to --layout."
)


@answers(
    *rows(
        """
        NAME  A built-in layout, a layout file (.toml), or a file with a skeleton: SLEAP's h5, DeepLabCut's
            h5, csv or config.yaml. Without it, all built-in layouts are listed. [optional]
        --toml  Print the layout as a layout file.
        --quiet, -q  Only the names of layouts or joints, a line each.
        """
    ),
    epilog=_EPILOG,
)
def layouts(name: str | None = None, *, toml: bool) -> Answer:
    """List the joint layouts, or explain one: joints, limbs, symmetric pairs, bones.

    [bold]Examples[/bold]

    skelsplat layouts halpe26

    skelsplat layouts dlc-project/config.yaml --toml > mouse.toml
    """
    if name is None:
        if toml:
            raise typer.BadParameter("expected the name of one layout as well", param_hint="--toml")
        every = [(sk.layouts.get(name), sk.layouts.about(name)) for name in sk.layouts.names]
        documents = [_document(*one) for one in every]
        return Answer(documents, partial(_list, every), lambda _: say(*sk.layouts.names))
    try:
        layout = read_layout(name)
    except InvalidInputError as error:
        raise typer.BadParameter(error.reason, param_hint="NAME") from error
    described = name.lower() in sk.layouts.names or name.lower().endswith(".toml")
    about = sk.layouts.about(name) if described else sk.layouts.About()
    if toml:
        write = partial(typer.echo, sk.layouts.to_toml(layout, about), nl=False)
        return Answer(_document(layout, about), lambda _: write(), lambda _: write())
    return Answer(_document(layout, about), partial(_explain, layout, about), lambda _: say(*layout.joints))


def _list(every: Sequence[tuple[sk.Layout, sk.layouts.About]], console: Console) -> None:
    table = new_table(None, "layout", ("joints", "human"))
    table.add_column("detections of", overflow="fold")
    for layout, about in every:
        table.add_row(layout.name, str(layout.n_joints), "yes" if layout.human else "–", about.detectors)
    print_table(console, table)
    console.print("human: bones have the proportions of people", style="dim")


def _explain(layout: sk.Layout, about: sk.layouts.About, console: Console) -> None:
    words = f", {layout.n_joints} joints. {about.about}".rstrip()
    console.print(Text.assemble((escaped(layout.name), "bold"), escaped(words)))
    for label, text in (("Detections of", about.detectors), ("Source", about.source)):
        if text:
            console.print(f"{label}: {text}.")
    for title, parts in _parts(layout):
        console.print()
        console.print(title, style="bold")
        console.print(Columns(parts, column_first=True, padding=(0, 2)))
    console.print()
    known = "the population's proportions for a person" if layout.human else "none before the recording"
    lengths = [f"{_ends(layout, ends)} {mm:g} ± {sigma:g} mm" for ends, mm, sigma in layout.lengths]
    console.print(f"Lengths of bones: {', '.join(lengths) or known}.")


def _parts(layout: sk.Layout) -> Iterator[tuple[str, Sequence[str]]]:
    """Yield the parts of a layout that are there, with a title each."""
    digits = len(str(layout.n_joints - 1))
    yield "Joints, by index", [f"{k:>{digits}} {name}" for k, name in enumerate(layout.joints)]
    if layout.limbs:
        yield f"Limbs ({len(layout.limbs)})", [_ends(layout, limb) for limb in layout.limbs]
    if layout.angles:
        yield f"Joint angles ({len(layout.angles)})", [name for name, *_ in layout.angles]
    if layout.left_right:
        pairs = [_ends(layout, two) for two in layout.left_right]
        yield f"Left–right pairs ({len(pairs)})", pairs
    for tier in (1, 2, 3):
        equal = [(left, right) for own, left, right in layout.symmetric if own == tier]
        if equal:
            words = [f"{_ends(layout, left)} = {_ends(layout, right)}" for left, right in equal]
            yield f"Limbs of equal length, tier {tier}", words


def _ends(layout: sk.Layout, ends: Sequence[int]) -> str:
    return "–".join(layout.joints[k] for k in ends)


def _document(layout: sk.Layout, about: sk.layouts.About) -> dict[str, Any]:
    plain = ("name", "human", "joints", "limbs", "left_right", "occlusion_prone", "root")
    return {
        **{name: getattr(layout, name) for name in plain},
        **asdict(about),
        "symmetric": [{"tier": tier, "left": left, "right": right} for tier, left, right in layout.symmetric],
        "bones": [{"joints": ends, "length_mm": mm, "sigma_mm": sigma} for ends, mm, sigma in layout.lengths],
        "angles": [
            dict(zip(("name", "joints", "sign", "offset"), own, strict=True)) for own in layout.angles
        ],
    }
