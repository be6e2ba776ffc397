"""Plant faults one by one and report which tests find them.

    python tools/faults.py FOLDER [NAME ...]  # in a copy of HEAD, all or some of them

A fault is an exact text of the source and its replacement (`planted.py`). The text must occur exactly once,
in any source file. The tests expected to find the fault run first. If they pass, the whole short suite
(`make test`) runs, and then the sweeps, which only `make test-all` runs. It needs the environment that
`make test` sets up, and cargo for faults in Rust, adds a row per fault to the table FOLDER/found.md, and
leaves out the faults that have one.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

from planted import FAULTS, Fault

ROOT = Path(__file__).parents[1]
SOURCES = (
    *("python/skelsplat/**/*.py", "python/skelsplat/**/*.js"),
    *("crates/skelsplat-core/src/**/*.rs", "crates/skelsplat-py/src/**/*.rs"),
)
MODULE = "python/skelsplat/_skelsplat.abi3.so"
FEATURES = ["--features", "pyo3/extension-module"]
QUICK_BUILD = {
    "CARGO_INCREMENTAL": "1",
    "CARGO_PROFILE_RELEASE_LTO": "off",
    "CARGO_PROFILE_RELEASE_CODEGEN_UNITS": "16",
    "CARGO_PROFILE_RELEASE_DEBUG": "false",
}
BUILD = ["cargo", "build", "--release", "--quiet", "-p", "skelsplat-py", *FEATURES]
PYTEST = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider"]
WHOLE_SUITE = [*PYTEST, "--numprocesses", "auto", "--maxprocesses", "8", "--dist", "worksteal"]
CARGO_TEST = ["cargo", "test", "--release", "--quiet", *FEATURES]


def place_of(fault: Fault, root: Path) -> Path:
    """Return the file that contains the fault's text."""
    paths = [path for each in SOURCES for path in sorted(root.glob(each))]
    places = [path for path in paths for _ in range(_text(path, path.stat().st_mtime_ns).count(fault.old))]
    if len(places) != 1:
        found = ", ".join(str(path.relative_to(root)) for path in places) or "nowhere"
        raise SystemExit(f"{fault.name}: expected its text in one place, got it in {found}")
    return places[0]


@lru_cache(maxsize=1000)
def _text(path: Path, _changed: int) -> str:
    return path.read_text(encoding="utf-8")


class Copy:
    """A copy of HEAD in which faults are planted one after the other."""

    def __init__(self, folder: Path) -> None:
        """Copy the files tracked by git and build the module."""
        self.root = folder / "tree"
        shutil.rmtree(self.root, ignore_errors=True)
        self.root.mkdir(parents=True)
        archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True)
        subprocess.run(["tar", "x"], cwd=self.root, input=archive.stdout, check=True)
        shared = ROOT.parent / "shared"  # data that tests/real looks for beside a checkout
        if shared.exists() and not (folder / "shared").exists():
            (folder / "shared").symlink_to(shared.resolve())
        self.environment = {
            **os.environ,
            **QUICK_BUILD,
            "CARGO_TARGET_DIR": str(folder / "target"),
            "PYTHONPATH": str(self.root / "python"),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        self.build()
        self.sound = (self.root / MODULE).read_bytes()

    def run(self, command: list[str]) -> tuple[bool, str]:
        """Run a command in the tree; return whether it succeeded, and its output."""
        done = subprocess.run(
            command, cwd=self.root, env=self.environment, capture_output=True, text=True, check=False
        )
        return done.returncode in (0, 5), done.stdout + done.stderr  # pytest's 5: finders that are skipped

    def build(self) -> None:
        """Build the compiled module and put it into the package."""
        built, said = self.run(BUILD)
        if not built:
            raise SystemExit(f"the module does not build:\n{said}")
        self.install((Path(self.environment["CARGO_TARGET_DIR"]) / "release/lib_skelsplat.so").read_bytes())

    def install(self, module: bytes) -> None:
        """Put a compiled module into the package; that of before may be in use."""
        (self.root / MODULE).unlink(missing_ok=True)
        (self.root / MODULE).write_bytes(module)

    def find(self, fault: Fault) -> str:
        """Plant a fault, run the tests, and remove the fault; return what found it."""
        path = place_of(fault, self.root)
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
        rust, built = path.suffix == ".rs", False
        try:
            for words, command in suites(fault, rust=rust):
                if rust and not built and command[0] != "cargo":
                    self.build()
                    built = True
                fine, said = self.run(command)
                if not fine:
                    return f"{words}`{_first_failure(said).rpartition('/')[2]}`"
            return "nothing"
        finally:
            path.write_text(text, encoding="utf-8")
            if built:
                self.install(self.sound)


def suites(fault: Fault, *, rust: bool) -> list[tuple[str, list[str]]]:
    """Return the commands that may find a fault, in order, and what to say before the test that does."""
    own = [name for name in fault.finders if name.startswith("cargo ")]
    files = [name for name in fault.finders if name not in own]
    commands = [[*CARGO_TEST, *name.split()[1:]] for name in own]
    commands += [[*PYTEST, *files]] * bool(files) + [CARGO_TEST] * rust + [WHOLE_SUITE]
    sweeps = ("the long suite alone: ", [*WHOLE_SUITE, "-m", "sweep"])
    return [*(("", command) for command in commands), sweeps]


def _first_failure(said: str) -> str:
    """Return the first test that failed, from what pytest or cargo printed."""
    for pattern in (r"^(?:FAILED|ERROR) (\S+)", r"^test (\S+) \.\.\. FAILED", r"^---- (\S+) stdout"):
        if match := re.search(pattern, said, re.MULTILINE):
            return match[1]
    return (said.strip().splitlines() or ["no output"])[-1][:100]


def run(folder: Path, names: list[str]) -> None:
    """Run the tests on every fault, or on some; those with a row in the table are left out."""
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "found.md"
    if not table.exists():
        table.write_text("| fault | found by |\n|---|---|\n", encoding="utf-8")
    known = table.read_text(encoding="utf-8")
    copy = Copy(folder.resolve())
    for fault in FAULTS:
        if (names and fault.name not in names) or f"| {fault.name} |" in known:
            continue
        row = f"| {fault.name} | {copy.find(fault)} |"
        print(f"{fault.kind}: {row}", flush=True)
        with table.open("a", encoding="utf-8") as stream:
            stream.write(f"{row}\n")


if __name__ == "__main__":
    run(Path(sys.argv[1]), sys.argv[2:])
