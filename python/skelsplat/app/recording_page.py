"""The page of a recording: bring, do, look, take."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any
from urllib.parse import quote

from nicegui import run, ui

from skelsplat._optional import pip_line
from skelsplat.app.found import Found, Lack, output_of
from skelsplat.app.forms import Form
from skelsplat.app.look import show_result
from skelsplat.app.parts import button, facts, html, note, part, table
from skelsplat.app.progress import show_progress
from skelsplat.app.recording import Recording
from skelsplat.app.take import show_files
from skelsplat.exceptions import SkelSplatError

_EVERY_S = 0.3
_ACCEPTED = "Drop videos, keypoints or a calibration here"


class RecordingPage:
    """The page of one recording in one tab."""

    def __init__(self, recording: Recording) -> None:
        self.recording, self.seen = recording, recording.version
        self.problem = ""  # of what was pressed last

    def show(self) -> None:
        """Show everything, and keep it as it is."""
        folder = self.recording.folder
        with ui.element("main").classes("s-main"):
            html(f"<h1 class='s-title'>{escape(folder.name or str(folder))}</h1>")
            for show in (self.bring, self.do, self.look, self.take):
                show()
        ui.on("brought", lambda: self.press(self.recording.look))
        ui.timer(_EVERY_S, self._tick)

    def _tick(self) -> None:
        if self.recording.version != self.seen:
            self.refresh()

    def refresh(self) -> None:
        """Show everything anew."""
        self.seen = self.recording.version
        for show in (self.bring, self.do, self.look, self.take):
            show.refresh()

    async def press(self, action: Callable[..., Any], *given: Any) -> None:
        """Do what a button is for; what is wrong is shown above the buttons."""
        self.problem = ""
        try:
            await run.io_bound(action, *given)
        except (SkelSplatError, OSError) as error:
            self.problem = str(error)
        self.refresh()

    def set(self, command: str, name: str, value: Any) -> None:
        """Take over a setting; what was found depends on some."""
        self.recording.set(command, name, value)
        if name in ("unit", "layout", "fps", "calibration", "detections"):
            ui.timer(0.0, lambda: self.press(self.recording.look), once=True)
        else:
            self.take.refresh()

    def choose(self, setting: str, value: str) -> Callable[[], None]:
        """Return what sets a setting of refine."""
        return lambda: self.set("refine", setting, value)

    def start(self, *commands: str) -> Callable[[], Any]:
        """Return what starts commands."""
        return lambda: self.press(self.recording.start, *commands)

    @ui.refreshable_method
    def bring(self) -> None:
        """Show what was found, what is missing and what helps, and where files can be dropped."""
        recording, found = self.recording, self.recording.found
        assert found is not None
        with ui.element("section").classes("s-card").props("aria-label=Recording"):
            part("1  Recording")
            if not found.empty:
                facts(_facts(found, self.recording.given["refine"]))
                if found.cameras:
                    with ui.expansion("Cameras", value=False).classes("w-full"):
                        table(("Camera", "Frames", "Per second", "Size", "People"), [_row(one) for one in found.cameras])
                self._alternatives(found)
            for lack in found.lacks:
                self._lack(lack)
            folder = escape(recording.place.relative(recording.folder), quote=True)
            html(
                f"<div class='s-drop' data-folder=\"{folder}\">{_ACCEPTED}, or "
                "<label><input type=file multiple><span>choose files</span></label> · "
                "<label><input type=file webkitdirectory><span>choose a folder</span></label>"
                "<div role=status class='s-small'></div></div>"
            )

    def _alternatives(self, found: Found) -> None:
        """Let choose where several files may be meant."""
        for name, several, one in (
            ("calibration", found.calibrations, found.calibration),
            ("detections", found.keypoints, found.detections),
        ):
            if len(several) > 1:
                ui.select(
                    list(several), value=one, label=name.capitalize(),
                    on_change=lambda event, name=name: self.set("refine", name, event.value),
                ).props("outlined dense").classes("w-full")  # fmt: skip

    def _lack(self, lack: Lack) -> None:
        with note("lack" if not lack.optional else "note", lack.text), ui.element("div").classes("s-row"):
            if lack.command and (needs := _needs(lack.command)):
                ui.label(f"This needs a package more: {needs}").classes("s-help")
            elif lack.command:
                words = {"detect": "Find people in the videos", "calibrate": "Find the cameras from the people"}
                button(words[lack.command], self.start(lack.command), first=True).set_enabled(
                    not self.recording.running
                )
            for value, words in lack.values.items():
                button(words, self.choose(lack.setting, value))

    @ui.refreshable_method
    def do(self) -> None:
        """Show the settings, and what is being done."""
        recording, found = self.recording, self.recording.found
        assert found is not None
        if found.empty:
            return
        commands = ["refine", *(["calibrate"] if found.detections else []), *(["detect"] if found.videos else [])]
        with ui.element("section").classes("s-card").props("aria-label=Settings"):
            part("2  Pose in 3D")
            form = Form(recording.given, self.set, [one.name for one in found.cameras])
            form.main(commands)
            form.more([*commands, "overlay"])
            if self.problem:
                note("error", self.problem)
            if recording.work is not None:
                show_progress(recording.work, recording.cancel, self.refresh)
            if recording.running:
                return
            again = "again" if recording.result is not None else "now"
            with ui.element("div").classes("s-row"):
                button(f"Find the pose {again}", self.start("refine"), first=True).set_enabled(found.ready)
                if not found.ready:
                    ui.label("First, what is missing above.").classes("s-dim s-small")

    @ui.refreshable_method
    def look(self) -> None:
        """Show the result."""
        if self.recording.result is not None:
            show_result(self)

    @ui.refreshable_method
    def take(self) -> None:
        """Show the files, and the commands."""
        if self.recording.found is not None and not self.recording.found.empty:
            show_files(self)

    def address(self, name: str, **more: str) -> str:
        """Return the address of a file of the run."""
        recording = self.recording
        folder = recording.place.relative((recording.folder / output_of(recording.folder)).resolve())
        query = "".join(f"&{key}={value}" for key, value in more.items())
        return f"/run/{quote(name)}?folder={quote(folder)}{query}"


def _facts(found: Found, given: dict[str, Any]) -> dict[str, str]:
    """Return what was found in a few words."""
    frames = [one.frames for one in found.cameras if one.frames]
    people = [one.people for one in found.cameras if one.people is not None]
    span = f"{min(frames)} to {max(frames)}" if frames and min(frames) != max(frames) else str(*frames[:1])
    rate = given.get("fps") or (f"{found.rate:g}" if found.rate else "")
    named = {
        "cameras": str(len(found.cameras) or "–"),
        "frames": span or "–",
        "frames per second": rate or "unknown",
        "people at once, at most": str(max(people)) if people else "–",
        "joints": found.layout or "–",
        "unit of the calibration": found.unit or "–",
        "calibration": found.calibration or "none",
        "keypoints": found.detections.replace(".", "this folder") if found.detections == "." else found.detections or "none",
        "videos": "this folder" if found.videos == "." else found.videos or "none",
    }
    return named


def _row(one: Any) -> tuple[str, ...]:
    size = "–" if one.size is None else f"{one.size[0]}×{one.size[1]}"
    rate = "–" if one.fps is None else f"{one.fps:.6g}"
    return one.name, str(one.frames or "–"), rate, size, "–" if one.people is None else str(one.people)


def _needs(command: str) -> str:
    """Return the command that installs what another needs, if it is missing."""
    from importlib.util import find_spec

    needed = {"detect": ("mediapipe", "rtmlib"), "calibrate": ("cv2",)}[command]
    extra = {"detect": "mediapipe", "calibrate": "video"}[command]
    return "" if any(find_spec(name) is not None for name in needed) else pip_line(extra)
