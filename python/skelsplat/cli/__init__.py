"""The command line: one file per command. Commands parse and print; the rest of the package does the work.

`demo` and `refine` are runs of `skelsplat.run`, printed by `table`; `overlay` and `plot` use `skelsplat.run`
as well. What commands share is in `_app` (errors, exit status), `config`, `options` and `output`.
"""

from __future__ import annotations

import sys

from skelsplat.cli import (
    ablate,
    check_cameras,
    convert,
    datasets,
    demo,
    evaluate,
    live,
    overlay,
    plot,
    refine,
    synth,
)
from skelsplat.cli._app import app

__all__ = ["app", "main"]

app.command("demo")(demo.demo)
app.command("refine", epilog=refine.EPILOG, common=refine.COMMON)(refine.refine)
app.command("overlay", epilog=overlay.EPILOG)(overlay.overlay)
app.command("live", epilog=live.EPILOG)(live.live)
app.command("plot", epilog=plot.EPILOG)(plot.plot)
app.command("convert", epilog=convert.EPILOG)(convert.convert)
app.command("check-cameras", epilog=check_cameras.EPILOG, common=check_cameras.COMMON)(
    check_cameras.check_cameras
)
app.command("synth")(synth.synth)
app.add_typer(datasets.app, name="datasets")
app.command("evaluate", epilog=evaluate.EPILOG)(evaluate.evaluate)
app.command("ablate", epilog=ablate.EPILOG)(ablate.ablate)


def main() -> None:
    """Run the command line on ``sys.argv`` and leave with its exit status: 0 ok, 1 failed, 2 bad usage."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(
                errors="replace"
            )  # a terminal without µ or → shows a "?" instead of a traceback
    app(prog_name="skelsplat")
