"""The page of a recording: what was found and what is missing, settings, result, files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from importlib.util import find_spec
from typing import Any

from nicegui import ui

from skelsplat._optional import pip_words
from skelsplat.app import parts
from skelsplat.app.forms import Form
from skelsplat.app.look import ResultParts
from skelsplat.app.recording import Recording
from skelsplat.cli.of_found import PAGE_OF_CAMERAS, lines_of
from skelsplat.cli.process import Work
from skelsplat.cli.settings import OPTIONS, are_wrong
from skelsplat.run.found import Lack

_EVERY_S = 0.3
_DROP = (
    "<div class='s-drop' data-folder=\"{}\">Drop videos, keypoints or a calibration here, or "
    "<label><input type=file multiple><span>choose files</span></label> or "
    "<label><input type=file webkitdirectory><span>a folder</span></label>."
    "<div role=status class='s-small'></div></div>"
)
# By command: what its button says, the packages of which it needs one, and the extra that adds one.
_REMEDIES = {
    "detect": ("Find people in the videos", ("mediapipe", "rtmlib"), "rtmlib"),
    "calibrate": ("Find the cameras from the people", ("cv2",), "video"),
}
_INSTALL = "A package is missing for this. The command downloads it into the Python that runs this page:"
# Settings on which it depends what is found.
_READ_WITH = {row.name for row in OPTIONS["refine"] if row.panel in ("Calibration", "Input")} | {"fps"}


class RecordingPage:
    """The page of one recording in one tab."""

    def __init__(self, recording: Recording) -> None:
        self.recording, self.seen = recording, recording.version
        self.given = dict(recording.given["refine"])  # as the form shows it
        self.shown = False  # whether there is a form
        self.problem = ""  # of what was pressed last
        self.result = ResultParts(recording, self.press)

    def show(self) -> None:
        """Show everything, and keep it as it is."""
        self.bring()
        with ui.element("div").classes("s-part"):
            self.settings()
            with ui.element("div").classes("s-do"):
                self.action()
        with ui.element("section").classes("s-part").props('aria-label="3 · Result"'):
            self.result.look()
            self.result.pictures()
        self.result.take()
        self.words()
        self.pictured = self.result.pictured
        ui.on("brought", lambda: self.press(self.recording.look))
        ui.timer(_EVERY_S, lambda: self.refresh(self.recording.version != self.seen))

    def refresh(self, changed: bool = True) -> None:
        """Show everything anew; the form only if others changed it, since it has the keyboard."""
        if not changed:
            return
        self.seen = self.recording.version
        shown: list[Any] = [self.bring, self.action, self.result.look, self.result.take, self.words]
        if self.pictured != self.result.pictured:  # else the report and the videos stay as they are
            self.pictured = self.result.pictured
            shown.append(self.result.pictures)
        if self.given != self.recording.given["refine"] or self.shown == self.recording.found.empty:
            shown.insert(1, self.settings)
        for one in shown:
            one.refresh()

    async def press(self, action: Callable[..., Any], *given: Any) -> None:
        """Do what a button is for; what is wrong is shown above the button that starts."""
        self.problem = await parts.attempt(action, *given)
        self.refresh()

    async def changed(self, command: str, name: str) -> None:
        """Take over a setting that the form has changed."""
        self.given = dict(self.recording.given["refine"])
        if name in _READ_WITH and not are_wrong(command, self.recording.given[command]):
            await self.press(self.recording.look)
        else:
            self.action.refresh()
            self.words.refresh()

    @ui.refreshable_method
    def bring(self) -> None:
        """Show what was found, what is missing and what helps, and where files can be dropped."""
        found, folder = self.recording.found, self.recording.place.relative(self.recording.folder)
        with parts.section("1 · Recording"):
            if not found.empty:
                parts.facts(found.facts)
                page = (PAGE_OF_CAMERAS, parts.address(f"/run/{PAGE_OF_CAMERAS}", folder=folder))
                made = (found.folder / PAGE_OF_CAMERAS).is_file()
                parts.table((), [*found.files.items(), *[("How the cameras were found", page)] * made])
                with ui.expansion("Each camera").classes("w-full"):
                    rows = [(one.name, one.frames, one.fps, one.image, one.people) for one in found.cameras]
                    parts.table(("Camera", "Frames", "Per second", "Image", "People"), rows)
            choose = partial(self.press, self.recording.choose)
            for name, values in (("calibration", found.calibrations), ("detections", found.keypoints)):
                if len(values) > 1:
                    chosen = ui.select([*values], value=getattr(found, name), label=name.capitalize())
                    chosen.on_value_change(lambda event, name=name: choose(name, event.value))
                    chosen.props("outlined dense").classes("w-full")
            for lack in found.asked:
                self._lack(lack)
            if found.inside:
                to = parts.address("/", at=folder)
                with parts.note("lack", f"The recordings are in folders inside: {', '.join(found.inside)}."):
                    parts.button("Show them", lambda: ui.navigate.to(to), first=True)
            parts.html(_DROP.format(escape(folder, quote=True)))

    def _lack(self, lack: Lack) -> None:
        words, needed, extra = _REMEDIES.get(lack.command, ("", (), ""))
        press = partial(self.press, self.recording.start, lack.command)
        with parts.note("note" if lack.optional else "lack", lack.text):
            if needed and not any(map(find_spec, needed)):
                words, press = f"Install {extra}", partial(self.press, self.recording.install, extra)
                ui.label(_INSTALL).classes("s-dim")
                parts.code(Work(pip_words(extra), self.recording.folder).command, "the command")
            with ui.element("div").classes("s-row"):
                if words:
                    parts.button(words, press, first=True, enabled=not self.recording.running)
                parts.choices(lack, partial(self.press, self.recording.choose))

    @ui.refreshable_method
    def settings(self) -> None:
        """Show the settings."""
        found = self.recording.found
        self.given, self.shown = dict(self.recording.given["refine"]), not found.empty
        if not found.empty:
            stages = {"refine": True, "calibrate": found.detections, "detect": found.videos}
            commands = [command for command, needed in stages.items() if needed]
            parts.html("<h2>2 · Pose in 3D</h2>")
            form = Form(self.recording.given, self.changed, found.names)
            form.main(commands)
            form.more([*commands, "overlay"])

    @ui.refreshable_method
    def action(self) -> None:
        """Show what is being done, what was wrong, and the button that starts."""
        recording, found = self.recording, self.recording.found
        if self.problem:
            parts.note("error", self.problem)
        if recording.work is not None:
            parts.progress(recording.work, self.refresh)
        if recording.running or found.empty:
            return
        with ui.element("div").classes("s-row"):
            again = " again" if recording.result is not None else ""
            first = "" if found.ready else "First, what is missing above."
            if are_wrong("refine", recording.given["refine"]):
                first = "First, the setting that is marked."
            start = partial(self.press, recording.start, "refine")
            parts.button(f"Find the pose{again}", start, first=True, enabled=not first)
            ui.label(first).classes("s-dim s-small")

    @ui.refreshable_method
    def words(self) -> None:
        """Show what does the same without the page."""
        recording = self.recording
        if lines := lines_of(recording.found, recording.given, recording.done):
            with parts.section("Without this page"):
                ui.label("What was done, and what the button does, in commands and Python:").classes("s-dim")
                for name, text in lines.items():
                    parts.code(text, name)
