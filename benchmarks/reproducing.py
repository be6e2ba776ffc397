"""Run the commands of docs/measurements.md on simulated data and insert their tables into the page.

    python benchmarks/reproducing.py

A marker ``<!-- measured: FILE.md, table N -->`` takes the N-th table of a file, ``<!-- measured: column NAME
of FOLDER, FOLDER -->`` one column of each folder's ``report.csv``, a row per method. It replaces the text
up to ``<!-- /measured -->``. The nearest ``sh`` block above makes the files: its lines are run in an empty
folder, each once. Commands on the real data sets are in other blocks, which contain ``DATA/``.
"""

from __future__ import annotations

import csv
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from skelsplat.evaluation.tables import Column, Row, Table

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "measurements.md"
REAL = "DATA/"
OURS = "SkelSplat ("  # published rows that the page quotes
_BLOCK = re.compile(r"```sh\n(?P<sh>.*?)```", re.DOTALL)
_MARKER = re.compile(r"<!-- measured: (?P<what>.+) -->\n")
_TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


@dataclass(frozen=True)
class Measured:
    """What a marker asks for, and the commands that make it."""

    what: str
    commands: tuple[str, ...]


def commands(text: str) -> list[str]:
    """Return every command of the page's sh blocks that is one of skelsplat."""
    return [line for block in _BLOCK.finditer(text) for line in _lines(block["sh"])]


def _lines(block: str) -> list[str]:
    return [line for line in block.replace("\\\n", " ").splitlines() if line.startswith("skelsplat ")]


def markers(text: str) -> list[Measured]:
    """Return the markers in order, each with the last block above it that needs no real data."""
    out = []
    for marker in _MARKER.finditer(text):
        above = [_lines(block["sh"]) for block in _BLOCK.finditer(text[: marker.start()])]
        lines = next(lines for lines in reversed(above) if not any(REAL in line for line in lines))
        out.append(Measured(marker["what"], tuple(lines)))
    return out


def table(what: str, folder: Path) -> str:
    """Return the table that a marker asks for, from the files in `folder`."""
    if column := re.fullmatch(r"column (\w+) of (.+)", what):
        return _columns(column[1], [folder / name for name in column[2].split(", ")])
    file, number = what.split(", table ")
    return _TABLE.findall((folder / file).read_text(encoding="utf-8"))[int(number) - 1]


def _columns(name: str, folders: list[Path]) -> str:
    values: dict[tuple[bool, str], dict[str, float]] = {}
    for folder in folders:
        with (folder / "report.csv").open(encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream):
                reported = row["reported"] == "1"
                if row["group"] == "all" and row[name] and (not reported or row["method"].startswith(OURS)):
                    values.setdefault((reported, row["method"]), {})[folder.name] = float(row[name])
    names = [folder.name for folder in folders]
    rows = [
        Row(method, tuple(map(found.get, names)), "reported" if reported else "measured")
        for (reported, method), found in sorted(values.items(), key=lambda item: item[0][0])
    ]
    return Table("", "method", tuple(map(Column, names)), tuple(rows)).markdown()


def main() -> None:
    """Run the commands of the markers, and insert their tables."""
    text = DOCUMENT.read_text(encoding="utf-8")
    chosen = markers(text)
    lines = list(dict.fromkeys(line for marker in chosen for line in marker.commands))
    with tempfile.TemporaryDirectory() as folder:
        for line in lines:
            print(f"$ {line}", flush=True)
            command = [sys.executable, "-m", "skelsplat", *shlex.split(line)[1:], "-q"]
            subprocess.run(command, cwd=folder, check=True)
        for marker in chosen:
            text = replaced(text, marker.what, table(marker.what, Path(folder)))
    DOCUMENT.write_text(text, encoding="utf-8")


def replaced(text: str, what: str, new: str) -> str:
    """Return the page with the text of one marker replaced."""
    begin = f"<!-- measured: {what} -->\n"
    before, rest = text.split(begin)
    return before + begin + new + rest[rest.index("<!-- /measured -->") :]


if __name__ == "__main__":
    main()
