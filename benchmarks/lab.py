"""What the measuring programs share: options from signatures, tables on the terminal, times, the machine.

A program is one or more functions with keyword arguments, which become its options; they return or yield
tables (`skelsplat.evaluation.tables.Table`). Import this module first: it keeps the linear algebra of NumPy,
SciPy and OpenCV on one core.
"""

from __future__ import annotations

import argparse
import datetime
import inspect
import json
import os
import platform
import shlex
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

if "numpy" not in sys.modules:
    libraries = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "NUMBA")
    os.environ.update({f"{name}_NUM_THREADS": "1" for name in libraries})

import numpy as np
from rich.console import Console

import skelsplat as sk
from skelsplat._json import plain
from skelsplat.cli.evaluate import print_experiment
from skelsplat.evaluation.tables import Table

Program = Callable[..., Table | Iterable[Table]]
ONE_THREAD = sk.RefineConfig(n_threads=1)
_KINDS = {"int": int, "float": float, "Path": Path}


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
            one = commands.add_parser(program.__name__, help=text.partition("\n")[0], formatter_class=shape)
            _add_options(one, program)
    given = vars(parser.parse_args())
    program, markdown, as_json = (given.pop(name) for name in ("program", "markdown", "json"))
    if "fields" in given:
        given["fields"] = dict(given["fields"])
    found = program(**given)
    tables = [found] if isinstance(found, Table) else found
    if as_json:
        everything = {"tables": [asdict(table) for table in tables], "circumstances": circumstances()}
        print(json.dumps(plain(everything), indent=1))
        return
    for table in tables:
        show(table, markdown=markdown)
    print(circumstances())


def _add_options(parser: argparse.ArgumentParser, program: Program) -> None:
    """Add an option for every keyword of a program, and an argument for every other parameter."""
    for name, parameter in inspect.signature(program).parameters.items():
        default, option = parameter.default, f"--{name.replace('_', '-')}"
        words = str(parameter.annotation).replace("[", " ").replace(",", " ").split()
        kind = next((_KINDS[word] for word in words if word in _KINDS), str)
        if parameter.kind is not parameter.KEYWORD_ONLY:
            many = {"nargs": "*", "default": default} if isinstance(default, tuple) else {}
            parser.add_argument(name, type=kind, **many)
        elif name == "fields":
            parser.add_argument("--set", dest=name, action="append", type=parsed, default=[])
        elif isinstance(default, bool):
            parser.add_argument(option, action="store_true")
        else:
            several = "+" if "tuple" in words else None
            parser.add_argument(option, type=kind, default=default, nargs=several, help=f"({default})")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    parser.set_defaults(program=program)


def parsed(text: str) -> tuple[str, Any]:
    """Split ``field=value`` and parse the value as one of JSON, else as text."""
    field, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"expected field=value, got {text!r}")
    try:
        return field, json.loads(value)
    except json.JSONDecodeError:
        return field, value


def show(table: Table, *, markdown: bool = False) -> None:
    """Print a table with its notes, at most 110 columns wide or as Markdown."""
    if markdown:
        print(table.markdown())
        return
    console = Console(width=110, highlight=False)
    print_experiment(console, table)
    for note in table.notes:
        console.print(f"- {note}", markup=False)
    sys.stdout.flush()


def about(**conditions: object) -> str:
    """Return the conditions of a measurement as a note."""
    return " · ".join(f"{name} {value}" for name, value in conditions.items())


def wanted(title: str, rows: dict[str, tuple[str, str]]) -> Table:
    """Return the table of figures and their targets."""
    return Table.of(title, "what", {name: {"measured": a, "wanted": b} for name, (a, b) in rows.items()})


def seconds(
    call: Callable[[], object], repeat: int = 1, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the best time of some runs."""
    times = []
    for _ in range(repeat):
        begun = clock()
        call()
        times.append(clock() - begun)
    return min(times)


def cpu_ms(call: Callable[[], object], repeat: int = 1) -> float:
    """Return the CPU time of a call, the least of some, ms."""
    return 1e3 * seconds(call, repeat, time.process_time)


def peak_mib() -> float:
    """Return this process's peak resident size in MiB (Linux); `resource` begins with that of the parent."""
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024


def circumstances() -> str:
    """Return date, machine, versions and command of the figures."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    cores = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    machine = f"{cores[0] if cores else platform.processor()}, {os.cpu_count()} cores"
    versions = f"Python {platform.python_version()} · NumPy {np.__version__} · skelsplat {sk.__version__}"
    return f"{datetime.date.today()} · {machine} · {versions}\npython {shlex.join(sys.argv)}"
