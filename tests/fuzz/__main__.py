"""Fuzzing: ``python -m fuzz [AREA …] [--cases N | --minutes M] [--seed S] [--case K] [--out FOLDER]``.

An area is a module with ``case(rng, folder)``, which prepares one case from a seeded generator and returns
what it is, and a function that tries it: it returns the kind of outcome, or raises if the outcome is none
that is allowed. Seed and number of a case decide everything in it. Cases run in a process of their own with
limits on time and memory; if one ends the process, that is a finding, and another process goes on after it.
Each finding is saved with its files and with the command that repeats it, which `make` has as
``make fuzz-case CASE="AREA --seed S --case K"``.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import resource
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import skelsplat

AREAS = ("readers", "arrays")
_PACKAGE = Path(skelsplat.__file__).parent
SECONDS = 20.0  # of the processor for one case; six times as long for one that waits
MEMORY = 2 * 2**30  # bytes of addresses beyond those of the process before
ROUND = 500  # cases per seed, if time is what limits


@dataclass
class Findings:
    """What a hunt found: outcomes counted, and for each cause the first case."""

    outcomes: Counter[str] = field(default_factory=Counter)
    cases: dict[str, tuple[int, str]] = field(default_factory=dict)  # cause → how often, command of the first

    def add(self, cause: str, command: str) -> bool:
        """Count a finding; return whether it is the first of its cause."""
        count, first = self.cases.get(cause, (0, command))
        self.cases[cause] = (count + 1, first)
        return count == 0


def hunt(
    area: str, seed: int, cases: range, out: Path, found: Findings | None = None, limit: float = SECONDS
) -> Findings:
    """Try the cases of a seed, each for ``limit`` seconds; save those that fail beneath ``out``."""
    found = Findings() if found is None else found
    with tempfile.TemporaryDirectory() as beneath:
        folder, first = Path(beneath), cases.start
        while first < cases.stop:
            first = _worker(area, seed, range(first, cases.stop), folder, out, found, limit)
    return found


def _worker(
    area: str, seed: int, cases: range, folder: Path, out: Path, found: Findings, limit: float
) -> int:
    """Try cases in one process until it ends; return the number of the case to go on with."""
    command = [sys.executable, "-m", "fuzz", area, "--seed", str(seed)]
    span = [f"--work={cases.start}:{cases.stop}", f"--out={folder}", f"--limit={limit}"]
    number, cause, told = -1, "", ""
    with subprocess.Popen([*command, *span], stdout=subprocess.PIPE, text=True, env=_environment()) as child:
        for line in child.stdout or ():
            answer = json.loads(line)
            number, cause = answer["case"], answer.get("cause", "")
            told = answer.get("told", told)
            if "outcome" in answer:
                found.outcomes[answer["outcome"]] += 1
            if cause:
                _save(area, seed, number, folder, out, cause, f"{told}\n{answer['trace']}", found)
            if "begun" not in answer:
                number += 1
    if child.returncode == 0:
        return cases.stop
    if number < 0:
        raise RuntimeError(f"{shlex.join(command)} does not begin")
    ended = signal.Signals(-child.returncode).name if child.returncode < 0 else f"status {child.returncode}"
    found.outcomes["ended"] += 1
    _save(area, seed, number, folder, out, f"process ended: {ended}: {told.splitlines()[0]}", told, found)
    return number + 1


def _environment() -> dict[str, str]:
    """Return what lets a worker import what this process imports, and takes no more than one core."""
    threads = {"OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "2"}
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **threads}


def _save(
    area: str, seed: int, number: int, folder: Path, out: Path, cause: str, told: str, found: Findings
) -> None:
    command = f"python -m fuzz {area} --seed {seed} --case {number}"
    if found.add(cause, command):
        kept = out / f"{area}-{seed}-{number}"
        shutil.copytree(folder / str(number), kept, dirs_exist_ok=True)
        (kept / "how.txt").write_text(
            f"{command}\n{cause}\n\n{told}\n", encoding="utf-8", errors="backslashreplace"
        )
        print(f"{kept}: {cause}", flush=True)


def attempt(area: str, seed: int, number: int, folder: Path) -> tuple[str, str]:
    """Try one case here; return what it is and the kind of outcome. Anything that it raises is a finding."""
    _answer(case=number, begun=True, told="preparing")
    folder = folder / str(number)
    folder.mkdir(parents=True, exist_ok=True)
    rng = Random(f"{area} {seed} {number}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        module = importlib.import_module(f"fuzz.{area}")
        told, call = module.case(rng, folder)
    _answer(case=number, begun=True, told=told)
    with warnings.catch_warnings():
        warnings.simplefilter(getattr(module, "WARNINGS", "error"), RuntimeWarning)  # of NumPy
        warnings.simplefilter("ignore", UserWarning)
        return told, call()


def _answer(**values: object) -> None:
    print(json.dumps(values), file=_ANSWERS, flush=True)


_ANSWERS = sys.stdout


def work(area: str, seed: int, cases: range, folder: Path, limit: float) -> None:
    """Try cases in this process, each under limits, and tell the parent about them as lines of JSON."""
    global _ANSWERS  # what cases print goes nowhere
    importlib.import_module(f"fuzz.{area}")
    _ANSWERS = os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for number in cases:
        signal.setitimer(signal.ITIMER_PROF, limit)  # what they send ends the process
        signal.setitimer(signal.ITIMER_REAL, 6 * limit)
        try:
            _, outcome = attempt(area, seed, number, folder)
        except BaseException as error:  # also panics
            _answer(case=number, trace=traceback.format_exc(), cause=_cause(error), outcome="finding")
        else:
            _answer(case=number, outcome=outcome)
            shutil.rmtree(folder / str(number))


def _cause(error: BaseException) -> str:
    """Return what two findings of one cause have in common: kind of error, and innermost own line."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if _PACKAGE in Path(frame.filename).parents] or frames
    where = f"{Path(own[-1].filename).name}:{own[-1].lineno} {own[-1].name}"
    innermost = f"{Path(frames[-1].filename).name} {frames[-1].name}"
    words = f": {str(error)[:100]}" if isinstance(error, AssertionError) else ""
    return f"{type(error).__name__} in {where} ({innermost}){words}"


