"""What the measuring programs share: options from signatures, tables as Markdown, times, the machine.

A program is one or more functions with keyword arguments, which become its options; a tuple is one to repeat.
They return or yield tables. Import this module first: it keeps the linear algebra of NumPy, SciPy and OpenCV
on one core.
"""

from __future__ import annotations

import datetime
import inspect
import json
import os
import platform
import shlex
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any, get_args, get_origin

if "numpy" not in sys.modules:
    libraries = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "NUMBA")
    os.environ.update({f"{name}_NUM_THREADS": "1" for name in libraries})

import numpy as np
import typer

import skelsplat as sk
from skelsplat._json import plain
from skelsplat.evaluation.tables import Table

Program = Callable[..., Table | Iterable[Table]]
ONE_THREAD = sk.RefineConfig(n_threads=1)
_AS_JSON = inspect.Parameter("json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=bool)


def main(about: str | None, *programs: Program) -> None:
    """Run the program, of several the one that the command line names, and print what it gives."""
    app = typer.Typer(help=about, add_completion=False, rich_markup_mode=None)
    for program in programs:
        words = inspect.getdoc(program) if len(programs) > 1 else about
        as_written = (words or "").replace("\n\n", "\n\n\b\n")
        app.command(program.__name__, help=as_written)(_command(program))
    app()


def _command(program: Program) -> Callable[..., None]:
    """Return a program as typer reads it, with the option of the output; tuples are repeated options."""

    def command(**given: Any) -> None:
        as_json = given.pop("json")
        found = program(**given)
        tables = [found] if isinstance(found, Table) else found
        if as_json:
            everything = {"tables": [asdict(table) for table in tables], "circumstances": circumstances()}
            print(json.dumps(plain(everything), indent=1))
            return
        for table in tables:
            print(table.markdown(), flush=True)
        print(circumstances())

    own = inspect.signature(program, eval_str=True).parameters
    command.__signature__ = inspect.Signature([*map(_option, own.values()), _AS_JSON])
    return command


def _option(parameter: inspect.Parameter) -> inspect.Parameter:
    kind = parameter.annotation
    return parameter.replace(annotation=list[get_args(kind)[0]]) if get_origin(kind) is tuple else parameter


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


def alone(call: Callable[..., Any], *given: object) -> Any:
    """Return what a call gives in a process of its own."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(call, *given).result()


def circumstances() -> str:
    """Return date, machine, versions and command of the figures."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    cores = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    machine = f"{cores[0] if cores else platform.processor()}, {os.cpu_count()} cores"
    versions = f"Python {platform.python_version()} · NumPy {np.__version__} · skelsplat {sk.__version__}"
    return f"{datetime.date.today()} · {machine} · {versions}\npython {shlex.join(sys.argv)}"
