"""A file of options: read, its tables put together for one command, its values checked."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import parse_toml, read_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import typer

# Marks a parameter that takes a name or, if there is one, a path: beside typer's in `Annotated`.
NAME_OR_PATH = "name or path"
_MOST_CHARACTERS = 40
# Metavars of options that take several names with commas between them.
_WITH_COMMAS = ("A,B,…", "FORMATS", "FIGURES")
_WORDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    Path: "a path, as text",
}


class ConfigError(DatasetError):
    """A key or value of a file of options that is none of the command's."""


@dataclass(frozen=True)
class _Entry:
    """An option or argument.

    Parameters
    ----------
    parameter
        Name of the function's parameter.
    kind
        Its type.
    marks
        What else stands in its `Annotated`.
    pairs
        It is repeatable and of the form A=B.
    commas
        It is one text with commas between its parts.
    """

    parameter: str
    kind: Any
    marks: tuple[Any, ...] = ()
    pairs: bool = False
    commas: bool = False


def read_config(path: Path, context: typer.Context) -> dict[str, tuple[str, Any]]:
    """Return what a file says for the command of ``context``: by parameter the key and the value.

    Keys at the top are for all commands that have the option; those in a table with a command's name, such as
    ``[refine]`` or ``[datasets.check]``, are for that command, and count more. Relative paths begin at the
    file's folder.

    Raises
    ------
    DatasetError
        If the file cannot be read or is no TOML.
    ConfigError
        If a key is unknown or a value has the wrong type.
    """
    document = parse_toml(path, read_text(path))
    entries = _entries(context.command)
    found: dict[str, tuple[str, Any]] = {}
    for key, value in _chosen(path, document, context):
        entry = entries.get(_normal(key.rpartition(".")[2]))
        if entry is not None:
            found[entry.parameter] = (key, _value(path, key, entry, value))
    return found


def _normal(key: str) -> str:
    return key.replace("_", "-")


def _entries(command: Any) -> dict[str, _Entry]:
    """Return the options by long name without dashes, and the arguments by metavar in small letters."""
    signature = inspect.signature(inspect.unwrap(command.callback), eval_str=True)
    entries = {}
    for param in command.params:
        if param.name not in signature.parameters:
            continue
        kind, *marks = _unwrapped(signature.parameters[param.name].annotation)
        metavar = param.metavar or ""
        pairs, commas = get_origin(kind) is list and "=" in metavar, kind is str and metavar in _WITH_COMMAS
        entry = _Entry(param.name, kind, tuple(marks), pairs, commas)
        if param.param_type_name == "argument":
            entries[(metavar or param.name).lower()] = entry
        else:
            entries.update({opt[2:]: entry for opt in param.opts if opt.startswith("--")})
    return entries


def _unwrapped(annotation: Any) -> list[Any]:
    """Return the type in an annotation, without None, and what else `Annotated` holds."""
    kind, *marks = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
    if get_origin(kind) in (Union, UnionType):
        kind = next(part for part in get_args(kind) if part is not type(None))
    return [kind, *marks]


def _known(command: Any) -> dict[str, _Entry]:
    """Return the entries of a command, or of all commands of a group."""
    commands: Mapping[str, Any] = getattr(command, "commands", {})
    if not commands:
        return _entries(command)
    return {key: entry for part in commands.values() for key, entry in _known(part).items()}


def _chosen(path: Path, document: dict[str, Any], context: typer.Context) -> Iterator[tuple[str, Any]]:
    """Yield the keys, with those of their tables, and values for a command; what counts more comes later."""
    lineage: list[Any] = [context]
    while lineage[0].parent is not None:
        lineage.insert(0, lineage[0].parent)
    table, prefix = document, ""
    for level, step in enumerate(lineage):
        commands: Mapping[str, Any] = getattr(step.command, "commands", {})
        known, seen = _known(step.command), set()
        tables = {}
        for key, value in table.items():
            if _normal(key) in commands:
                tables[_normal(key)] = _table(path, prefix + key, value)
                continue
            if _normal(key) not in known:
                raise _unknown(path, prefix + key, lineage[: level + 1], [*known, *commands])
            if _normal(key) in seen:
                raise ConfigError(path, prefix + key, "each option once", "it twice, with - and with _")
            seen.add(_normal(key))
            yield prefix + key, value
        if step is not context:
            name = str(lineage[level + 1].info_name)
            table, prefix = tables.get(name, {}), f"{prefix}{name}."


