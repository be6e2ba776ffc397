"""What a terminal of 80 columns shows, where stdout, stderr and a progress bar are in the same place."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from io import StringIO

import pytest
from rich.console import Console

from command_line import READ, read_report, texts
from skelsplat.cli.output import print_findings
from skelsplat.cli.table import new_table, print_parts
from skelsplat.findings import Finding, Remedy, Subject


def on_terminal(*arguments):
    """Return the lines that a command leaves on a terminal, each as it was written, however long."""
    pty = pytest.importorskip("pty", reason="no pseudo-terminals here")
    ours, theirs = pty.openpty()
    own = {"TERM": "xterm", "COLUMNS": "80", "LINES": "40"}
    process = subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        **dict.fromkeys(("stdin", "stdout", "stderr"), theirs),
        env={**{name: value for name, value in os.environ.items() if name != "NO_COLOR"}, **own},
    )
    os.close(theirs)
    written = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # how Linux says that nobody writes any more
            break
        if not part:
            break
        written += part
    os.close(ours)
    assert process.wait() == 0, written.decode()
    return shown(written.decode())


def shown(written):
    """Return the lines on a screen: its cursor goes up and to the start of a line, lines are cleared."""
    lines, row, column = [""], 0, 0
    for code, plain in re.findall(r"(\x1b\[[0-9;?]*[A-Za-z]|\r|\n)|([^\x1b\r\n]+)", written):
        if plain:
            lines[row] = lines[row][:column].ljust(column) + plain + lines[row][column + len(plain) :]
            column += len(plain)
        elif code == "\r":
            column = 0
        elif code == "\n":
            row += 1
            lines += [""] * (row == len(lines))
        elif code.endswith("A"):
            row -= int(code[2:-1] or 1)
        elif code == "\x1b[2K":
            lines[row] = ""
    return [line.rstrip() for line in lines]


BAR = """
from skelsplat.cli.output import progress, print_message
with progress("poses", first="refining") as show:
    show("refining", 1, 3)
    print_message("warning: " + 20 * "word ")
    show("refining", 2, 3)
    print_message("warning: last")
with progress("frames") as count:
    count("cam1", 1, 2)
    count("cam2", 1, 2)
    print_message("warning: /" + 30 * "path/")
"""


UNDRAWN = """
from skelsplat.__main__ import main
from skelsplat.run import Run
Run.write_figures = lambda *_: []
main()
"""


def test_a_warning_is_printed_above_the_bar():
    words = f"warning: {20 * 'word '}".split()
    path = f"/{30 * 'path/'}"
    expected = [" ".join(words[:15]), " ".join(words[15:]), "warning: last", "warning:", path]
    assert [line for line in on_terminal("-c", BAR) if line] == expected


def test_a_run_says_each_warning_once_and_leaves_no_bar(recording, arguments):
    folder, rig, _ = recording
    for path in (folder / "openpose" / rig.names[0]).iterdir():
        path.write_text('{"people": []}')
    lines = on_terminal("-c", UNDRAWN, *arguments, *READ, "--no-html", "--write", "trc")
    assert lines[0].startswith("warning: The frame rate is unknown: ")
    assert not [line for line in lines if "━" in line or line.startswith("refining")]
    text = " ".join(lines)
    warnings = texts(read_report(folder / "out"), "warning")
    assert len(warnings) > 1
    assert [text.count(warning) for warning in warnings] == [1] * len(warnings)


def test_a_finding_keeps_its_options_whole():
    console = Console(file=StringIO(), width=50)
    remedy = (Remedy("without", "the camera"), Remedy("frame_by_frame"))
    sentence = "Something is wrong with the camera."
    finding = Finding("remark", "warning", Subject(), {}, remedy, sentence=sentence)
    print_findings([finding], console, of="person 1: ")
    assert console.file.getvalue().splitlines() == [
        "! person 1: Something is wrong with the camera.",
        "Try --without 'the camera', --frame-by-frame.",
    ]


@pytest.mark.parametrize(("width", "parts"), [(40, 2), (80, 1)])
def test_a_table_wider_than_the_terminal_is_printed_in_parts(width, parts):
    table = new_table("Errors", "method", [f"S{k} [mm]" for k in range(6)])
    table.add_row("annealed", *(f"12{k}.45" for k in range(6)))
    console = Console(file=StringIO(), width=width)
    print_parts(console, table)
    text = console.file.getvalue()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    assert (text.count("annealed"), text.count("Errors")) == (parts, 1)
    assert all(f"12{k}.45" in text for k in range(6))
