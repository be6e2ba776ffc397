"""What the measuring programs share: options from signatures, tables on the terminal, times, the machine.

A program is one or more functions with keyword arguments, which become its options; they return or yield
tables (`skelsplat.evaluation.tables.Table`) and lines of text. Import this module first: it keeps NumPy
on one core.
"""

from __future__ import annotations

import argparse
import datetime
import inspect
import json
import platform
import shlex
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import _one_core  # noqa: F401  before numpy
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as Drawn

import skelsplat as sk
from skelsplat._json import plain
from skelsplat.evaluation.tables import Table

Output = Table | str
Program = Callable[..., Output | Iterable[Output]]
ONE_THREAD = sk.RefineConfig(n_threads=1)
_WIDTH = 110
_KINDS = {"int": int, "float": float, "Path": Path}
# Further runs are timed until so much time is spent.
_AT_LEAST_S = 0.5


def main(about: str | None, *programs: Program) -> None:
    """Run the program, of several the one that the command line names, and print what it gives."""
    shape = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=about, formatter_class=shape)
    if len(programs) == 1:
        _add_options(parser, programs[0])
    else:
        commands = parser.add_subparsers(required=True)
        for program in programs:
            text = inspect.getdoc(program) or ""
            name, first = program.__name__, text.splitlines()[0]
            _add_options(
                commands.add_parser(name, help=first, description=text, formatter_class=shape), program
            )
    given = vars(parser.parse_args())
    program, markdown, as_json = (given.pop(name) for name in ("program", "markdown", "json"))
    if "fields" in given:
        given["fields"] = dict(given["fields"])
    found = program(**given)
    outputs = [found] if isinstance(found, Table | str) else found
    if as_json:
        everything = list(outputs)
        tables = [asdict(output) for output in everything if isinstance(output, Table)]
        lines = [output for output in everything if isinstance(output, str)]
        print(
            json.dumps(plain({"circumstances": circumstances(), "tables": tables, "notes": lines}), indent=1)
        )
        return
    for output in outputs:
        show(output, markdown=markdown)
        sys.stdout.flush()
    print(circumstances())


def _add_options(parser: argparse.ArgumentParser, program: Program) -> None:
    """Add an option for every keyword of a program, and an argument for every other parameter."""
    for name, parameter in inspect.signature(program).parameters.items():
        default, kind = parameter.default, _kind(parameter)
        option, more = f"--{name.replace('_', '-')}", {"type": kind, "default": default}
        if parameter.kind is not parameter.KEYWORD_ONLY:
            many = {"nargs": "*", "default": default} if isinstance(default, tuple) else {}
            parser.add_argument(name, type=kind, **many)
        elif name == "fields":
            parser.add_argument("--set", dest=name, action="append", type=parsed, default=[])
        elif isinstance(default, bool):
            parser.add_argument(option, action="store_true")
        else:
            several = {"nargs": "+"} if "tuple" in str(parameter.annotation) else {}
            parser.add_argument(option, **more, **several, help=f"({default})")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    parser.set_defaults(program=program)


def _kind(parameter: inspect.Parameter) -> Callable[[str], Any]:
    words = str(parameter.annotation).replace("[", " ").replace(",", " ").split()
    return next((_KINDS[word] for word in words if word in _KINDS), str)


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


def show(output: Output, *, markdown: bool = False) -> None:
    """Print a table with its notes, at most 110 columns wide or as Markdown; or a line."""
    if isinstance(output, str) or markdown:
        print(output if isinstance(output, str) else output.markdown())
        return
    console = Console(width=_WIDTH, highlight=False)
    drawn = Drawn(
        title=output.heading, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    drawn.add_column(output.first, no_wrap=True)
    for column in output.columns:
        drawn.add_column(column.header, justify="right", overflow="fold")
    for row in output.rows:
        drawn.add_row(row.name, *(output.text(row, k) for k in range(len(output.columns))))
    console.print(drawn)
    for note in output.notes:
        console.print(f"- {note}", markup=False)


def about(**conditions: object) -> str:
    """Return the conditions of a measurement as a note."""
    return " · ".join(f"{name} {value}" for name, value in conditions.items())


def brief(number: float) -> str:
    """Write a positive number with at least two significant digits and no exponent above 1e-4."""
    return f"{number:.0f}" if number >= 100 else f"{number:.2g}"


def seconds(call: Callable[[], object], repeat: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the best time of ``repeat`` runs; with more than one, of further ones if these are short."""
    best, spent, runs = np.inf, 0.0, 0
    while runs < repeat or (repeat > 1 and spent < _AT_LEAST_S):
        begun = clock()
        call()
        taken = clock() - begun
        best, spent, runs = min(best, taken), spent + taken, runs + 1
    return best


def cpu_ms(call: Callable[[], object], repeat: int = 1) -> float:
    """Return the CPU time of a call, the least of some, ms."""
    times = []
    for _ in range(repeat):
        begun = time.process_time()
        call()
        times.append(time.process_time() - begun)
    return 1e3 * min(times)


def peak_mib() -> float:
    """Return this process's peak resident size in MiB (Linux); `resource` begins with that of the parent."""
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024


def cpu() -> str:
    """Return the processor's name and the number of cores."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {len(names) or '?'} cores"


def circumstances() -> str:
    """Return date, machine, versions and command of the figures."""
    versions = f"Python {platform.python_version()} · NumPy {np.__version__} · skelsplat {sk.__version__}"
    return f"{datetime.date.today()} · {cpu()} · {versions}\npython {shlex.join(sys.argv)}"
