"""The commands' common behaviour: answers, ``--config``, opposites of flags, short help, lazy imports."""

from __future__ import annotations

import functools
import inspect
import itertools
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar

import typer
from rich.console import Console
from typer.core import TyperCommand, TyperGroup

from skelsplat.cli.config import Config
from skelsplat.cli.output import Terminal, options, print_json, quieter, tell
from skelsplat.cli.rows import AS_JSON, QUIET, Option
from skelsplat.exceptions import InvalidInputError, SkelSplatError
from skelsplat.findings import collected_warnings

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
# A keyword in a sentence: format=, people=2, layout="file", mapping={"nose": "snout"}.
_KEYWORD = re.compile(r'(?<![\w/-])([a-z_]+)=(?:\{"([^"]+)": )?(?:"([^"]*)"|([\w…-]*))\}?(?=[\s),.;:]|$)')
_ALL, _LISTED = "skelsplat.help.all", "skelsplat.help.listed"


class _FlagHelp:
    """A command or group whose ``--help`` is shown like its other flags, without a type."""

    def get_help_option(self, ctx: Any) -> Any:
        """Return the option ``--help``."""
        option = super().get_help_option(ctx)  # type: ignore[misc]
        option.metavar = ""
        return option


class Group(_FlagHelp, TyperGroup):
    """A group of commands."""


