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

    The command ``a-b`` is the function ``a_b`` of `skelsplat.cli.a_b`, with that module's ``EPILOG`` and
    ``COMMON``, if any; of a group, the module has the `Application` ``app``. `texts` has the names, with the
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
    alone = Application(add_completion=False, rich_markup_mode="rich")
    epilog, common = getattr(module, "EPILOG", None), getattr(module, "COMMON", ())
    alone.command(name, epilog=epilog, common=common)(getattr(module, attribute))
    return typer.main.get_command(alone)


class Application(typer.Typer):
    """A typer application with commands of type `Command`; use it as `typer.Typer`."""

    def __init__(self, *, cls: type[Group] = Group, **given: Any) -> None:
        super().__init__(cls=cls, **given)

    def command(
        self, name: str | None = None, *, common: Sequence[str] = (), **given: Any
    ) -> Callable[[Any], Any]:
        """Register a command, as `typer.Typer.command` does.

        With ``common``, the parameters that most people use, ``--help`` shows these alone, and ``--help-all``
        the rest as well.
        """
        kind = type("Command", (Command,), {"common": (*common, "config", "help_all", "help")})
        register = super().command(name, **{"cls": kind if common else Command, **given})

        def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
            extra = {"config": Config, "help_all": _HelpAll} if common else {"config": Config}
            register(_with_options(function, extra))
            return function

        return decorate


def _with_options(function: Callable[..., Any], extra: dict[str, Any]) -> Callable[..., Any]:
    """Return ``function`` with more options, which are not passed on to it."""

    @functools.wraps(function)
    def command(**given: Any) -> Any:
        return function(**{name: value for name, value in given.items() if name not in extra})

    signature = inspect.signature(function, eval_str=True)
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
        for name, annotation in extra.items()
    ]
    command.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *options])  # type: ignore[attr-defined]
    return command


def _show_all(context: typer.Context, value: bool | None) -> None:
    if value:
        context.meta[_ALL] = True
        typer.echo(context.get_help(), color=context.color)
        raise typer.Exit


_HelpAll = Annotated[
    bool | None,
    typer.Option("--help-all", metavar="", is_eager=True, callback=_show_all, help="Show all options."),
]


def _takes_value(param: Any) -> bool:
    return param.param_type_name == "option" and not (param.is_flag or param.count)


class Command(_FlagHelp, TyperCommand):
    """A command in which ``--no-NAME`` cancels ``--NAME``, and ``--NAME`` cancels ``--no-NAME``.

    `common` are the parameters that ``--help`` shows, in short; all of them, if it is empty.
    """

    common: tuple[str, ...] = ()

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help: the first sentences of the common options in one panel, or all of all options."""
        for param in self.params:
            if param.nargs == -1:  # typer shows <list[Path]>
                param.display_type = lambda _: "<path>"  # type: ignore[attr-defined]
        short = bool(self.common) and not ctx.meta.get(_ALL)
        changed = {param: dict(vars(param)) for param in self.params if short}
        for param in changed:
            param.show_default = False  # type: ignore[attr-defined]
            param.rich_help_panel = None  # type: ignore[attr-defined]
            param.hidden = param.param_type_name == "option" and param.name not in self.common  # type: ignore[attr-defined]
            param.help = re.split(r"(?<=[.]) ", getattr(param, "help", None) or "")[0]  # type: ignore[attr-defined]
        try:
            super().format_help(ctx, formatter)
        finally:
            for param, before in changed.items():
                vars(param).update(before)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments; an option in the place of another one's value is an error of usage."""
        counts = {
            option: param.nargs for param in self.params for option in param.opts if _takes_value(param)
        }
        rest = iter(args)
        for word in itertools.takewhile(lambda word: word != "--", rest):
            values = list(itertools.islice(rest, counts.get(word, 0)))
            if word == "--output=" or (word in ("-o", "--output") and "" in values):  # not the current folder
                raise typer.BadParameter("expected a path, got an empty text", ctx=ctx, param_hint="--output")
            for value in values:
                if value.startswith("--"):
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
            from skelsplat.run.job import IncompleteJobError

            option, message = self._option(error.argument.removeprefix("config.")), error.reason
            if option is None:
                raise
            if isinstance(error, IncompleteJobError):
                message = f"requires {self._option(error.requires)}"
            raise typer.BadParameter(message, ctx=ctx, param_hint=option) from error

    def _option(self, argument: str) -> str | None:
        """Return the option for an argument of the package."""
        spelt = [opt for param in self.params if param.name == argument != "config" for opt in param.opts]
        return next((option for option in spelt if option.startswith("--")), None)
