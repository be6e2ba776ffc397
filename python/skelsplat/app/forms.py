"""Settings on a page: each is an option of the command line, with the sentence of its help."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any

from nicegui import ui

from skelsplat.app.parts import head
from skelsplat.cli.rows import Option
from skelsplat.cli.settings import OPTIONS, SHARED, from_field, help_of, wrong

_MAIN = {
    "refine": ("people", "person", "unit", "layout", "fps", "adjust_cameras", "write", "angles", "opensim"),
    "calibrate": ("stature",),
}
_NOT_MORE = {**_MAIN, "calibrate": (*_MAIN["calibrate"], *SHARED)}
_OF_CAMERAS = ("without", "move", "cameras")
_FREE = ("layout", "person", "people")  # choices among which another text can be typed


@dataclass
class Form:
    """Settings; ``given`` has by command the texts of those that were set, ``change`` takes what changes."""

    given: Mapping[str, Mapping[str, Any]]
    change: Callable[[str, str, Any], object]
    cameras: Sequence[str] = ()

    def main(self, commands: Sequence[str]) -> None:
        """Show the settings that matter, of some commands."""
        with ui.element("div").classes("s-fields"):
            for command in commands:
                for name in _MAIN.get(command, ()):
                    self.field(command, next(row for row in OPTIONS[command] if row.name == name))

    def more(self, commands: Sequence[str]) -> None:
        """Show all others, by command and part of its help; closed, which of them are set."""
        every = [(command, row) for command in commands for row in OPTIONS[command]]
        left = [(command, row) for command, row in every if row.name not in _NOT_MORE.get(command, ())]
        given = [row.title for command, row in left if row.name in self.given.get(command, {})]
        said = f" (set: {', '.join(given)})" if given else ""
        with ui.expansion(f"More settings{said}").classes("w-full"):
            for (command, panel), rows in groupby(left, key=lambda one: (one[0], one[1].panel)):
                head(panel if command == "refine" else f"{command.capitalize()}: {panel.lower()}")
                with ui.element("div").classes("s-fields"):
                    for _, row in rows:
                        self.field(command, row)

    def field(self, command: str, row: Option) -> None:
        """Show a setting with its sentence."""
        given, change = self.given.get(command, {}), partial(self._changed, command, row)
        value = given.get(row.name)
        choices = self.cameras if row.name in _OF_CAMERAS else row.choices
        several = row.many or row.name == "write"
        with ui.element("div").classes("s-field").props(f'data-setting="{command}.{row.name}"'):
            if row.kind is bool:
                ui.checkbox(row.title, value=bool(value), on_change=change)
            elif several and choices:
                value = value or row.default or []
                texts = value.split(",") if isinstance(value, str) else value
                every = [*dict.fromkeys([*choices, *texts])]
                field = ui.select(every, value=[*texts], label=row.title, multiple=True, on_change=change)
                field.props("outlined dense use-chips stack-label")
            elif choices and row.name not in _FREE:
                named = {"": row.usual or "not set", **{text: text for text in (*choices, value) if text}}
                field = ui.select(named, value=value or "", label=row.title, on_change=change)
                field.props("outlined dense stack-label options-dense")
            else:
                text = ", ".join(value or []) if several else value or ""
                hint, own = row.usual or row.metavar, [*choices]
                made = ui.input(row.title, value=text, placeholder=hint, on_change=change, autocomplete=own)
                made.props("outlined dense stack-label hide-bottom-space debounce=300")
                made.validation = lambda text: wrong(command, row, from_field(row, text), given) or None
                made.validate()
            ui.label(help_of(row)).classes("s-help")

    def _changed(self, command: str, row: Option, event: Any) -> object:
        return self.change(command, row.name, from_field(row, event.value))