def _table(path: Path, key: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ConfigError(path, key, f"a table [{key}] of options", _told(value))
    return value


def _unknown(path: Path, key: str, lineage: list[Any], known: list[str]) -> ConfigError:
    of = " ".join(str(step.info_name) for step in lineage[1:]) or "any command"
    close = get_close_matches(_normal(key.rpartition(".")[2]), known, n=1, cutoff=0.75)
    hint = f" such as {close[0]}" if close else ""
    return ConfigError(path, key, f"an option or argument of {of}{hint}", "an unknown key")


def _value(path: Path, key: str, entry: _Entry, value: Any) -> Any:
    """Return a value as the command line would give it."""
    if get_origin(entry.kind) is list:
        if entry.pairs and isinstance(value, dict):
            return [f"{left}={_right(path, f'{key}.{left}', right)}" for left, right in value.items()]
        (kind,) = get_args(entry.kind)
        values = value if isinstance(value, list) else [value]
        converted = [_scalar(kind, part, path.parent) for part in values]
        expected = f"a list of {'A=B texts, or a table' if entry.pairs else _WORDS[kind]}"
    elif get_origin(entry.kind) is tuple:
        kinds = get_args(entry.kind)
        fits = isinstance(value, list) and len(value) == len(kinds)
        pairs = zip(kinds, value, strict=True) if fits else ((bool, None),)
        converted = [_scalar(kind, part, path.parent) for kind, part in pairs]
        expected = f"a list of {' and '.join(_WORDS[kind] for kind in kinds)}"
    else:
        converted = [_scalar(entry.kind, _joined(entry, value), path.parent, entry.marks)]
        expected = _WORDS.get(entry.kind, _WORDS[str])
    if None in converted:
        raise ConfigError(path, key, expected, _told(value))
    return converted if get_origin(entry.kind) in (list, tuple) else converted[0]


def _joined(entry: _Entry, value: Any) -> Any:
    """Return a list of texts as one text with commas, if the option takes that; else the value itself."""
    if entry.commas and isinstance(value, list) and value and all(isinstance(part, str) for part in value):
        return ",".join(value)
    return value


def _scalar(kind: Any, value: Any, folder: Path, marks: tuple[Any, ...] = ()) -> Any:
    """Return one value in the type of its parameter; None if it has another."""
    if kind is bool or isinstance(value, bool):
        return value if kind is bool and isinstance(value, bool) else None
    if kind is int:
        return value if isinstance(value, int) else None
    if kind is float:
        return _float(value) if isinstance(value, int | float) else None
    if kind is Path:
        return str(folder / value) if isinstance(value, str) else None
    if NAME_OR_PATH in marks and isinstance(value, str) and (folder / value).exists():
        return str(folder / value)
    if kind is str or get_origin(kind) is Literal:
        return str(value) if isinstance(value, str | int) else None
    raise TypeError(f"no TOML value is known for a parameter of type {kind}")


def _float(value: float) -> float | None:
    try:
        return float(value)
    except OverflowError:  # TOML's whole numbers have no limit
        return None


def _right(path: Path, key: str, value: Any) -> str:
    """Return the B of an A=B; of a list the values with commas, after a single one too."""
    if isinstance(value, list) and value:
        texts = [_right(path, key, part) for part in value]
        return f"{texts[0]}," if len(texts) == 1 else ",".join(texts)
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        return str(value)
    raise ConfigError(path, key, "text or a number", _told(value))


def _told(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    text = repr(value)
    return text if len(text) <= _MOST_CHARACTERS else f"{text[:_MOST_CHARACTERS]}…"
