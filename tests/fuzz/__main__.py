"""Fuzzing: ``python -m fuzz [AREA …] [--cases N | --minutes M] [--seed S] [--case K] [--out FOLDER]``.

An area is a module with ``case(rng, folder)``, which prepares one case from a seeded generator and returns
what it is, and a function that tries it: it returns the kind of outcome, or raises if the outcome is none
that is allowed. Seed and number of a case decide everything in it. Each case runs in a fork with limits on
time and memory; one that ends it is a finding. Each finding is saved with its files and with the command that
repeats it, which `make` has as ``make fuzz-case CASE="AREA --seed S --case K"``.
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
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from random import Random

import skelsplat

AREAS = ("readers", "arrays")
EXPECTED = {"read", "refused", "answered"}
_PACKAGE = Path(skelsplat.__file__).parent
SECONDS = 20.0  # of the processor for one case; six times as long for one that waits
MEMORY = 2 * 2**30  # bytes of addresses beyond those of the process before
ROUND = 500  # cases per seed, if time is what limits


def hunt(area: str, seed: int, cases: range, out: Path) -> Counter[str]:
    """Try the cases of a seed; count outcomes and causes, and save the first of each cause in ``out``."""
    found: Counter[str] = Counter()
    importlib.import_module(f"fuzz.{area}")
    for number in cases:
        with tempfile.TemporaryDirectory() as folder:
            answer = _in_fork(area, seed, number, Path(folder))
            cause = answer.get("cause", answer["outcome"])
            found[cause] += 1
            if "cause" in answer and found[cause] == 1:
                kept = out / f"{area}-{seed}-{number}"
                shutil.copytree(folder, kept, dirs_exist_ok=True)
                command = f"python -m fuzz {area} --seed {seed} --case {number}"
                text = f"{command}\n{cause}\n\n{answer.get('trace', '')}\n"
                (kept / "how.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
                print(f"{kept}: {cause}\n    {command}", flush=True)
    return found


def _in_fork(area: str, seed: int, number: int, folder: Path) -> dict[str, str]:
    """Try one case in a fork of this process; return its outcome, and the cause if it is a finding."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            _limit()
            answer = {"outcome": attempt(area, seed, number, folder)[1]}
        except BaseException as error:  # also panics
            answer = {"outcome": "finding", "cause": _cause(error), "trace": traceback.format_exc()}
        os.write(writing, json.dumps(answer).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        said = stream.read()
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if said:
        answered: dict[str, str] = json.loads(said)
        return answered
    how = signal.Signals(-ended).name if ended < 0 else f"status {ended}"
    return {"outcome": "ended", "cause": f"process ended: {how}"}


def _limit() -> None:
    """Limit this process; what cases print goes nowhere."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.setitimer(signal.ITIMER_PROF, SECONDS)  # what they send ends the process
    signal.setitimer(signal.ITIMER_REAL, 6 * SECONDS)


def attempt(area: str, seed: int, number: int, folder: Path) -> tuple[str, str]:
    """Try one case here; return what it is and the kind of outcome. Anything that it raises is a finding."""
    folder.mkdir(parents=True, exist_ok=True)
    module = importlib.import_module(f"fuzz.{area}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        told, call = module.case(Random(f"{area} {seed} {number}"), folder)
    with warnings.catch_warnings():
        warnings.simplefilter(getattr(module, "WARNINGS", "error"), RuntimeWarning)  # of NumPy
        warnings.simplefilter("ignore", UserWarning)
        return told, call()


def _cause(error: BaseException) -> str:
    """Return what two findings of one cause have in common: kind of error, and innermost own line."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if _PACKAGE in Path(frame.filename).parents] or frames
    where = f"{Path(own[-1].filename).name}:{own[-1].lineno} {own[-1].name}"
    return f"{type(error).__name__} in {where}: {str(error)[:100]}"


def main() -> int:
    """Run what the arguments ask for; the status is 1 if anything was found."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("areas", nargs="*", default=AREAS)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--cases", type=int, default=ROUND, help="cases of the seed")
    parser.add_argument("--case", type=int, help="one case, in this process")
    parser.add_argument("--minutes", type=float, default=0.0, help="new seeds for so long")
    parser.add_argument("--out", type=Path, default=Path("fuzz-findings"))
    given = parser.parse_args()
    seed = secrets.randbelow(2**32) if given.seed is None else given.seed
    if given.case is not None:
        print(*attempt(given.areas[0], seed, given.case, given.out / "again"), sep="\n")
        return 0
    found: Counter[str] = Counter()
    begin, minutes = time.monotonic(), -1.0
    with contextlib.suppress(KeyboardInterrupt):
        while minutes < given.minutes:
            print(f"seed {seed}: {shlex.join(given.areas)}", flush=True)
            for area in given.areas:
                found += hunt(area, seed, range(given.cases), given.out)
            seed, minutes = secrets.randbelow(2**32), (time.monotonic() - begin) / 60.0
    print(f"{minutes:.1f} minutes, {found.total()} cases")
    for outcome, count in found.most_common():
        print(f"{count:6d} × {outcome}")
    return bool(found.keys() - EXPECTED)


if __name__ == "__main__":
    sys.exit(main())
