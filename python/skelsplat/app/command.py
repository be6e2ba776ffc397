"""The command ``skelsplat app``."""

from __future__ import annotations

from pathlib import Path

from skelsplat._optional import check_installed
from skelsplat.cli.command import takes
from skelsplat.cli.rows import rows

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


@takes(*_OPTIONS, epilog=_EPILOG)
def app(*, folder: Path, port: int = 0, browser: bool) -> None:
    """Open a page in the browser that does all of this, for people without a terminal.

    It lists what a folder holds and what is missing, detects, calibrates,
    refines, shows the report and the videos, and hands out the files.

    [bold]Examples[/bold]

    skelsplat app

    skelsplat app skelsplat-demo --no-browser
    """
    check_installed("nicegui", "skelsplat app", "app")
    from skelsplat.app.server import serve  # takes long to load

    serve(folder, port, browser=browser)
