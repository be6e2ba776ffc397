"""Options that commands share, with their help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

OUTPUT, METHOD = "Output", "Method"

Out = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="FOLDER", help="Folder for the results.", rich_help_panel=OUTPUT),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Say nothing but warnings and errors.", rich_help_panel=OUTPUT)
]
AsJson = Annotated[
    bool,
    typer.Option("--json", help="Print the report as JSON on stdout, and no table.", rich_help_panel=OUTPUT),
]
Threads = Annotated[
    int | None,
    typer.Option(
        "--threads", min=1, metavar="N", help="Threads to use.  [default: all cores]", rich_help_panel=METHOD
    ),
]
