"""The result on the page of a recording: numbers, findings with what helps, report, videos, files."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Any

from nicegui import ui

from skelsplat.app.forms import Form
from skelsplat.app.parts import address, button, facts, head, html, note, section, shown, table
from skelsplat.app.recording import Recording
from skelsplat.cli.options import option_of
from skelsplat.cli.rows import Option
from skelsplat.cli.settings import required
from skelsplat.findings import Finding, Remedy
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.run.compared import AnyRun, compared, findings_of, numbers_of
from skelsplat.run.files import files_of, size_of
from skelsplat.run.folder import PAGE

_FEW = 4  # findings that are shown at once
_OUTDATED = "There are videos of an earlier result, which are not shown. Draw them again to see this one."
_PAUSED = "Where the video is paused, the report shows the same frame."


@dataclass(eq=False)
class ResultParts:
    """What is to be looked at, and to be taken away."""

    recording: Recording
    press: Callable[..., Awaitable[None]]

    def address(self, name: str, **more: str) -> str:
        """Return the address of a file of the run."""
        return address(f"/run/{name}", folder=self.recording.place.relative(self.recording.output), **more)

    @property
    def pictured(self) -> object:
        """What tells whether there are other pictures."""
        result = self.recording.result
        return result and (result.report["run"], self.recording.drawn)

    @ui.refreshable_method
    def look(self) -> None:
        """Show the numbers and findings."""
        result = self.recording.result
        if result is None:
            return
        html("<h2>3 · Result</h2>")
        if self.recording.before is not None and not self.recording.running:
            self._compare(result, *self.recording.before[:2])
        facts(numbers_of(result))
        found = findings_of(result)
        for of, one in found[:_FEW]:
            self._finding(of, one)
        if len(found) > _FEW:
            with ui.expansion(f"{len(found) - _FEW} more").classes("w-full s-more"):
                for of, one in found[_FEW:]:
                    self._finding(of, one)
        if not all(self.recording.drawn.values()):
            note("note", _OUTDATED)
        with ui.element("div").classes("s-row"):
            for name in (name for name, *_ in files_of(self.recording.output) if name.endswith(PAGE)):
                ui.link(f"Open {name} alone", self.address(name), new_tab=True)
            draw = "Draw it on the videos" if self.recording.found.videos else "Draw what each camera sees"
            free = not self.recording.running
            button(draw, lambda: self.press(self.recording.start, "overlay"), enabled=free)

    def _finding(self, of: str, finding: Finding) -> None:
        """Show a finding, and a button for each of its remedies."""
        with note(finding.severity, of + finding.text), ui.element("div").classes("s-row"):
            for remedy in finding.remedy:
                if (row := option_of(remedy)) is not None:
                    self._remedy(row, remedy)

    def _remedy(self, row: Option, remedy: Remedy) -> None:
        """Show a button that tries a remedy; after asking for what the user chooses, and what it requires."""
        recording, chosen = self.recording, dict[str, Any]()
        asked = [row] if remedy.value is None and row.kind is not bool else []
        asked += required(row, remedy.texts or row.kind is bool, recording.given["refine"])

        def ask() -> None:
            with ui.dialog(value=True) as dialog, ui.card().classes("s-ask"):
                form = Form({"refine": chosen}, lambda *_: None, recording.found.names)
                for one in asked:
                    form.field("refine", one)

                async def go() -> None:
                    dialog.close()
                    if all(one.name in chosen for one in asked):
                        value = chosen.pop(row.name, remedy.value)
                        await self.press(recording.try_remedy, row, replace(remedy, value=value), chosen)

                with ui.element("div").classes("s-row"):
                    button("Try it", go, first=True)
                    button("Close", dialog.close)

        words = f"Try: {row.title} {'…' if asked else ', '.join(remedy.texts)}".rstrip()
        action = ask if asked else lambda: self.press(recording.try_remedy, row, remedy)
        button(words, action, enabled=not recording.running)

    def _compare(self, result: AnyRun, before: AnyRun, what: str) -> None:
        """Show a remedy's result and that before it, to be kept or taken back."""
        head(f"{what}: before and after")
        table(("", "Before", "After"), compared(before, result))
        with ui.element("div").classes("s-row"):
            button("Keep it", lambda: self.press(setattr, self.recording, "before", None), first=True)
            button("Go back", lambda: self.press(self.recording.go_back))

    @ui.refreshable_method
    def pictures(self) -> None:
        """Show the report, and the videos beside it."""
        result = self.recording.result
        if result is None:
            return
        folder, version = self.recording.output, str(result.report["run"])
        videos = [name for name, now in self.recording.drawn.items() if now]
        has_page = (folder / PAGE).is_file()
        with ui.element("div").classes("s-look two" if videos and has_page else "s-look"):
            if has_page:
                source = shown(self.address(PAGE, v=version))
                html(f"<iframe tabindex=-1 title='Report with the pose in 3D' src='{source}'></iframe>")
            if videos:
                self._videos(result, videos)

    def _videos(self, result: AnyRun, names: list[str]) -> None:
        """Show a video with a choice of cameras; page.js switches it, and makes the report follow."""
        made, version = result.report["input"], str(result.report["run"])
        data = f"data-rate='{made.get('frame_rate_hz') or ''}' data-first='{made.get('first_frame', 0)}'"
        sources = {self.address(f"overlay/{name}.mp4", v=version): name for name in names}
        choices = (f"<option value='{shown(source)}'>{shown(name)}" for source, name in sources.items())
        with ui.element("div").classes("s-bar"):
            html(f"<select aria-label='Camera'>{''.join(choices)}</select>")
            html(f"<video controls preload=metadata src='{shown(next(iter(sources)))}' {data}></video>")
            ui.label(_PAUSED).classes("s-help")

    @ui.refreshable_method
    def take(self) -> None:
        """Show the files."""
        if self.recording.result is None:
            return
        folder, files = self.recording.output, files_of(self.recording.output)
        with section("4 · Files"):
            whole = address("/zip", folder=self.recording.place.relative(folder))
            button("Everything in one zip file", lambda: ui.navigate.to(whole), first=True)
            old = {f"overlay/{name}.mp4" for name, now in self.recording.drawn.items() if not now}
            links = (
                f"<a href='{shown(self.address(name, download='1'))}' download><b>{shown(name)}</b>"
                f"<span>{shown(about)}{', outdated' * (name in old)}</span><span>{size_of(size)}</span></a>"
                for name, about, size in files
            )
            html("".join(links)).classes("s-files")
            there = {name.partition("pose.")[2] for name, _, _ in files}
            others = [kind for kind in POSE_FORMATS if kind not in there]
            with ui.element("div").classes("s-row"):
                ui.label("Find the pose again, and also write" * bool(others)).classes("s-dim s-small")
                for kind in others:
                    button(kind, lambda kind=kind: self._also(kind)).set_enabled(not self.recording.running)

    async def _also(self, kind: str) -> None:
        given = self.recording.given["refine"]
        given["write"] = f"{given.get('write', 'csv,trc')},{kind}"
        await self.press(self.recording.start, "refine")
