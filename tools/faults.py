"""Plant faults one by one and report which tests find them.

    python tools/faults.py check                  # every fault's text occurs exactly once
    python tools/faults.py plant NAME             # plant one in this checkout, to inspect it
    python tools/faults.py run FOLDER [NAME ...]  # plant all in a copy of HEAD; results go to FOLDER
    python tools/faults.py table FOLDER           # print the table for docs/decisions.md

A fault is an exact text of the source and its replacement (`planted.py`). The text must occur exactly once,
in any source file. The tests expected to find the fault run first. If they pass, the whole short suite
(`make test`) runs, and then the sweeps, which only `make test-all` runs. `run` needs the environment that
`make test` sets up, and cargo for faults in Rust.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

from planted import FAULTS, Fault

ROOT = Path(__file__).parents[1]
SOURCES = (
    *("python/skelsplat/**/*.py", "python/skelsplat/**/*.js"),
    *("crates/skelsplat-core/src/**/*.rs", "crates/skelsplat-py/src/**/*.rs"),
)
MODULE = "python/skelsplat/_skelsplat.abi3.so"
QUICK_BUILD = {
    "CARGO_INCREMENTAL": "1",
    "CARGO_PROFILE_RELEASE_LTO": "off",
    "CARGO_PROFILE_RELEASE_CODEGEN_UNITS": "16",
    "CARGO_PROFILE_RELEASE_DEBUG": "false",
}
PYTEST = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider"]
ALL_CORES = ["--numprocesses", "auto", "--maxprocesses", "8", "--dist", "worksteal"]
CARGO_TEST = ["cargo", "test", "--quiet", "-p", "skelsplat-core"]


@dataclass(frozen=True)
class Outcome:
    """Result for a fault; `suite` is "expected", "short", "long" or "none", `test` the first that failed."""

    fault: str
    suite: str
    test: str


def place_of(fault: Fault, root: Path) -> Path:
    """Return the file that contains the fault's text."""
    texts = {path: _text(path) for pattern in SOURCES for path in sorted(root.glob(pattern))}
    found = [(path, text.count(fault.old)) for path, text in texts.items() if fault.old in text]
    if sum(count for _, count in found) != 1:
        places = ", ".join(f"{path.relative_to(root)} ({count})" for path, count in found) or "nowhere"
        raise SystemExit(f"{fault.name}: expected its text in one place, got it in {places}")
    return found[0][0]


@lru_cache(maxsize=1000)
def _text_at(path: Path, _changed: int) -> str:
    return path.read_text(encoding="utf-8")


def _text(path: Path) -> str:
    return _text_at(path, path.stat().st_mtime_ns)


def plant(fault: Fault, root: Path) -> Path:
    """Write the fault into a tree; return the file."""
    path = place_of(fault, root)
    path.write_text(path.read_text(encoding="utf-8").replace(fault.old, fault.new), encoding="utf-8")
    return path


