"""What a run shows in a notebook: the page below a cell, a summary as the output of one."""

from __future__ import annotations

import base64
import html
import importlib
import sys
import tempfile
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from skelsplat._optional import can_draw
from skelsplat.run.tables import facts_of, key_numbers

if TYPE_CHECKING:
    from skelsplat.run._run import Run


def show_page(run: Run) -> None:
    """Show the page below a notebook's cell, or in the browser."""
    path = Path(tempfile.mkdtemp(prefix="skelsplat-")) / "report.html"
    run.write_html(path)
    shell = sys.modules.get("IPython")
    if shell is None or getattr(shell.get_ipython(), "kernel", None) is None:
        webbrowser.open(path.as_uri())
        return
    page = html.escape(path.read_text(encoding="utf-8"))
    # in an element: IPython warns of HTML that is a frame
    frame = f'<div><iframe srcdoc="{page}" width="100%" height="800" frameborder="0"></iframe></div>'
    notebook = importlib.import_module("IPython.display")
    notebook.display(notebook.HTML(frame))


def notebook_view(run: Run) -> str:
    """Return facts, numbers, findings and the overview as HTML, for the output of a notebook's cell."""
    remarked = [(name, f"{value} ({remark})") for name, value, remark in key_numbers(run)]
    rows = [*facts_of(run.report), *remarked]
    cells = "".join(
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows
    )
    found = "".join(
        f"<li>{html.escape(finding.severity)}: {html.escape(finding.text)}</li>" for finding in run.findings
    )
    listed = f"<ul>{found}</ul>" if found else "<p>No findings.</p>"
    return f"<table>{cells}</table>{listed}{_picture(run) if can_draw() else ''}"


def _picture(run: Run) -> str:
    """Return the overview as an element of HTML."""
    with tempfile.TemporaryDirectory() as folder:
        run.write_figures(folder)
        picture = base64.b64encode((Path(folder) / "overview.png").read_bytes()).decode()
    return f'<img alt="overview" style="max-width: 100%" src="data:image/png;base64,{picture}">'
