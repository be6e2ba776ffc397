"""Settings on a page: each is an option of the command line, with the sentence of its help."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from typing import Any

from nicegui import ui

from skelsplat.app.parts import head
from skelsplat.cli.rows import Option
from skelsplat.cli.settings import OPTIONS, SHARED, from_field, help_of, put, wrong

_MAIN = {
    "refine": ("people", "person", "unit", "layout", "fps", "adjust_cameras", "write", "angles", "opensim"),
    "calibrate": ("stature",),
}
_NOT_MORE = {**_MAIN, "calibrate": (*_MAIN["calibrate"], *SHARED)}
_OF_CAMERAS = ("without", "move", "cameras")
_FREE = ("layout", "person", "people")  # choices among which another text can be typed


@dataclass
class Form:
    """Settings. ``given`` has the texts of those that are set, by command; ``changed`` follows a change."""

    given: Mapping[str, dict[str, Any]]
    changed: Callable[[str, str], object]
    cameras: Sequence[str] = ()
    marks: list[Callable[[], object]] = field(default_factory=list)  # each shows what is wrong with a field

    def main(self, commands: Sequence[str]) -> None:
        """Show the settings that matter, of some commands."""
        with ui.element("div").classes("s-fields"):
            for command in commands:
                for name in _MAIN.get(command, ()):
                    self.field(command, next(row for row in OPTIONS[command] if row.name == name))

    def more(self, commands: Sequence[str]) -> None:
        """Show all others, by command and part of its help; closed, which of them are set."""
        every = ((command, row) for command in commands for row in OPTIONS[command])
        left = [one for one in every if one[1].name not in _NOT_MORE.get(one[0], ())]
        given = [row.title for command, row in left if row.name in self.given.get(command, {})]
        said = f" (set: {', '.join(given)})" if given else ""
        with ui.expansion(f"More settings{said}").classes("w-full"):
            for (command, panel), rows in groupby(left, key=lambda one: (one[0], one[1].panel)):
                head(panel if command == "refine" else f"{command.capitalize()}: {panel.lower()}")
                with ui.element("div").classes("s-fields"):
                    for _, row in rows:
                        self.field(command, row)

    def field(self, command: str, row: Option) -> None:
        """Show a setting with its sentence, and what is wrong with it."""
        given, change = self.given[command], partial(self._change, command, row)
        with ui.element("div").classes("s-field").props(f'data-setting="{command}.{row.name}"'):
            if row.kind is bool:
                ui.checkbox(row.title, value=bool(given.get(row.name)), on_change=change)
                box, at = ui.label().props("role=alert").classes("s-wrong"), "text"
            else:
                box, at = self._box(row, given.get(row.name), change).without_auto_validation(), "error"
            ui.label(help_of(row)).classes("s-help")
        self.marks.append(lambda: setattr(box, at, wrong(command, row, given.get(row.name), given) or None))
        self.marks[-1]()

    def _box(self, row: Option, value: Any, change: Callable[[Any], object]) -> Any:
        """Show the field of a setting that is no switch."""
        choices = self.cameras if row.name in _OF_CAMERAS else row.choices
        several = row.many or row.name == "write"
        if several and choices:
            value = value or row.default or []
            texts = value.split(",") if isinstance(value, str) else value
            every = [*dict.fromkeys([*choices, *texts])]
            made: Any = ui.select(every, value=[*texts], label=row.title, multiple=True, on_change=change)
            return made.props("outlined dense use-chips stack-label")
        if choices and row.name not in _FREE:
            named = {"": row.usual or "not set", **{text: text for text in (*choices, value) if text}}
            made = ui.select(named, value=value or "", label=row.title, on_change=change)
            return made.props("outlined dense stack-label options-dense")
        text, hint = ", ".join(value or []) if several else value or "", row.usual or row.metavar
        made = ui.input(row.title, value=text, placeholder=hint, on_change=change, autocomplete=[*choices])
        return made.props("outlined dense stack-label hide-bottom-space debounce=300")

    def _change(self, command: str, row: Option, event: Any) -> object:
        put(self.given[command], row.name, from_field(row, event.value))
        for mark in self.marks:  # it may be what another one requires
            mark()
        return self.changed(command, row.name)
