"""``.. skelsplat-commands::``: the command line's reference, from the program itself.

Every command gets a section with the content of its ``--help``: the text, the examples, and an ``option``
entry for every argument and option, which pages can link to (``{option}`refine --unit```).
"""

from __future__ import annotations

import re
from itertools import groupby
from typing import TYPE_CHECKING, Any, get_args

import typer.main
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.util.nodes import nested_parse_with_titles

from skelsplat.cli import app as program

# a command line, also behind a pipe, or JSON
_VERBATIM = re.compile(r"(\w+ \| )?skelsplat [a-z-]+( |$)|\{")

if TYPE_CHECKING:
    from collections.abc import Iterator

    from docutils.nodes import Node
    from sphinx.application import Sphinx

    Lines = Iterator[str]


class Commands(Directive):
    """Sections for all commands."""

    def run(self) -> list[Node]:
        from docutils import nodes

        top = typer.main.get_command(program)
        lines = StringList([line for entry in _leaves(top, "skelsplat") for line in _section(*entry)], "help")
        holder = nodes.section()
        holder.document = self.state.document
        nested_parse_with_titles(self.state, lines, holder)
        return holder.children


def _leaves(command: Any, path: str) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield path, command
        return
    for name, child in command.commands.items():
        yield from _leaves(child, f"{path} {name}")


def _section(path: str, command: Any) -> Lines:
    title = path.removeprefix("skelsplat ")
    yield from (f".. _command-{title.replace(' ', '-')}:", "", title, "=" * len(title), "")
    yield from (f".. program:: {title}", "")
    yield from _text(command.help or "")
    for heading, params in _panels(command).items():
        yield from (f".. rubric:: {heading}", "")
        for param in params:
            yield from _entry(param)
    yield from _text(command.epilog or "")


def _text(text: str) -> Lines:
    """Yield the help's paragraphs as reStructuredText; commands and JSON go into separate blocks."""
    lines = [line.strip() for line in text.replace("\b", "").splitlines()]
    paragraphs = [part.strip() for part in re.split(r"\n{2,}", "\n".join(lines)) if part.strip()]
    for verbatim, group in groupby(paragraphs, key=lambda part: bool(_VERBATIM.match(part))):
        if verbatim:
            yield from (".. code-block:: sh", "")
            yield from (f"   {line}" for part in group for line in part.splitlines())
            yield ""
            continue
        for part in group:
            heading = re.fullmatch(r"\[bold\](.+)\[/bold\]", part)
            yield from (f".. rubric:: {heading[1]}" if heading else _plain(" ".join(part.split())), "")


def _panels(command: Any) -> dict[str, list[Any]]:
    panels: dict[str, list[Any]] = {}
    for param in command.params:
        if param.name == "help" or getattr(param, "hidden", False):
            continue
        argument = param.param_type_name == "argument"
        heading = getattr(param, "rich_help_panel", None) or ("Arguments" if argument else "Options")
        panels.setdefault(heading, []).append(param)
    return panels


def _entry(param: Any) -> Lines:
    metavar = param.metavar if param.metavar is not None else _metavar(param)
    if param.param_type_name == "argument":
        yield f".. option:: {metavar}"
    else:
        names = sorted(param.opts, key=len, reverse=True)
        yield f".. option:: {', '.join(f'{name} {metavar}'.strip() for name in names)}"
    text = " ".join((param.help or "").split())
    shown = _default(param)
    yield from ("", f"   {_plain(text)}{shown}", "")


def _metavar(param: Any) -> str:
    if getattr(param, "is_flag", False):
        return ""
    choices = get_args(getattr(getattr(param, "type_descriptor", None), "annotation", None))
    texts = [choice for choice in choices if isinstance(choice, str)]
    return "|".join(texts) if texts else str(param.name).upper()


def _default(param: Any) -> str:
    shown = getattr(param, "show_default", None)
    if isinstance(shown, str):
        return f" Default: {_plain(shown)}."
    if param.required:
        return " Required."
    if param.default in (None, False, "", ()) or callable(param.default) or not shown:
        return ""
    return f" Default: ``{param.default}``."


def _plain(text: str) -> str:
    """Return text in which nothing is markup: rich's tags and escapes go, reStructuredText's are put."""
    bare = re.sub(r"\[/?(?:bold|dim|italic)\]", "", text).replace("\\[", "[")
    return re.sub(r"([*`|\\_])", r"\\\1", bare)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("skelsplat-commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
