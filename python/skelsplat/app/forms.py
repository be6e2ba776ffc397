"""Settings on a page: each is an option of the command line, with the sentence of its help."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import Any

from nicegui import ui

import skelsplat as sk
from skelsplat.app.parts import part
from skelsplat.app.recording import OPTIONS, SHARED
from skelsplat.cli.rows import Option
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.run.job import FRAME_MODES

Set = Callable[[str, str, Any], None]
"""Is called with a command, the name of one of its options, and the text, or nothing."""
_MAIN = {
    "refine": ("people", "person", "unit", "layout", "fps", "adjust_cameras", "write", "angles", "opensim"),
    "calibrate": ("stature",),
}
_NAMES = {"fps": "Frames per second", "write": "Files to write", "opensim": "OpenSim", "people": "How many people"}
_SHOWN = {"mm": "mm", "cm": "cm", "m": "m"}


def name_of(row: Option) -> str:
    """Return what a setting is called: its option in words."""
    words = row.flag.lstrip("-").replace("-", " ")
    return _NAMES.get(row.name, words[:1].upper() + words[1:])


class Form:
    """The settings of a recording; ``given`` has by command the texts of those that were set."""

    def __init__(
        self, given: Mapping[str, Mapping[str, Any]], change: Set, cameras: Sequence[str] = ()
    ) -> None:
        self.given, self.change, self.cameras = given, change, cameras

    def main(self, commands: Sequence[str]) -> None:
        """Show the settings that matter, of some commands."""
        with ui.element("div").classes("s-fields"):
            for command in commands:
                rows = {row.name: row for row in OPTIONS[command]}
                for name in _MAIN.get(command, ()):
                    self.field(command, rows[name])

    def more(self, commands: Sequence[str]) -> None:
        """Show all others, by command and part of its help."""
        with ui.expansion("More settings").classes("w-full").props('header-class="s-dim"'):
            for command in commands:
                left = [row for row in OPTIONS[command] if self._is_more(command, row)]
                for panel, rows in groupby(left, key=lambda row: row.panel):
                    part(panel if command == "refine" else f"{command.capitalize()}: {panel.lower()}", 3)
                    with ui.element("div").classes("s-fields"):
                        for row in rows:
                            self.field(command, row)

    def _is_more(self, command: str, row: Option) -> bool:
        shared = command == "calibrate" and row.name in SHARED
        return row.name not in _MAIN.get(command, ()) and not shared

    def field(self, command: str, row: Option) -> None:
        """Show a setting with its sentence."""
        value, change = self.given.get(command, {}).get(row.name), partial(self._changed, command, row)
        with ui.element("div").classes("s-field").props(f'data-setting="{command}.{row.name}"'):
            choices = self._choices(row)
            if row.kind is bool:
                ui.checkbox(name_of(row), value=bool(value), on_change=change)
            elif row.name in ("write", "without") and choices:
                texts = value.split(",") if isinstance(value, str) else list(value or ())
                kept = [text for text in texts if text in choices]
                ui.select(choices, value=kept, label=name_of(row), multiple=True, on_change=change).props(
                    "outlined dense use-chips stack-label"
                )
            elif choices:
                self._select(row, choices, value, change)
            else:
                text = ", ".join(value) if isinstance(value, list) else value or ""
                field = ui.input(name_of(row), value=text, placeholder=_usual(row) or row.metavar, on_change=change)
                field.props("outlined dense stack-label debounce=300")
            ui.label(row.help).classes("s-help")

    def _select(self, row: Option, choices: list[str], value: Any, change: Callable[[Any], None]) -> None:
        free = {"layout": True, "person": True, "people": True}.get(row.name, False)
        shown = {"": _usual(row) or "not set", **{text: text for text in choices}}
        if value and value not in shown:
            shown[value] = value
        field = ui.select(
            shown, value=value or "", label=name_of(row), on_change=change,
            with_input=free, new_value_mode="add-unique" if free else None,
        )  # fmt: skip
        field.props("outlined dense stack-label options-dense")

    def _choices(self, row: Option) -> list[str]:
        """Return the values of an option, if they are few."""
        known = {
            "layout": list(sk.layouts.names),
            "frames": list(FRAME_MODES),
            "person": ["consistent", "largest", "moves-most", "0", "1", "2"],
            "people": ["all", "2", "3", "4"],
            "write": [kind for kind in POSE_FORMATS if kind != "npz"],
            "without": list(self.cameras),
        }
        if row.name in known:
            return known[row.name]
        parts = row.metavar.split("|")
        return parts if len(parts) > 1 and all(one.replace("-", "").isalnum() for one in parts) else []

    def _changed(self, command: str, row: Option, event: Any) -> None:
        value = event.value
        if row.name == "write":
            value = ",".join(value or ())
        elif row.many and isinstance(value, str):
            value = [text.strip() for text in value.split(",") if text.strip()]
        elif isinstance(value, str):
            value = value.strip()
        self.change(command, row.name, value)


def _usual(row: Option) -> str:
    """Return the default in words."""
    return row.shown or ("" if row.default in (None, False) or row.kind is bool else str(row.default))
