"""How far a command is, on a page."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from skelsplat.app.parts import note, table
from skelsplat.app.work import CANCELLED, DONE, FAILED, Work

_DOING = {
    "detect": "Finding people in the videos",
    "calibrate": "Finding the cameras",
    "refine": "Finding the pose in 3D",
    "overlay": "Drawing on the videos",
    "batch": "Refining the recordings",
}
_EVERY_S = 0.25


def show_progress(work: Work, cancel: Callable[[], None], ended: Callable[[], object]) -> None:
    """Show a bar with the time left and a button that cancels; call ``ended`` once at the end."""
    if not work.running:
        if work.state == FAILED:
            note("error", work.error)
        if work.state == CANCELLED:
            note("note", "Cancelled. Files that were there are as they were; starting again goes on or begins anew.")
        if work.state == DONE and work.words[0] == "batch":
            _batch(work)
        return
    with ui.element("div").classes("s-bar").props('role=status aria-live=polite'):
        label = ui.label(_DOING.get(work.words[0], work.words[0]))
        bar = ui.linear_progress(value=0.0, show_value=False, size="8px").props("rounded indeterminate")
        bar.props(f'aria-label="{_DOING.get(work.words[0], "")}"')
        ui.button("Cancel", on_click=cancel).props("outline no-caps").classes("self-start")

    def tick() -> None:
        if not work.running:
            timer.deactivate()
            ended()
            return
        label.set_text(_words(work))
        share = None if work.bar is None else work.bar.share
        if share is not None:
            bar.props(remove="indeterminate").set_value(round(share, 3))

    timer = ui.timer(_EVERY_S, tick)


def _words(work: Work) -> str:
    """Return what is being done, how far it is, and the time left."""
    what, bar = _DOING.get(work.words[0], work.words[0]), work.bar
    if bar is None or not bar.total:
        return f"{what} …"
    name = f", {bar.name}" if work.words[0] in ("detect", "overlay") else ""
    unit = "recordings" if work.words[0] == "batch" else "frames"
    left = "" if bar.seconds_left is None else f", {_time(bar.seconds_left)} left"
    return f"{what}{name}: {bar.done or 0} of {bar.total} {unit}{left}"


def _time(seconds: float) -> str:
    """Return a time in words, as exact as it can be foreseen."""
    if seconds < 60:
        return f"about {max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"about {minutes} min" if minutes < 60 else f"about {minutes // 60} h {minutes % 60} min"


def _batch(work: Work) -> None:
    """Show what became of the recordings of a batch."""
    rows = [row for one in work.document.get("recordings", ()) for row in one["rows"]]
    texts = []
    for row in rows:
        error = "–" if row["median_error_px"] is None else f"{row['median_error_px']:.1f} px"
        told = row["error"] or row["findings"] or "nothing to note"
        texts.append((row["recording"], str(row["frames"] or "–"), error, told))
    table(("Recording", "Frames", "Error", "Found"), texts)
