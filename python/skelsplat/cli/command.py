"""The commands' common behaviour: ``--config``, opposites of flags, short help, errors that name options."""

from __future__ import annotations

import functools
import inspect
import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from skelsplat.cli.config import Config
from skelsplat.cli.rows import Option
from skelsplat.exceptions import InvalidInputError

_ALL = "skelsplat.help.all"


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
    """A group whose commands are imported when they are needed.

    The command ``a-b`` is the function ``a_b`` of `skelsplat.cli.a_b`, with that module's ``EPILOG``,
    if any; of a group, the module has the application ``app``. `texts` has the names, with the
    lines that the help of this group shows.
    """

    texts: ClassVar[Mapping[str, str]] = {}

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands."""
        del ctx
        return list(self.texts)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, imported now if it was not before; None if there is none."""
        del ctx
        if cmd_name in self.texts and cmd_name not in self._loaded:
            self._loaded[cmd_name] = _load(cmd_name)
        return self._loaded.get(cmd_name)

    @property  # type: ignore[override]
    def commands(self) -> dict[str, Any]:
        """All commands, all imported."""
        return {name: self.get_command(None, name) for name in self.texts}

    @commands.setter
    def commands(self, registered: dict[str, Any]) -> None:
        self._loaded = dict[str, Any](registered)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help, for which no command is imported."""
        loaded = self._loaded
        self._loaded = {name: TyperCommand(name, help=text) for name, text in self.texts.items()}
        try:
            super().format_help(ctx, formatter)
        finally:
            self._loaded = loaded


def _load(name: str) -> Any:
    attribute = name.replace("-", "_")
    module = import_module(f"skelsplat.cli.{attribute}")
    if hasattr(module, "app"):
        return typer.main.get_group(module.app)
    alone = typer.Typer(add_completion=False, rich_markup_mode="rich")
    alone.command(name, cls=Command, epilog=getattr(module, "EPILOG", None))(getattr(module, attribute))
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


def takes(*rows: Option, common: Sequence[str] = ()) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a function, which takes them as keywords, the options and arguments of a table, and ``--config``.

    The function gets what is given, or has a default. A parameter ``context`` of its own is typer's. With
    ``common``, the parameters that most people use, ``--help`` shows these alone, ``--help-all`` the others.
    """
    extra = {"config": Config, "help_all": _HelpAll} if common else {"config": Config}

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
        shown = (*common, *extra, "help") if common else ()
        vars(command).update(rows=rows, common=shown, __signature__=inspect.Signature(every))
        return command

    return decorate


class Command(_FlagHelp, TyperCommand):
    """A command in which ``--no-NAME`` cancels ``--NAME``, and ``--NAME`` cancels ``--no-NAME``."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help: the first sentences of the common options in one panel, or all of all options."""
        for param in self.params:
            if param.nargs == -1:  # typer shows <list[Path]>
                param.display_type = lambda _: "<path>"  # type: ignore[attr-defined]
        common = getattr(self.callback, "common", ())
        short = bool(common) and not ctx.meta.get(_ALL)
        changed = {param: dict(vars(param)) for param in self.params if short}
        for param in changed:
            param.show_default = False  # type: ignore[attr-defined]
            param.rich_help_panel = None  # type: ignore[attr-defined]
            param.hidden = param.param_type_name == "option" and param.name not in common  # type: ignore[attr-defined]
            param.help = re.split(r"(?<=[.]) ", getattr(param, "help", None) or "")[0]  # type: ignore[attr-defined]
        try:
            super().format_help(ctx, formatter)
        finally:
            for param, before in changed.items():
                vars(param).update(before)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments; an option in the place of another one's value is an error of usage."""
        words = [*itertools.takewhile(lambda word: word != "--", args), ""]
        valued = {
            option
            for param in list[Any](self.params)
            if param.param_type_name == "option" and not (param.is_flag or param.count)
            for option in param.opts
        }
        for word, value in itertools.pairwise(words):
            if word == "--output=" or (word in ("-o", "--output") and not value):  # not the current folder
                raise typer.BadParameter("expected a path, got an empty text", ctx=ctx, param_hint="--output")
            if word in valued and value.startswith("--"):
                raise typer.BadParameter(f"expected a value, got {value}", ctx=ctx, param_hint=word)
        read: list[str] = super().parse_args(ctx, args)
        return read

    def make_parser(self, ctx: Any) -> Any:
        """Return the parser, which knows the opposites of flags; help does not show them."""
        parser, params = super().make_parser(ctx), list[Any](self.params)
        known = {option for param in params for option in param.opts}
        for param in params:
            if getattr(param, "is_flag", False) and not param.secondary_opts:
                names = [option[2:] for option in param.opts if option.startswith("--")]
                turned = [f"--{name[3:]}" if name.startswith("no-") else f"--no-{name}" for name in names]
                opposites = [option for option in turned if option not in known]
                if opposites:
                    parser.add_option(
                        obj=param, opts=opposites, dest=param.name, action="store_const", const=False
                    )
        return parser

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override, unused-ignore]
        """Run the command; an invalid argument that is an option becomes an error of usage."""
        try:
            return super().invoke(ctx)
        except InvalidInputError as error:
            option = self._option(error.argument.removeprefix("config."))
            if option is None:
                raise
            needed = getattr(error, "requires", None)  # of an option without which this one has no effect
            message = error.reason if needed is None else f"requires {self._option(needed)}"
            raise typer.BadParameter(message, ctx=ctx, param_hint=option) from error

    def _option(self, argument: str) -> str | None:
        """Return the option for an argument of the package."""
        spelt = [opt for param in self.params if param.name == argument != "config" for opt in param.opts]
        return next((option for option in spelt if option.startswith("--")), None)