class LazyGroup(Group):
    """A group whose commands are imported when they are needed, and not for its help.

    `texts` has the names, with the lines that the help of this group shows. The command ``a-b`` is the
    function ``a_b`` of the module in `modules`, relative to `skelsplat.cli`, or of ``a_b``; a group of
    commands is the application ``app`` there.
    """

    texts: ClassVar[Mapping[str, str]] = {}
    modules: ClassVar[Mapping[str, str]] = {}

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands."""
        del ctx
        return list(self.texts)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, in the help of this group its name and line alone; None if there is none."""
        if cmd_name in self.texts and ctx is not None and _LISTED in ctx.meta:
            return TyperCommand(cmd_name, help=self.texts[cmd_name])
        return self._load(cmd_name) if cmd_name in self.texts else None

    @property  # type: ignore[override]
    def commands(self) -> dict[str, Any]:
        """All commands, all imported."""
        return {name: self._load(name) for name in self.texts}

    @commands.setter
    def commands(self, registered: dict[str, Any]) -> None:
        del registered

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help."""
        ctx.meta[_LISTED] = True
        super().format_help(ctx, formatter)

    def _load(self, name: str) -> Any:
        return _command(name, self.modules.get(name, name.replace("-", "_")))


@functools.cache
def _command(name: str, place: str) -> Any:
    module = import_module(f".{place}", "skelsplat.cli")
    if place == name and hasattr(module, "app"):
        return typer.main.get_group(module.app)
    function = getattr(module, name.replace("-", "_"))
    alone = typer.Typer(add_completion=False, rich_markup_mode="rich")
    alone.command(name, cls=Command, epilog=function.epilog)(function)
    return typer.main.get_command(alone)


def _show_all(context: typer.Context, value: bool | None) -> None:
    if value:
        context.meta[_ALL] = True
        typer.echo(context.get_help(), color=context.color)
        raise typer.Exit


_HelpAll = Annotated[
    bool | None,
    typer.Option("--help-all", metavar="", is_eager=True, callback=_show_all, help="Show all options."),
]


def takes(*rows: Option, short: bool = False, epilog: str | None = None) -> Decorator:
    """Give a function, which takes them as keywords, the options and arguments of a table, and ``--config``.

    The function gets what is given, or has a default. A parameter ``context`` of its own is typer's. With
    ``short``, ``--help`` shows the options that most people use alone, ``--help-all`` the others.
    """
    extra = {"config": Config, "help_all": _HelpAll} if short else {"config": Config}

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def command(**given: Any) -> Any:
            pairs = [row.given(given.pop(row.name)) for row in rows]
            own = {name: value for name, value in given.items() if name not in extra}
            return function(**own, **{name: value for name, value in pairs if value is not None})

        parameters = inspect.signature(function, eval_str=True).parameters.values()
        own = [parameter for parameter in parameters if parameter.annotation is typer.Context]
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            for name, annotation in extra.items()
        ]
        every = [*own, *(row.parameter for row in rows), *added]
        shown = (*(row.name for row in rows if row.common), *extra, "help") if short else ()
        vars(command).update(rows=rows, common=shown, epilog=epilog, __signature__=inspect.Signature(every))
        return command

    return decorate


@dataclass(frozen=True)
class Answer:
    """What a command has to say."""

    document: Any  # for ``--json``
    show: Callable[[Console], object]  # prints it on a console
    quietly: Callable[[Console], object] | None = None  # prints what ``--quiet`` does not keep back
    status: int = 0  # the exit status


def answers(*rows: Option, short: bool = False, epilog: str | None = None) -> Decorator:
    """Give a function that returns an `Answer` what `takes` does, ``--quiet`` and ``--json``.

    Warnings are printed as they occur.
    """

    def decorate(function: Callable[..., Answer]) -> Callable[..., Any]:
        @functools.wraps(function)
        def command(*, quiet: bool, as_json: bool, **given: Any) -> None:
            with quieter(quiet):
                with collected_warnings(tell):
                    answer = function(**given)
                if as_json:
                    print_json(answer.document)
                elif not quiet:
                    answer.show(Terminal())
                elif answer.quietly is not None:
                    answer.quietly(Terminal())
            if answer.status:
                raise typer.Exit(answer.status)

        own = () if any(row.name == "quiet" for row in rows) else (QUIET,)
        return takes(*rows, *own, AS_JSON, short=short, epilog=epilog)(command)

    return decorate


class Command(_FlagHelp, TyperCommand):
    """A command in which ``--no-NAME`` cancels ``--NAME``, and ``--NAME`` cancels ``--no-NAME``."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help: the first sentences of the common options in one panel, or all of all options."""
        common = getattr(self.callback, "common", ())
        before = [dict(vars(param)) for param in self.params]
        for param in list[Any](self.params):
            if param.nargs == -1:  # typer shows <list[Path]>
                param.display_type = lambda _: "<path>"
            if common and not ctx.meta.get(_ALL):
                param.show_default, param.rich_help_panel = False, None
                param.hidden = param.param_type_name == "option" and param.name not in common
                param.help = re.split(r"(?<=[.]) ", getattr(param, "help", None) or "")[0]
        super().format_help(ctx, formatter)
        for param, own in zip(self.params, before, strict=True):
            vars(param).update(own)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments; an empty text is an error, since as a path it is the current folder."""
        for option, value in itertools.pairwise(["", *args]):
            if not value or re.fullmatch("--[a-z-]+=", value):
                hint = value.rstrip("=") or option
                raise typer.BadParameter("expected a value, got an empty text", ctx=ctx, param_hint=hint)
        read: list[str] = super().parse_args(ctx, args)
        return read

    def make_parser(self, ctx: Any) -> Any:
        """Return the parser, which knows the opposites of flags; help does not show them."""
        parser = super().make_parser(ctx)
        known = {option for param in self.params for option in param.opts}
        for param in list[Any](self.params):
            names = [option[2:] for option in param.opts if option.startswith("--")]
            if getattr(param, "is_flag", False) and not param.secondary_opts:
                turned = [f"--{name[3:]}" if name.startswith("no-") else f"--no-{name}" for name in names]
                opposites = [option for option in turned if option not in known]
                if opposites:
                    parser.add_option(
                        obj=param, opts=opposites, dest=param.name, action="store_const", const=False
                    )
        return parser

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override, unused-ignore]
        """Run the command; an invalid argument that is an option becomes an error of usage."""
        running = options.set(frozenset(option for param in self.params for option in param.opts))
        try:
            return super().invoke(ctx)
        except SkelSplatError as error:
            if not isinstance(error, InvalidInputError) or (option := self._option(error.argument)) is None:
                raise SkelSplatError(self.worded(str(error))) from error
            needed = getattr(error, "requires", None)  # of an option without which this one has no effect
            message = self.worded(error.reason) if needed is None else f"requires {self._option(needed)}"
            raise typer.BadParameter(message, ctx=ctx, param_hint=option) from error
        finally:
            options.reset(running)

    def worded(self, text: str) -> str:
        """Return a sentence of the package with its keywords, as ``layout="file"``, typed as options."""

        def typed(found: re.Match[str]) -> str:
            keyword, joint, quoted, bare = found.groups()
            option, words = self._option(keyword), quoted or ("none" if bare == "None" else bare)
            if option is None:  # of the reader of a data set
                joint, option = keyword, self._option("set")
            words = words if joint is None else f"{joint}={words}"
            return found[0] if option is None else f"{option} {shlex.quote(words) if words else ''}".rstrip()

        return _KEYWORD.sub(typed, text)

    def _option(self, argument: str) -> str | None:
        """Return the option for an argument of the package."""
        name = argument.removeprefix("config.")
        spelt = [opt for param in self.params if param.name == name != "config" for opt in param.opts]
        return next((option for option in spelt if option.startswith("--")), None)
