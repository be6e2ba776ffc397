"""The pages, what they share, and the page of a folder: where recordings are chosen, and refined together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import run, ui

from skelsplat.app import parts
from skelsplat.app.forms import Form
from skelsplat.app.places import Place
from skelsplat.app.recording_page import RecordingPage
from skelsplat.app.recordings import Recordings
from skelsplat.cli.process import DONE, RUNNING
from skelsplat.cli.settings import are_wrong, put, worded
from skelsplat.exceptions import SkelSplatError
from skelsplat.io._run_files import is_run
from skelsplat.run.contents import RECORDING, kinds_of
from skelsplat.run.found import output_of

_HERE = Path(__file__).parent
_WHAT = (
    "It has one video per camera, or the keypoints that a detector has found in them, and a calibration if "
    "there is one. An empty folder will do, too: files can be dropped into it."
)
_TOGETHER = "All with the same settings, each with its own results. What has not changed is not done again."


def add_pages(recordings: Recordings) -> None:
    """Add the page of a folder and that of a recording."""
    place = recordings.place

    @ui.page("/")
    async def folder_page(at: str = "") -> None:
        await _show(place, at, lambda one: kinds_of(one, place.folders(one)), partial(_folder, recordings))

    @ui.page("/recording")
    async def recording_page(at: str = "") -> None:
        await _show(place, at, recordings.at, lambda _, recording: RecordingPage(recording).show())


async def _show(place: Place, at: str, look: Callable[[Path], Any], show: Callable[..., None]) -> None:
    """Show the page of a folder, or why it is refused."""
    ui.add_css((_HERE / "page.css").read_text(encoding="utf-8"))
    ui.add_body_html(f"<script>{(_HERE / 'page.js').read_text(encoding='utf-8')}</script>")
    ui.colors(primary="#0a6ea8", positive="#1d7a46", negative="#b3261e", warning="#b4540a")
    main = ui.element("div").classes("s-main")
    try:
        folder = place.folder(at)
        with ui.element("header").classes("s-top") as header, ui.element("div"):
            ui.link("SkelSplat", "/").classes("s-brand")
            with ui.element("nav").classes("s-crumbs").props('aria-label="Folders"'):
                for one in reversed([folder, *folder.parents]):
                    if one.is_relative_to(place.root):
                        ui.link(one.name or str(one), parts.address("/", at=place.relative(one)))
        header.move(target_index=0)
        with main:
            parts.html(f"<h1 class='s-title'>{parts.shown(folder.name or folder)}</h1>")
            waiting = ui.label("Looking at the folder …").props("role=status").classes("s-dim")
            client = ui.context.client
            await client.connected()  # long recordings take their time
            found = await run.io_bound(look, folder)
            if found is not None and client.id in client.instances:  # else the server or the tab has ended
                waiting.delete()
                show(folder, found)
    except (SkelSplatError, OSError) as error:
        main.clear()
        with main:
            parts.note("error", str(error))
            ui.link("Back to the first folder", "/")


def _folder(recordings: Recordings, folder: Path, kinds: Mapping[Path, str]) -> None:
    """Show a folder: those in it, which of them hold recordings, and how to refine these together."""
    place = recordings.place
    inside = [one for one in kinds if kinds[one] == RECORDING]

    @ui.refreshable
    def rows() -> None:
        for one in place.folders(folder):
            to = parts.address("/recording" if one in inside else "/", at=place.relative(one))
            with ui.element("div").classes("s-folder"):
                ui.link(one.name, to)
                results = "has results" if is_run(one / output_of(one)) else ""
                for badge in filter(None, (kinds.get(one), results)):
                    ui.label(badge).classes("s-badge")

    with parts.section("Choose the folder of a recording"):
        ui.label(_WHAT).classes("s-dim")
        here = parts.address("/recording", at=place.relative(folder))
        parts.button("Use this folder", lambda: ui.navigate.to(here), first=not inside).classes("self-start")
        path = ui.input("Path of the folder", value=str(folder)).props("outlined dense").classes("w-full")
        path.on("keydown.enter", lambda: ui.navigate.to(parts.address("/", at=path.value or "")))
        with ui.element("div").classes("s-folders"):
            rows()
    if len(inside) > 1:
        with parts.section("Several recordings at once"):
            _Together(recordings, folder, inside, rows.refresh).show()


@dataclass(eq=False)
class _Together:
    """How several recordings in a folder are refined together."""

    recordings: Recordings
    folder: Path
    inside: Sequence[Path]
    ended: Callable[[], object]
    problem: str = ""

    def show(self) -> None:
        """Show which, their settings, and what is being done."""
        ui.label(_TOGETHER).classes("s-dim")
        with ui.element("div").classes("s-row"):
            self.boxes = [ui.checkbox(one.name, value=True) for one in self.inside]
        self.given = self.recordings.given.setdefault(self.folder, {})
        self.settings()
        self.action()

    @ui.refreshable_method
    def settings(self) -> None:
        """Show the settings."""
        with ui.expansion("Settings").classes("w-full"):
            form = Form({"refine": self.given}, lambda *_: self.action.refresh())
            form.main(["refine"])
            form.more(["refine"])

    async def _choose(self, setting: str, value: str) -> None:
        put(self.given, setting, value)
        self.settings.refresh()
        await self._start()

    async def _start(self) -> None:
        chosen = [one for one, box in zip(self.inside, self.boxes, strict=True) if box.value]
        self.problem = await parts.attempt(self.recordings.batch, self.folder, chosen)
        self.action.refresh()

    def _rows(self, one: Mapping[str, Any]) -> Iterator[list[object]]:
        link = parts.address("/recording", at=self.recordings.place.relative(self.folder / one["name"]))
        told = " ".join(worded(each["text"]) for each in one["findings"] if each["severity"] != "note")
        for row in one["rows"]:
            yield [(one["name"], link), row["status"], row["frames"], row["warnings"], told, row["error"]]

    def _ended(self) -> None:
        self.action.refresh()
        self.ended()

    @ui.refreshable_method
    def action(self) -> None:
        """Show what is being done, or became of the recordings, and the button that begins."""
        if self.problem:
            parts.note("error", self.problem)
        if (lack := self.recordings.lacks.get(self.folder)) is not None:
            with parts.note("lack", lack.text), ui.element("div").classes("s-row"):
                parts.choices(lack, self._choose)
        work = self.recordings.batches.get(self.folder)
        if work is not None:
            parts.progress(work, self._ended)
            if work.state == DONE:
                rows = [row for one in work.document["recordings"] for row in self._rows(one)]
                parts.table(("Recording", "Status", "Frames", "Warnings", "Findings", "Error"), rows)
        start = parts.button("Refine the chosen recordings", self._start, first=True).classes("self-start")
        start.set_enabled((work is None or work.state != RUNNING) and not are_wrong("refine", self.given))
