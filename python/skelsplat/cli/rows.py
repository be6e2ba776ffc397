"""Options and arguments of commands, written as the help shows them; of each, typer's parameter is made."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import dedent
from typing import Annotated, Any

import typer

REQUIRED: Any = object()
"""The default of an option that must be given."""
NAME_OR_PATH = "name or path"
"""Marks a text: a name, or a path where a file of that name exists."""
_ALTERNATIVES = r"[a-z-]+(\|[a-z-]+)+"


@dataclass(frozen=True)
class Option:
    """An option or argument: what typer's parameter is made from, and what the package gets; see `rows`."""

    name: str  # the parameter, and its keyword in the package; a flag ``no_name`` is the opposite of ``name``
    flags: tuple[str, ...]  # how it is typed; empty for an argument
    # for the help; ``shown`` is the default in words
    metavar: str
    help: str
    panel: str = ""
    shown: str = ""
    kind: Any = str  # type of the value; bool: a flag
    many: bool = False  # repeatable
    default: Any = None  # None: there is none, and the package is not given the keyword; or `REQUIRED`
    read: Callable[[str, Any], Any] | None = None  # from the option and its value, what the package gets
    marks: tuple[Any, ...] = ()  # `NAME_OR_PATH`
    limits: Mapping[str, float] = field(default_factory=dict)  # ``min`` and ``max``
    offers: tuple[str, ...] = ()  # usual values
    common: bool = False  # shown in a short help

    @property
    def flag(self) -> str:
        """The option as it is typed."""
        return next((name for name in self.flags if name.startswith("--")), self.metavar)

    @property
    def title(self) -> str:
        """The option in words."""
        words = self.flag.lstrip("-").replace("-", " ")
        words = {"fps": "frame rate", "opensim": "OpenSim"}.get(words, words)
        return words[:1].upper() + words[1:]

    @property
    def usual(self) -> str:
        """The default in words; empty of a flag, or if there is none."""
        return self.shown or ("" if self.default in (None, False) else str(self.default))

    @property
    def choices(self) -> list[str]:
        """Values to choose from, if they are few: all, or the usual ones."""
        return [*self.offers] or (
            self.metavar.split("|") if re.fullmatch(_ALTERNATIVES, self.metavar) else []
        )

    @property
    def parameter(self) -> inspect.Parameter:
        """The parameter from which typer makes the option or argument."""
        about: dict[str, Any] = {"metavar": self.metavar, "help": self.help, **self.limits}
        if self.kind is Path:
            about["readable"] = False
        if not self.flags:
            info = typer.Argument(show_default=False, **about)
        else:
            about["show_default"] = self.shown or True
            info = typer.Option(*self.flags, rich_help_panel=self.panel or None, **about)
        kind = list[self.kind] if self.many else self.kind  # type: ignore[name-defined]
        default = inspect.Parameter.empty if self.default is REQUIRED else self.default
        kind = kind | None if self.default is None else kind
        return inspect.Parameter(
            self.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, info]
        )

    def wrong(self, given: str | list[str]) -> str:
        """Return in a sentence why a text, or a list of a repeatable option, is no value; else nothing."""
        least, most = self.limits.get("min"), self.limits.get("max")
        named = {int: "a whole number", float: "a number"}.get(self.kind, "another text")
        named += "" if least is None else f" from {least}" + (" on" if most is None else f" to {most}")
        try:
            value: Any = given if self.many else self.kind(given)
            self.given(value)
            fits = (least is None or value >= least) and (most is None or value <= most)
        except typer.BadParameter as error:
            return f"{error.message[:1].upper()}{error.message[1:]}."
        except ValueError:
            fits = False
        return "" if fits else f"Expected {named}, got {given!r}."

    def given(self, value: Any) -> tuple[str, Any]:
        """Return the keyword of the package, and its value."""
        if self.kind is bool and self.name.startswith("no_"):
            return self.name[3:], not value
        if self.many:
            value = list(value or ())
        return self.name, value if self.read is None or value is None else self.read(self.flag, value)


def typed(rows: Sequence[Option], values: Mapping[str, Any]) -> list[str]:
    """Return options as they are typed, from texts by name; of a flag True, of a repeatable one a list."""
    words = []
    for row in rows:
        value = values.get(row.name) or []
        for text in value if isinstance(value, list) else [value]:
            words += [row.flag] if row.kind is bool else [row.flag, str(text)]
    return words


