"""``skelsplat layouts``: the built-in joint layouts, and what one of them, or of a file, consists of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import typer
from rich.columns import Columns
from rich.text import Text

import skelsplat as sk
from skelsplat._escape import escaped
from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.findings import tell
from skelsplat.cli.output import Terminal, print_json, say
from skelsplat.cli.rows import rows
from skelsplat.cli.table import new_table, print_table
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import collected_warnings
from skelsplat.io import read_layout

EPILOG = (
    "A layout file names the joints in the order of the arrays; limbs, left–right pairs, symmetric limbs and "
    "lengths of bones may follow. Edit what --toml prints to make your own, and give it to --layout."
)


@takes(
    *rows(
        "",
        """
        NAME  A built-in layout, a layout file (.toml), or a file with a skeleton: SLEAP's h5, DeepLabCut's
            h5, csv or config.yaml. Without it, all built-in layouts are listed. [optional]
        --toml  Print the layout as a layout file.
        --quiet, -q  Only the names of layouts or joints, a line each.
        """,
    ),
    options.AS_JSON,
)
def layouts(name: str | None = None, *, toml: bool, quiet: bool, as_json: bool) -> None:
    """List the joint layouts, or explain one: joints, limbs, symmetric pairs, bones.

    [bold]Examples[/bold]

    skelsplat layouts

    skelsplat layouts halpe26

    skelsplat layouts mouse22 --toml > mine.toml

    skelsplat layouts dlc-project/config.yaml --toml > mouse.toml

    skelsplat layouts mine.toml --json
    """
    if name is None:
        if toml:
            raise typer.BadParameter("expected the name of one layout as well", param_hint="--toml")
        _list(quiet=quiet, as_json=as_json)
        return
    if toml and as_json:
        raise typer.BadParameter("expected --toml or --json, got both", param_hint="--toml")
    with collected_warnings() as notes:
        layout = _named(name)
    described = name.lower() in sk.layouts.names or name.lower().endswith(".toml")
    about = sk.layouts.about(name) if described else sk.layouts.About()
    if toml:
        typer.echo(sk.layouts.to_toml(layout, about), nl=False)
        for note in notes:
            tell(note)
    elif as_json:
        print_json(_document(layout, about))
    elif quiet:
        say(*layout.joints)
    else:
        _explain(layout, about)


def _named(name: str) -> sk.Layout:
    try:
        return read_layout(name)
    except InvalidInputError as error:
        raise typer.BadParameter(error.reason, param_hint="NAME") from error


def _list(*, quiet: bool, as_json: bool) -> None:
    every = [(sk.layouts.get(name), sk.layouts.about(name)) for name in sk.layouts.names]
    if as_json:
        print_json([_document(layout, about) for layout, about in every])
        return
    if quiet:
        say(*sk.layouts.names)
        return
    console = Terminal()
    table = new_table(None, "layout", ("joints", "human"))
    table.add_column("detections of", overflow="fold")
    for layout, about in every:
        table.add_row(layout.name, str(layout.n_joints), "yes" if layout.human else "–", about.detectors)
    print_table(console, table)
    console.print(
        "human: bones have the proportions of people. skelsplat layouts NAME explains one; --toml prints it "
        "as a layout file, to make your own.",
        style="dim",
    )


def _explain(layout: sk.Layout, about: sk.layouts.About) -> None:
    console, names = Terminal(), layout.joints
    console.print(
        Text.assemble(
            (escaped(layout.name), "bold"), escaped(f", {layout.n_joints} joints. {about.about}".rstrip())
        )
    )
    for label, text in (("Detections of", about.detectors), ("Source", about.source)):
        if text:
            console.print(f"{label}: {text}.")
    for title, words in _parts(layout):
        console.print()
        console.print(title, style="bold")
        console.print(Columns(words, column_first=True, padding=(0, 2)))
    console.print()
    known = "the population's proportions for a person" if layout.human else "none before the recording"
    lengths = [f"{_ends(names, ends)} {mm:g} ± {sigma:g} mm" for ends, mm, sigma in layout.lengths]
    console.print(f"Lengths of bones: {', '.join(lengths) or known}.")


def _parts(layout: sk.Layout) -> Iterator[tuple[str, Sequence[str]]]:
    """Yield the parts of a layout that are there, with a title each."""
    names = layout.joints
    yield "Joints, by index", [f"{k:>{len(str(len(names) - 1))}} {name}" for k, name in enumerate(names)]
    if layout.limbs:
        yield f"Limbs ({len(layout.limbs)})", [_ends(names, limb) for limb in layout.limbs]
    if layout.left_right:
        yield f"Left–right pairs ({len(layout.left_right)})", [_ends(names, two) for two in layout.left_right]
    for tier in (1, 2, 3):
        pairs = [
            f"{_ends(names, left)} = {_ends(names, right)}"
            for t, left, right in layout.symmetric
            if t == tier
        ]
        if pairs:
            yield f"Limbs of equal length, tier {tier}", pairs


def _ends(names: Sequence[str], ends: Sequence[int]) -> str:
    return "–".join(names[k] for k in ends)


def _document(layout: sk.Layout, about: sk.layouts.About) -> dict[str, Any]:
    plain = ("name", "human", "joints", "limbs", "left_right", "occlusion_prone", "root")
    return {
        **{name: getattr(layout, name) for name in plain},
        **asdict(about),
        "symmetric": [{"tier": tier, "left": left, "right": right} for tier, left, right in layout.symmetric],
        "bones": [{"joints": ends, "length_mm": mm, "sigma_mm": sigma} for ends, mm, sigma in layout.lengths],
    }