def main() -> int:
    """Run what the arguments ask for; the status is 1 if anything was found."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("areas", nargs="*", default=AREAS)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--cases", type=int, default=ROUND, help="cases of the seed")
    parser.add_argument("--case", type=int, help="one case, in this process")
    parser.add_argument("--minutes", type=float, help="new seeds for so long")
    parser.add_argument("--out", type=Path, default=Path("fuzz-findings"))
    parser.add_argument("--limit", type=float, default=SECONDS, help="seconds of the processor for one case")
    parser.add_argument("--work", help=argparse.SUPPRESS)
    given = parser.parse_args()
    seed = secrets.randbelow(2**32) if given.seed is None else given.seed
    if given.work:
        first, last = map(int, given.work.split(":"))
        work(given.areas[0], seed, range(first, last), given.out, given.limit)
        return 0
    if given.case is not None:
        print(*attempt(given.areas[0], seed, given.case, given.out / "again"), sep="\n")
        return 0
    return _hunt_all(given, seed)


def _hunt_all(given: argparse.Namespace, seed: int) -> int:
    found, begin = Findings(), time.monotonic()
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            print(f"seed {seed}: {shlex.join(given.areas)}", flush=True)
            for area in given.areas:
                hunt(area, seed, range(given.cases), given.out, found, given.limit)
            if given.minutes is None or time.monotonic() - begin > 60.0 * given.minutes:
                break
            seed = secrets.randbelow(2**32)
    minutes = (time.monotonic() - begin) / 60.0
    counts = ", ".join(f"{name} {count}" for name, count in found.outcomes.most_common())
    print(f"{minutes:.1f} minutes, {found.outcomes.total()} cases: {counts}")
    for cause, (count, command) in found.cases.items():
        print(f"{count:6d} × {cause}\n         {command}")
    return bool(found.cases)


if __name__ == "__main__":
    sys.exit(main())