def texts_of(rows: Sequence[Option], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of the package, by keyword, as texts that `typed` takes."""
    found: dict[str, Any] = {}
    for row in rows:
        value = given.get(row.name)
        if isinstance(value, Mapping):
            value = [f"{key}={'none' if one is None else one}" for key, one in value.items()]
        several = value if isinstance(value, list | tuple) else [value]
        texts = [f"{one:g}" if isinstance(one, float) else str(one) for one in several]
        if value is True:
            found[row.name] = True
        elif value not in (None, False) and texts and texts != [row.default]:
            found[row.name] = texts if row.many else ",".join(texts)
    return found


def texts_in(rows: Sequence[Option], words: Sequence[str]) -> dict[str, Any]:
    """Return the options among the words of a command, as texts that `typed` takes."""
    found: dict[str, Any] = {}
    known = {flag: row for row in rows for flag in row.flags}
    for word, after in zip(words, [*words[1:], ""], strict=True):
        if (row := known.get(word)) is not None:
            text = True if row.kind is bool else after
            found[row.name] = [*found.get(row.name, []), text] if row.many else text
    return found


def one_of(option: str, value: str | None, choices: Sequence[str]) -> str:
    """Return ``value`` if it is one of ``choices``; None: a required option is missing."""
    if value in choices:
        return str(value)
    got = "nothing (the files do not state it)" if value is None else repr(value)
    raise typer.BadParameter(f"expected one of {', '.join(choices)}, got {got}", param_hint=option)


def choice(*choices: str) -> Callable[[str, str], str]:
    """Return a reader of an option that has one of these values."""
    return lambda option, value: one_of(option, value, choices)


def positive(option: str, value: float) -> float:
    """Return ``value`` if it is positive and finite."""
    if 0 < value < float("inf"):
        return value
    raise typer.BadParameter(f"expected a positive number, got {value:g}", param_hint=option)


# What the last word of a metavar says of the values.
_KINDS: dict[str, dict[str, Any]] = {
    **{key: {"kind": Path} for key in ("FOLDER", "FILE", "PATH", "ROOT", "RUN", "VIDEOS", "SESSIONS")},
    **{
        key: {"kind": Path}
        for key in ("CALIBRATION", "DETECTIONS", "INPUT", "OUTPUT", "POSE.npz", "FILE.html")
    },
    "HZ": {"kind": float, "read": positive},
    "MM": {"kind": float},
    "N": {"kind": int, "limits": {"min": 1}},
    "SEED": {"kind": int, "limits": {"min": 0}},
}


def rows(text: str, **more: Any) -> tuple[Option, ...]:
    """Return the options and arguments of a text that is written like a help.

    An entry is ``-o, --output FOLDER  What it is for. [default]``, with two spaces before the help, whose
    further lines are indented. One without a metavar is a flag, one without a dash an argument; the metavar
    says what values there are: ``a|b``, or see `_KINDS`. The default is in words, or ``[= value]``,
    ``[required]``, ``[optional]`` of an argument. A short help shows those after ``*`` alone. A line
    ``Output:`` begins a panel. ``more`` has by option the type of its value, a function for `Option.read`,
    or fields of `Option`.
    """
    found, panel = [], ""
    for entry in re.split(r"\n(?=\S)", dedent(text).strip()):
        if entry.endswith(":"):
            panel = entry[:-1]
        else:
            found.append(_row(panel, entry, more))
    return tuple(found)


def _row(panel: str, entry: str, more: dict[str, Any]) -> Option:
    head, _, words = entry.removeprefix("* ").partition("  ")
    found = re.fullmatch(r"(.*?) ?(?:\[(= )?([^]]*)\])?", " ".join(words.split()))
    assert found is not None
    parts = [part.strip(",") for part in head.split()]
    flags = tuple(part for part in parts if part.startswith("-"))
    metavar = " ".join(part for part in parts if not part.startswith("-"))
    name = next((flag for flag in flags if flag.startswith("--")), head).lstrip("-").replace("-", "_")
    made = Option(name.lower(), flags, metavar, found[1], panel, common=entry.startswith("* "))
    made = replace(made, **_KINDS.get(metavar, {}))
    if re.fullmatch(_ALTERNATIVES, metavar):
        made = replace(made, read=choice(*metavar.split("|")))
    if not metavar:
        made = replace(made, kind=bool, default=False)
    if found[2]:
        made = replace(made, default=found[3])
    elif found[3] == "required" or (not flags and found[3] != "optional"):
        made = replace(made, default=REQUIRED)
    elif flags and found[3]:
        made = replace(made, shown=found[3])
    given = more.get(made.name, {})
    if isinstance(given, type):
        given = {"kind": given}
    return replace(made, **(given if isinstance(given, dict) else {"read": given}))


QUIET, AS_JSON = rows(
    """
    Output:
    * --quiet, -q  Print only warnings and errors.
    * --json  Print the result as JSON. Nothing else is printed on stdout.
    """,
    json={"name": "as_json"},
)
