"""Compare the accuracy of the solver with baselines; every subcommand prints one table.

    python benchmarks/accuracy.py table [--poses 300] [--seed 0] [--fast] [--set field=value ...]

`--set` changes a field of ``RefineConfig()`` (int, float, true/false, none, or text) and may be repeated. The
functions of the same names can be imported and return the figures as a dict.
"""

from __future__ import annotations

import argparse
import inspect
from typing import Any

import report
from measures.angles import angles
from measures.association import mvor_people
from measures.bones import bones
from measures.coverage import coverage, coverage_real
from measures.gaussian import gaussian
from measures.noises import table
from measures.operating_room import mvor
from measures.schedule import schedule
from measures.starts import start
from measures.swaps import swaps
from measures.sweep import sweep
from measures.useless import useless
from measures.views import views

MEASURES = {
    f.__name__: f
    for f in (
        angles,
        table,
        start,
        bones,
        coverage,
        coverage_real,
        gaussian,
        mvor,
        mvor_people,
        swaps,
        useless,
        sweep,
        views,
        schedule,
    )
}


def parsed(text: str) -> tuple[str, Any]:
    """Split ``field=value`` and parse the value as a Python value."""
    field, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"expected field=value, got {text!r}")
    words = {"true": True, "false": False, "none": None}
    if value.lower() in words:
        return field, words[value.lower()]
    for kind in (int, float):
        try:
            return field, kind(value)
        except ValueError:
            continue
    return field, value


def add_options(parser: argparse.ArgumentParser, function: Any) -> None:
    """Add to the subcommand an option for every keyword of its function."""
    for name, parameter in inspect.signature(function).parameters.items():
        option = f"--{name.replace('_', '-')}"
        if name == "fields":
            parser.add_argument(
                "--set", dest="fields", action="append", type=parsed, default=[], metavar="FIELD=VALUE"
            )
        elif isinstance(parameter.default, bool):
            parser.add_argument(option, action="store_true")
        else:
            parser.add_argument(option, type=type(parameter.default), default=parameter.default)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, function in MEASURES.items():
        about = inspect.getdoc(function) or ""
        add_options(commands.add_parser(name, help=about.splitlines()[0], description=about), function)
    options = vars(parser.parse_args())
    function = MEASURES[options.pop("command")]
    options["fields"] = dict(options["fields"])
    report.show(function(**options))


if __name__ == "__main__":
    main()
