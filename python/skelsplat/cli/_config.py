"""``--config FILE.toml`` for every command: options from a file, with the command line on top."""

from __future__ import annotations

import functools
import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from skelsplat.cli._config_file import ConfigError, read_config
from skelsplat.exceptions import InvalidInputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

# In the `meta` of a context; click asks for names that no one else uses.
_SAID, _TAKEN_BACK = "skelsplat.config.said", "skelsplat.config.taken_back"
_NAME = "config"
_HELP = (
    "Options and arguments of this command, from a file of KEY = VALUE: min-confidence = 0.3, paper = true; "
    "paths begin at the file's folder. The command line counts more; there --no-paper takes back a "
    "paper = true."
)


class Application(typer.Typer):
    """A typer application whose commands all take ``--config``; use it as `typer.Typer`."""

    def command(self, name: str | None = None, **given: Any) -> Callable[[Any], Any]:
        """Register a command, as `typer.Typer.command` does."""
        register = super().command(name, **{"cls": ConfiguredCommand, **given})

        def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
            register(_with_config(function))
            return function

        return decorate


class ConfiguredCommand(TyperCommand):
    """A command on whose command line ``--no-NAME`` takes back the flag ``--NAME`` of a file.

    Of a flag that begins with ``--no-`` the opposite is the name without it.
    """

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override, unused-ignore]
        """Parse the command line without the flags that are taken back."""
        kept, ctx.meta[_TAKEN_BACK] = _without_opposites(self.params, args)
        return super().parse_args(ctx, kept)

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override, unused-ignore]
        """Run the command; what is wrong with an argument that is an option is an error of usage."""
        try:
            return super().invoke(ctx)
        except InvalidInputError as error:
            name, _, message = str(error).partition(": ")
            named = [param for param in self.params if param.name == name and name != _NAME]
            spelt = [opt for param in named for opt in param.opts]
            options = [opt for opt in spelt if opt.startswith("--")]
            if not options:
                raise
            raise typer.BadParameter(message, ctx=ctx, param_hint=options[0]) from error


@dataclass(frozen=True)
class _Said:
    """Which parameters a file sets, by parameter the key."""

    path: Path
    keys: dict[str, str]


def origin(context: Any, label: str) -> str:
    """Return the file and key where an option or argument comes from; "" if from the command line.

    Parameters
    ----------
    context : typer.Context or None
        That of the command.
    label : str
        What messages call the parameter: an option such as ``--unit``, or the metavar of an argument.
    """
    said: _Said | None = context.meta.get(_SAID) if context is not None else None
    for param in context.command.params if said is not None else ():
        if label in (*param.opts, param.metavar) and from_file(context, param.name):
            assert said is not None  # else the loop is empty
            return f"{said.path}: {said.keys[param.name]}"
    return ""


def from_file(context: typer.Context, name: str) -> bool:
    """Say whether a parameter's value comes from a file of options."""
    return getattr(context.get_parameter_source(name), "name", "") == "DEFAULT_MAP"


def _with_config(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return ``function`` with the option ``--config``, of which it hears nothing."""

    @functools.wraps(function)
    def command(**given: Any) -> Any:
        del given[_NAME]
        return function(**given)

    signature = inspect.signature(function, eval_str=True)
    option = inspect.Parameter(_NAME, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=_Config)
    command.__signature__ = signature.replace(parameters=[*signature.parameters.values(), option])  # type: ignore[attr-defined]
    return command


def _load(context: typer.Context, path: Path | None) -> None:
    """Make the values of a file the defaults of the command that is about to run."""
    if path is None or context.resilient_parsing:
        return
    try:
        found = read_config(path, context)
    except ConfigError as error:
        raise typer.BadParameter(str(error), param_hint=f"--{_NAME}") from error
    taken_back = context.meta.get(_TAKEN_BACK, frozenset())
    context.default_map = {name: value for name, (_, value) in found.items() if name not in taken_back}
    context.meta[_SAID] = _Said(path, {name: key for name, (key, _) in found.items()})


_Config = Annotated[
    Path | None,
    typer.Option(
        f"--{_NAME}",
        metavar="FILE.toml",
        is_eager=True,
        callback=_load,
        help=_HELP,
        rich_help_panel="Options from a file",
    ),
]


def _without_opposites(params: Sequence[Any], args: Sequence[str]) -> tuple[list[str], frozenset[str]]:
    """Return the arguments without opposites of flags and what they undo, and the parameters they undo."""
    flags = {
        opt: p for p in params if getattr(p, "is_flag", False) and not p.secondary_opts for opt in p.opts
    }
    known = {opt for param in params for opt in param.opts}
    opposites = {_opposite(opt): param for opt, param in flags.items() if opt.startswith("--")}
    end = args.index("--") if "--" in args else len(args)
    kept: list[str] = []
    undone: set[str] = set()
    for arg in args[:end]:
        if arg in opposites and arg not in known:
            param = opposites[arg]
            kept = [other for other in kept if other not in param.opts]
            undone.add(param.name)
            continue
        if arg in flags:
            undone.discard(flags[arg].name)
        kept.append(arg)
    return [*kept, *args[end:]], frozenset(undone)


def _opposite(option: str) -> str:
    name = option.removeprefix("--")
    return f"--{name.removeprefix('no-')}" if name.startswith("no-") else f"--no-{name}"
