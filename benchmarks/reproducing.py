"""Run the commands of docs/reproducing.md on simulated data and insert their results into the document.

    python benchmarks/reproducing.py [--only out/noise.md] [--list]

A marker ``<!-- measured: FILE, sections A-B -->`` belongs to the nearest ``sh`` block above it: the block's
lines are run in an empty folder, and sections A to B of FILE (by its headings below the title, from 1)
replace the text between the marker and ``<!-- /measured -->``. A line already run for an earlier marker is
not run again. Commands on the real data sets are in other blocks, which contain ``DATA/``.
"""

from __future__ import annotations

import argparse
import datetime
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from common import cpu

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "reproducing.md"
REAL = "DATA/"
_BLOCK = re.compile(r"```sh\n(?P<sh>.*?)```", re.DOTALL)
_MARKER = re.compile(
    r"<!-- measured: (?P<file>\S+), sections (?P<first>\d+)-(?P<last>\d+) -->\n"
    r"(?P<old>.*?)<!-- /measured -->",
    re.DOTALL,
)


@dataclass(frozen=True)
class Measured:
    """A marker, and the commands that create its file."""

    file: str
    first: int
    last: int
    commands: tuple[str, ...]


def commands(text: str) -> list[str]:
    """Return every line of the document's sh blocks, without comments."""
    return [line for block in _BLOCK.finditer(text) for line in _lines(block["sh"])]


def _lines(block: str) -> list[str]:
    return [line for line in block.replace("\\\n", " ").splitlines() if line and not line.startswith("#")]


def markers(text: str) -> list[Measured]:
    """Return the markers in order, each with the last block above it that needs no real data."""
    out = []
    for marker in _MARKER.finditer(text):
        above = [_lines(block["sh"]) for block in _BLOCK.finditer(text[: marker.start()])]
        lines = next(lines for lines in reversed(above) if not any(REAL in line for line in lines))
        out.append(Measured(marker["file"], int(marker["first"]), int(marker["last"]), tuple(lines)))
    return out


def excerpt(markdown: str, first: int, last: int) -> str:
    """Return sections `first` to `last` of a file, headings at the fourth level."""
    sections = re.split(r"^(?=##+ )", markdown, flags=re.MULTILINE)[1:]
    chosen = "".join(sections[first - 1 : last])
    return re.sub(r"^##+ (.*)$", r"**\1**", chosen, flags=re.MULTILINE).strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", metavar="REGEX", default="", help="only files in which it is found")
    parser.add_argument("--list", action="store_true", help="print the commands and leave")
    options = parser.parse_args()
    text = DOCUMENT.read_text(encoding="utf-8")
    chosen = [marker for marker in markers(text) if re.search(options.only, marker.file)]
    if options.list:
        print("\n".join(dict.fromkeys(line for marker in chosen for line in marker.commands)))
        return
    done: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        for marker in chosen:
            for line in marker.commands:
                if line not in done:
                    print(f"$ {line}", flush=True)
                    run(line, Path(folder))
                    done.add(line)
            text = _replaced(text, marker, (Path(folder) / marker.file).read_text(encoding="utf-8"))
            DOCUMENT.write_text(text, encoding="utf-8")


def run(line: str, folder: Path) -> None:
    """Run a command line with this interpreter's package."""
    program, *arguments = shlex.split(line)
    assert program == "skelsplat", line
    subprocess.run([sys.executable, "-m", "skelsplat", *arguments, "-q"], cwd=folder, check=True)


def _replaced(text: str, marker: Measured, markdown: str) -> str:
    when = f"Measured {datetime.date.today()} on simulated data, {cpu()}."
    new = f"{when}\n\n{excerpt(markdown, marker.first, marker.last)}\n"

    def put(match: re.Match[str]) -> str:
        same = (match["file"], int(match["first"])) == (marker.file, marker.first)
        return match[0].replace(match["old"], new) if same and match["old"] else match[0]

    return _MARKER.sub(put, text)


if __name__ == "__main__":
    main()
