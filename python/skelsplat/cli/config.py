"""``--config FILE.toml`` for every command: defaults of options and arguments, from a file.

The values become click's ``default_map``, so the command line wins and click checks them. Keys at the top are
for every command that has the option; those in a table with a command's name, such as ``[refine]`` or
``[datasets.check]``, are for that command and win over them. Paths are relative to the file's folder.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from skelsplat.cli.rows import NAME_OR_PATH, Option
from skelsplat.exceptions import DatasetError

_HELP = "Read options and arguments from a file. Its paths are relative to its folder. The command line wins."
_MOST_CHARACTERS = 40


def source_of(context: typer.Context, name: str) -> str:
    """Return where a value is from: ``"COMMANDLINE"``, ``"DEFAULT_MAP"`` (a file) or ``"DEFAULT"``."""
    return getattr(context.get_parameter_source(name), "name", "DEFAULT")


def given_again(context: typer.Context, rows: Iterable[Option]) -> list[tuple[str, str]]:
    """Return the options among ``rows`` that were given, in any way, with their values, to be given again."""
    return [
        (row.flag, f"{one:.12g}" if isinstance(one, float) else str(one))
        for row in rows
        if context.params[row.name] and source_of(context, row.name) != "DEFAULT"
        for one in (context.params[row.name] if row.many else [context.params[row.name]])
    ]


def _load(context: typer.Context, path: Path | None) -> None:
    """Make the values of a file the defaults of the command that is about to run."""
    if path is None or context.resilient_parsing:
        return
    from skelsplat._budget import read_toml

    entries, found = entries_of(context.command), {}
    try:
        for key, value in _chosen(read_toml(path), context):
            entry = entries.get(_normal(key.rpartition(".")[2]))
            if entry is not None:
                found[entry.name] = _value(key, entry, value, path.parent)
    except MisfitError as misfit:
        raise typer.BadParameter(str(DatasetError(path, *misfit.args)), param_hint="--config") from misfit
    context.default_map = found


Config = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE.toml",
        is_eager=True,
        callback=_load,
        help=_HELP,
        rich_help_panel="Options from a file",
    ),
]


class MisfitError(Exception):
    """A key of the file, what is expected there, and what the file has."""


def entries_of(command: Any) -> dict[str, Option]:
    """Return the options by long name and the arguments by metavar; of a group, those of all commands."""
    commands: Mapping[str, Any] = getattr(command, "commands", {})
    if commands:
        return {key: row for part in commands.values() for key, row in entries_of(part).items()}
    rows: tuple[Option, ...] = getattr(command.callback, "rows", ())
    return {
        key.lower(): row
        for row in rows
        for key in [flag[2:] for flag in row.flags if flag[:2] == "--"] or [row.metavar]
    }


def options_in(
    table: Mapping[str, Any], known: Mapping[str, Option], folder: Path, prefix: str
) -> dict[str, Any]:
    """Return the options that a table of a file holds, by parameter; paths are relative to ``folder``.

    A `MisfitError` is raised if a key is none of those `known`, or a value does not fit its option.
    """
    found: dict[str, Any] = {}
    for key, value in table.items():
        entry = known.get(_normal(key))
        if entry is None:
            raise unknown(prefix + key, "an option or argument of refine", list(known))
        found[entry.name] = _value(prefix + key, entry, value, folder)
    return found


def unknown(key: str, expected: str, known: Sequence[str]) -> MisfitError:
    """Return the error for a key that is none of those `known`, with the nearest of them."""
    close = get_close_matches(_normal(key.rpartition(".")[2]), known, n=1, cutoff=0.75)
    return MisfitError(key, expected, "an unknown key" + (f"; did you mean {close[0]}?" if close else ""))


def _normal(key: str) -> str:
    return key.replace("_", "-")


def _chosen(document: dict[str, Any], context: typer.Context) -> Iterator[tuple[str, Any]]:
    """Yield keys, with the names of their tables, and values for a command; later ones win."""
    lineage: list[Any] = [context]
    while lineage[0].parent is not None:
        lineage.insert(0, lineage[0].parent)
    table, prefix = document, ""
    for step, below in zip(lineage, [*lineage[1:], None], strict=True):
        commands, known = getattr(step.command, "commands", {}), entries_of(step.command)
        following: dict[str, Any] = {}
        for key, value in table.items():
            name = _normal(key)
            if isinstance(value, dict) and name in commands:  # adjust-cameras is an option, too
                following = value if below is not None and name == below.info_name else following
            elif name in known:
                yield prefix + key, value
            elif name in commands:
                raise MisfitError(prefix + key, f"a table [{prefix}{key}] of options", _shown(value))
            else:
                of = prefix.rstrip(".").replace(".", " ") or "a command"
                raise unknown(prefix + key, f"an option or argument of {of}", [*known, *commands])
        table, prefix = following, f"{prefix}{'' if below is None else below.info_name}."


def _value(key: str, row: Option, value: Any, folder: Path) -> Any:
    """Return a value as the command line would give it: a flag, or texts, which click checks."""
    if row.kind is bool:
        if not isinstance(value, bool):
            raise MisfitError(key, "true or false", _shown(value))
        return value
    if "=" in row.metavar and isinstance(value, dict):
        value = [f"{left}={_text(f'{key}.{left}', right)}" for left, right in value.items()]
    kinds = get_args(row.kind) or (row.kind,)
    texts = [_text(key, part) for part in (value if isinstance(value, list) else [value])]
    for place, text in enumerate(texts):
        kind = kinds[place % len(kinds)]
        if not text and kind is Path:  # it would be the folder
            raise MisfitError(key, "a path", "an empty text")
        if kind is Path or (NAME_OR_PATH in row.marks and (folder / text).exists()):
            texts[place] = str(folder / text)
    return texts if row.many or len(kinds) > 1 else ",".join(texts)


def _text(key: str, value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise MisfitError(key, "text or a number", _shown(value))
    return str(value)


def _shown(value: Any) -> str:
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _MOST_CHARACTERS else f"{text[:_MOST_CHARACTERS]}…"
