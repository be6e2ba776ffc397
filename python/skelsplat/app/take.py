"""What is taken from the page of a recording: files, the command line and the Python that do the same."""

from __future__ import annotations

import shlex
from html import escape
from typing import TYPE_CHECKING
from urllib.parse import quote

from nicegui import ui

from skelsplat.app.found import output_of
from skelsplat.app.parts import button, code, html, part
from skelsplat.app.recording import python_of
from skelsplat.app.results import size_of
from skelsplat.exceptions import SkelSplatError
from skelsplat.io.poses import POSE_FORMATS

if TYPE_CHECKING:
    from skelsplat.app.recording_page import RecordingPage
    from skelsplat.app.results import Result


def show_files(page: RecordingPage) -> None:
    """Show the files of the result, and what would do the same without the page."""
    recording = page.recording
    with ui.element("section").classes("s-card").props("aria-label=Files"):
        part("4  Files")
        if recording.result is not None:
            _files(page, recording.result)
        part("The same on the command line", 3)
        lines = [f"cd {shlex.quote(str(recording.folder))}", *recording.done]
        try:
            typed = shlex.join(["skelsplat", *recording.words("refine")])
            python = python_of(recording.job()) if recording.found and recording.found.ready else ""
        except SkelSplatError as error:
            typed, python = f"# {error}", ""
        code("\n".join(dict.fromkeys([*lines, typed])), "the commands")
        if python:
            part("The same in Python", 3)
            code(python, "the Python lines")


def _files(page: RecordingPage, result: Result) -> None:
    folder = page.recording.place.relative(
        (page.recording.folder / output_of(page.recording.folder)).resolve()
    )
    ui.button(
        "Everything as one zip file", icon="download",
        on_click=lambda: ui.navigate.to(f"/zip?folder={quote(folder)}"),
    ).props("no-caps unelevated color=primary").classes("self-start")  # fmt: skip
    links = (
        f"<a href='{page.address(name, download='1')}' download><b>{escape(name)}</b>"
        f"<span class='s-dim s-small'>{escape(about)}</span>"
        f"<span class='s-dim s-small'>{size_of(size)}</span></a>"
        for name, about, size in result.files
    )
    html("".join(links)).classes("s-files")
    there = {name.partition(".")[2] for name, _, _ in result.files}
    lacking = [kind for kind in POSE_FORMATS if kind not in there]
    if lacking and not page.recording.running:
        with ui.element("div").classes("s-row"):
            ui.label("Also write").classes("s-dim s-small")
            for kind in lacking:
                button(kind, lambda kind=kind: _also(page, kind)).props("dense")


async def _also(page: RecordingPage, kind: str) -> None:
    """Refine again with one more format."""
    before = page.recording.given["refine"].get("write", "csv,trc")
    page.recording.set("refine", "write", f"{before},{kind}")
    await page.press(page.recording.start, "refine")
