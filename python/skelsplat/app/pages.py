"""The pages, what they share, and the page of a folder: where recordings are chosen, and refined together."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

from nicegui import run, ui

from skelsplat.app.forms import Form
from skelsplat.app.found import output_of
from skelsplat.app.parts import address, note, part
from skelsplat.app.places import Place
from skelsplat.app.progress import show_progress
from skelsplat.app.recording_page import RecordingPage
from skelsplat.app.recording import set_in
from skelsplat.app.recordings import Recordings
from skelsplat.app.results import read_result
from skelsplat.exceptions import SkelSplatError

_HERE = Path(__file__).parent
_SAID = (SkelSplatError, OSError)


def add_pages(recordings: Recordings) -> None:
    """Add the page of a folder and that of a recording."""

    @ui.page("/")
    async def folder_page(at: str = "") -> None:
        folder = _opened(recordings.place, at)
        if folder is not None:
            await _folder(recordings, folder)

    @ui.page("/recording")
    async def recording_page(at: str = "") -> None:
        folder = _opened(recordings.place, at)
        if folder is not None:
            RecordingPage(await run.io_bound(recordings.at, folder)).show()


def _opened(place: Place, at: str) -> Path | None:
    """Begin a page about a folder, and return it; None, with the reason on the page, if it is refused."""
    ui.add_css((_HERE / "page.css").read_text(encoding="utf-8"))
    ui.add_body_html(f"<script>{(_HERE / 'page.js').read_text(encoding='utf-8')}</script>")
    ui.colors(primary="#0a6ea8", positive="#1d7a46", negative="#b3261e", warning="#b4540a")
    ui.query("html").props("lang=en")
    try:
        folder = place.inside(at)
        if not folder.is_dir():
            raise NotADirectoryError(None, "there is no such folder", at)
    except _SAID as error:
        with ui.element("main").classes("s-main"):
            note("error", str(error))
            ui.link("Back to the folders", "/")
        return None
    with ui.element("header").classes("s-top"), ui.element("div"):
        ui.link("SkelSplat", "/").classes("s-brand")
        with ui.element("nav").classes("s-crumbs").props('aria-label="Folders"'):
            _crumbs(place, folder)
    return folder


def _crumbs(place: Place, folder: Path) -> None:
    ui.link(place.root.name or str(place.root), "/")
    for one in reversed([folder, *folder.parents]):
        if place.root in one.parents:
            ui.label("/")
            ui.link(one.name, address("/", place.relative(one)))


async def _folder(recordings: Recordings, folder: Path) -> None:
    """Show a folder: those in it, which of them hold recordings, and how to refine these together."""
    place = recordings.place
    with ui.element("main").classes("s-main"):
        ui.html(f"<h1 class='s-title'>{escape(folder.name or str(folder))}</h1>", sanitize=False)
        try:
            folders = place.folders(folder)
            inside = await run.io_bound(recordings.inside, folder)
        except _SAID as error:
            note("error", str(error))
            return
        with ui.element("section").classes("s-card"):
            part("Choose the folder of a recording")
            ui.label(
                "It has one video per camera, or the keypoints that a detector has found in them, and "
                "a calibration if you have one. An empty folder will do: files can be dropped into it."
            ).classes("s-dim")
            ui.button(
                "Use this folder", on_click=lambda: ui.navigate.to(address("/recording", place.relative(folder)))
            ).props("unelevated no-caps color=primary").classes("self-start")
            _typed(place, folder)
            with ui.element("div").classes("s-folders"):
                for one in folders:
                    _entry(place, one, one in inside)
                if not folders:
                    ui.label("There are no folders in it.").classes("s-dim s-small")
        if len(inside) > 1:
            with ui.element("section").classes("s-card"):
                _together(recordings, folder, inside)


def _typed(place: Place, folder: Path) -> None:
    """Show the path, where another can be typed."""

    def go() -> None:
        try:
            ui.navigate.to(address("/", place.relative(place.inside(path.value or "", folder))))
        except _SAID as error:
            path.props(f'error error-message="{escape(str(error))}"')

    path = ui.input("Path", value=str(folder)).props("outlined dense").classes("w-full")
    path.on("keydown.enter", go)


def _entry(place: Place, folder: Path, holds: bool) -> None:
    with ui.element("div").classes("s-folder"):
        ui.icon("folder").classes("s-dim").props("aria-hidden=true")
        ui.link(folder.name, address("/recording" if holds else "/", place.relative(folder)))
        if holds:
            ui.label("recording").classes("s-badge")
        if read_result(folder / output_of(folder)) is not None:
            ui.label("has results").classes("s-badge")


def _together(recordings: Recordings, folder: Path, inside: list[Path]) -> None:
    """Show how several recordings are refined together."""
    chosen = dict.fromkeys(inside, True)
    given = recordings.given.setdefault(folder, {})

    def choose(one: Path) -> Callable[[Any], None]:
        return lambda event: chosen.__setitem__(one, bool(event.value))

    async def start() -> None:
        try:
            await run.io_bound(recordings.batch, folder, [one for one, on in chosen.items() if on])
        except _SAID as error:
            with problems:
                problems.clear()
                note("error", str(error))
            return
        problems.clear()
        progress.refresh()

    @ui.refreshable
    def progress() -> None:
        work = recordings.batches.get(folder)
        if work is not None:
            show_progress(work, work.cancel, progress.refresh)

    part("Several recordings at once")
    ui.label("All with the same settings; each keeps its own results. What is done already is not done again.").classes(
        "s-dim"
    )
    with ui.element("div").classes("s-row"):
        for one in inside:
            ui.checkbox(one.name, value=True, on_change=choose(one))
    with ui.expansion("Settings for all of them").classes("w-full"):
        form = Form({"refine": given}, lambda _, name, value: set_in(given, name, value))
        form.main(["refine"])
        form.more(["refine"])
    problems = ui.element("div")
    progress()
    ui.button("Refine the chosen recordings", on_click=start).props("unelevated no-caps color=primary").classes(
        "self-start"
    )