class Copy:
    """A copy of HEAD in which faults are planted one after the other."""

    def __init__(self, folder: Path) -> None:
        """Copy the files tracked by git and build the module."""
        self.root = folder / "tree"
        if self.root.exists():
            shutil.rmtree(self.root)
        self.root.mkdir(parents=True)
        archive = subprocess.Popen(["git", "archive", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE)
        subprocess.run(["tar", "x"], cwd=self.root, stdin=archive.stdout, check=True)
        archive.wait()
        shared = ROOT.parent / "shared"  # data that tests/real looks for beside a checkout
        if shared.exists() and not (folder / "shared").exists():
            (folder / "shared").symlink_to(shared.resolve())
        package = self.root / "python"
        self.environment = {
            **os.environ,
            **QUICK_BUILD,
            "CARGO_TARGET_DIR": str(folder / "target"),
            "PYTHONPATH": str(package),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        self.build()
        self.sound = (self.root / MODULE).read_bytes()

    def run(self, command: list[str]) -> tuple[bool, str]:
        """Run a command in the tree; return whether it succeeded, and its output."""
        done = subprocess.run(
            command, cwd=self.root, env=self.environment, capture_output=True, text=True, check=False
        )
        return done.returncode == 0, done.stdout + done.stderr

    def build(self) -> None:
        """Build the compiled module and put it into the package."""
        package = ["-p", "skelsplat-py", "--features", "pyo3/extension-module"]
        built, said = self.run(["cargo", "build", "--release", "--quiet", *package])
        if not built:
            raise SystemExit(f"the module does not build:\n{said}")
        library = Path(self.environment["CARGO_TARGET_DIR"]) / "release" / "lib_skelsplat.so"
        (self.root / MODULE).unlink(missing_ok=True)  # it may be in use
        shutil.copyfile(library, self.root / MODULE)

    def find(self, fault: Fault) -> Outcome:
        """Plant a fault, run the tests, and remove the fault."""
        path = place_of(fault, self.root)
        text = path.read_text(encoding="utf-8")
        plant(fault, self.root)
        rust = path.suffix == ".rs"
        to_build = rust
        try:
            for suite, commands in self._suites(fault, rust=rust):
                for command in commands:
                    if to_build and command[0] != "cargo":
                        self.build()
                        to_build = False
                    fine, said = self.run(command)
                    if not fine:
                        return Outcome(fault.name, suite, _first_failure(said))
            return Outcome(fault.name, "none", "")
        finally:
            path.write_text(text, encoding="utf-8")
            if rust:
                (self.root / MODULE).unlink()
                (self.root / MODULE).write_bytes(self.sound)

    @staticmethod
    def _suites(fault: Fault, *, rust: bool) -> list[tuple[str, list[list[str]]]]:
        own = [name for name in fault.finders if name.startswith("cargo ")]
        files = [name for name in fault.finders if name not in own]
        first = [[*CARGO_TEST, *name.split()[1:]] for name in own]
        first += [[*PYTEST, *files]] if files else []
        whole = [[*PYTEST, *ALL_CORES]]
        if rust:
            whole.insert(0, CARGO_TEST)
        return [("expected", first), ("short", whole), ("long", [[*PYTEST, *ALL_CORES, "-m", "sweep"]])]


def _first_failure(said: str) -> str:
    """Return the first test that failed, from what pytest or cargo printed."""
    for pattern in (r"^(?:FAILED|ERROR) (\S+)", r"^test (\S+) \.\.\. FAILED", r"^---- (\S+) stdout"):
        if match := re.search(pattern, said, re.MULTILINE):
            return match[1]
    return (said.strip().splitlines() or ["no output"])[-1][:100]


def run(folder: Path, names: list[str]) -> None:
    """Run the tests on every fault; without `names`, skip those with a result in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    results = folder / "found.jsonl"
    known = {outcome.fault for outcome in read(results)} if not names else set()
    wanted = [fault for fault in FAULTS if (fault.name in names or not names) and fault.name not in known]
    for fault in wanted:
        place_of(fault, ROOT)
    copy = Copy(folder.resolve())
    for fault in wanted:
        outcome = copy.find(fault)
        print(f"{fault.name}: {outcome.suite} {outcome.test}", flush=True)
        with results.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(asdict(outcome)) + "\n")


def read(path: Path) -> list[Outcome]:
    """Return the last outcome of every fault."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    outcomes = [Outcome(**json.loads(line)) for line in lines]
    return list({outcome.fault: outcome for outcome in outcomes}.values())


def table(folder: Path) -> str:
    """Return the results as a table, in the order of the faults."""
    found = {outcome.fault: outcome for outcome in read(folder / "found.jsonl")}
    rows = ["| fault | kind | found by |", "|---|---|---|"]
    for fault in FAULTS:
        outcome = found[fault.name]
        test = f"`{outcome.test.rpartition('/')[2]}`"
        by = {"none": "nothing", "long": f"the long suite alone: {test}"}.get(outcome.suite, test)
        rows.append(f"| {fault.name} | {fault.kind} | {by} |")
    return "\n".join(rows)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("check", help="check that the text of every fault occurs exactly once")
    commands.add_parser("plant").add_argument("name")
    running = commands.add_parser("run")
    running.add_argument("folder", type=Path)
    running.add_argument("names", nargs="*")
    commands.add_parser("table").add_argument("folder", type=Path)
    given = parser.parse_args()
    by_name = {fault.name: fault for fault in FAULTS}
    if given.command == "check":
        for fault in FAULTS:
            place_of(fault, ROOT)
    elif given.command == "plant":
        print(plant(by_name[given.name], ROOT))
    elif given.command == "run":
        run(given.folder, given.names)
    else:
        print(table(given.folder))


if __name__ == "__main__":
    main()
