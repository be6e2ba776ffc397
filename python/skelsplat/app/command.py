"""The command ``skelsplat app``."""

from __future__ import annotations

import webbrowser
from pathlib import Path

from skelsplat._optional import check_installed
from skelsplat.cli.command import takes
from skelsplat.cli.output import print_json, say
from skelsplat.cli.rows import AS_JSON, QUIET, rows

_EPILOG = (
    "The printed address has a key in it: without it, nobody on this machine can use the page, and no other "
    "site can. Ctrl-C ends it, and what it is doing."
)
_OPTIONS = rows(
    """
    FOLDER  Folder of a recording, or one with such folders; without, your home folder. Nothing outside of it
        is read or written. [optional]
    --port N  Port on 127.0.0.1. [one that is free]
    --no-browser  Only print the address.
    """,
    folder={"default": Path.home()},
    port={"kind": int, "limits": {"min": 1, "max": 65535}},
)


@takes(*_OPTIONS, QUIET, AS_JSON, epilog=_EPILOG)
def app(*, folder: Path, port: int = 0, browser: bool, quiet: bool, as_json: bool) -> None:
    """Open a page in the browser that does all of this, for people without a terminal.

    It lists what a folder holds and what is missing, detects, calibrates,
    refines, shows the report and the videos, and hands out the files.

    [bold]Examples[/bold]

    skelsplat app

    skelsplat app skelsplat-demo --no-browser
    """
    check_installed("nicegui", "skelsplat app", "app")
    from skelsplat.app.server import serve  # takes long to load

    def tell(address: str, root: Path) -> None:
        if as_json:
            print_json({"address": address, "folder": str(root)})
        elif not quiet:
            say(f"SkelSplat is open at {address}", f"for {root}. Ctrl-C ends it.")
        if browser:
            webbrowser.open(address)

    serve(folder, port, tell)
