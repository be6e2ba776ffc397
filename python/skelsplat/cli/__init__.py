"""The command line. Commands parse and print; the rest of the package does the work.

What commands share is in `_app` (list of commands, errors, exit status), `command`, `config`, `rows`,
`options`, `output` and `table`. A command is imported when it is run.
"""

from __future__ import annotations

import sys

from skelsplat.cli._app import app

__all__ = ["app", "main"]


def main() -> None:
    """Run the command line on ``sys.argv`` and leave with its exit status: 0 ok, 1 failed, 2 bad usage."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(
                errors="replace"
            )  # a terminal without µ or → shows a "?" instead of a traceback
    app(prog_name="skelsplat")
