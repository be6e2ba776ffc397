"""The result on the page of a recording: numbers, findings with what helps, the report, the videos."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nicegui import ui

from skelsplat.app.forms import Form, name_of
from skelsplat.app.parts import button, facts, html, note, part, table
from skelsplat.app.recording import OPTIONS
from skelsplat.cli.rows import Option
from skelsplat.run.folder import PAGE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skelsplat.app.recording_page import RecordingPage
    from skelsplat.app.results import Result

_FEW = 4  # findings that are shown at once


def show_result(page: RecordingPage) -> None:
    """Show the result of a recording."""
    recording, result = page.recording, page.recording.result
    assert result is not None
    with ui.element("section").classes("s-card").props("aria-label=Result"):
        part("3  Result")
        if recording.before is not None and not recording.running:
            _compare(page, *recording.before[:2])
        facts(result.numbers)
        found = result.findings
        for of, one in found[:_FEW]:
            _finding(page, of, one)
        if len(found) > _FEW:
            with ui.expansion(f"{len(found) - _FEW} more notes").classes("w-full"), ui.element("div").classes("s-row"):
                for of, one in found[_FEW:]:
                    _finding(page, of, one)
        _pictures(page, result)


def _finding(page: RecordingPage, of: str, finding: Mapping[str, Any]) -> None:
    """Show a finding, and a button for each of its remedies."""
    with note(finding["severity"], of + finding["text"]):
        known = [(row, one["value"]) for one in finding["remedy"] if (row := _row(one["setting"])) is not None]
        if known:
            with ui.element("div").classes("s-row"):
                for row, value in known:
                    _remedy(page, row, value)


def _row(setting: str) -> Option | None:
    """Return the option of refine for a setting of a remedy."""
    flag = f"--{setting.replace('_', '-')}"
    return next((row for row in OPTIONS["refine"] if row.flag == flag), None)


def _remedy(page: RecordingPage, row: Option, value: Any) -> None:
    """Show a button that tries a remedy; where the user chooses the value, after asking for it."""
    run = page.recording

    def ask() -> None:
        chosen: dict[str, Any] = {}
        with ui.dialog(value=True) as dialog, ui.card():
            part(name_of(row))
            cameras = [] if run.found is None else [one.name for one in run.found.cameras]
            Form({}, lambda _, name, text: chosen.update({name: text}), cameras).field("refine", row)
            with ui.element("div").classes("s-row"):

                async def go() -> None:
                    dialog.close()
                    text = chosen.get(row.name) or ""
                    await page.press(run.try_remedy, row.flag[2:], text[0] if isinstance(text, list) else text)

                button("Try it", go, first=True)
                button("Close", dialog.close)

    words = name_of(row) if value in (None, True) else f"{name_of(row)} {value}"
    action = ask if value is None and row.kind is not bool else lambda: page.press(run.try_remedy, row.flag[2:], value)
    button(f"Try: {words}{' …' if action is ask else ''}", action).set_enabled(not run.running)


def _compare(page: RecordingPage, before: Result, what: str) -> None:
    """Show a remedy's result beside that before it, to be kept or taken back."""
    assert page.recording.result is not None
    now, rows = page.recording.result.compared, []
    for name, value in {**before.compared, **now}.items():
        rows.append((name, before.compared.get(name, "–"), now.get(name, "–")))
    part(f"With {what}: before and after", 3)
    table(("", "Before", "After"), rows)

    def keep() -> None:
        page.recording.before = None
        page.refresh()

    with ui.element("div").classes("s-row"):
        button("Keep it", keep, first=True)
        button("Go back", lambda: page.press(page.recording.go_back))


def _pictures(page: RecordingPage, result: Result) -> None:
    """Show the report, and the videos beside it."""
    videos, has_page = result.videos, (result.folder / PAGE).is_file()
    with ui.element("div").classes("s-look two" if videos and has_page else "s-look"):
        if has_page:
            frame = ui.element("iframe").props(f'title="Report with the pose in 3D" loading=lazy')
            frame.props(f'src="{page.address(PAGE, v=str(result.report["run"]))}"')
        if videos:
            _video(page, result, videos)
    with ui.element("div").classes("s-row"):
        if has_page:
            ui.link("Open the report alone", page.address(PAGE), new_tab=True)
        if not videos:
            words = "Draw it on the videos" if page.recording.found and page.recording.found.videos else (
                "Draw it as each camera sees it"
            )
            button(words, page.start("overlay")).set_enabled(not page.recording.running)


def _video(page: RecordingPage, result: Result, videos: list[str]) -> None:
    """Show a video, and which it is of."""
    made = result.report["input"]
    rate, first = made.get("frame_rate_hz") or "", made.get("first_frame", 0)
    with ui.element("div").classes("s-bar"):

        @ui.refreshable
        def shown(name: str) -> None:
            source = page.address(name, v=str(result.report["run"]))
            html(f"<video controls preload=metadata src='{source}' data-rate='{rate}' data-first='{first}'></video>")

        if len(videos) > 1:
            names = {name: name.removeprefix("overlay/").removesuffix(".mp4") for name in videos}
            ui.select(names, value=videos[0], label="Camera", on_change=lambda event: shown.refresh(event.value)).props(
                "outlined dense"
            )
        shown(videos[0])
        ui.label("The frame of the report is that at which the video is paused.").classes("s-help")
