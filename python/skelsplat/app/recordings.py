"""All recordings that the page has open, by folder, and batches of several."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from skelsplat._atomic import atomic_write_text
from skelsplat.app.found import Found, holds_recording, look, output_of
from skelsplat.app.places import Place
from skelsplat.app.recording import OPTIONS, Recording
from skelsplat.app.work import Work
from skelsplat.exceptions import InvalidInputError

SESSIONS, RESULTS = "skelsplat-sessions.toml", "batch"
_MOST = 200


class Recordings:
    """The recordings in a place."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.open: dict[Path, Recording] = {}
        self.batches: dict[Path, Work] = {}
        self.given: dict[Path, dict[str, Any]] = {}  # by folder, the settings of refine for all in it

    def at(self, folder: Path) -> Recording:
        """Return the recording of a folder, the same for all who ask."""
        if folder not in self.open:
            self.open[folder] = Recording(self.place, folder).look()
        return self.open[folder]

    def inside(self, folder: Path) -> list[Path]:
        """Return the folders in a folder that hold recordings."""
        return [one for one in self.place.folders(folder)[:_MOST] if holds_recording(one)]

    def batch(self, folder: Path, chosen: Sequence[Path]) -> Work:
        """Refine several recordings in a folder, each into a folder of its own."""
        running = self.batches.get(folder)
        if running is not None and running.running:
            raise InvalidInputError("folder: expected one batch at a time, got another that runs")
        given = self.given.get(folder, {})
        found = [look(one, given) for one in chosen]
        if not found:
            raise InvalidInputError("recordings: expected at least one, got none")
        for one in found:
            if not one.ready:
                lacks = [lack.text for lack in one.lacks] or ["it holds no recording"]
                raise InvalidInputError(f"{one.folder.name}: {lacks[0]}")
        file = self.place.inside(SESSIONS, folder)
        atomic_write_text(file, _sessions(folder, found, given))
        work = Work(["batch", SESSIONS, "-o", RESULTS], folder, lambda _: self._look(chosen))
        self.batches[folder] = work.start()
        return work

    def _look(self, folders: Sequence[Path]) -> None:
        for folder in folders:
            if folder in self.open:
                self.open[folder].look()

    def cancel(self) -> None:
        """Cancel everything, and wait for its end."""
        works = [*self.batches.values(), *(one.work for one in self.open.values() if one.work is not None)]
        for one in self.open.values():
            one.queue.clear()
        for work in works:
            work.cancel()
        for work in works:
            work.wait()


def _sessions(folder: Path, found: Sequence[Found], given: Mapping[str, Any]) -> str:
    """Return the file of a batch: what all recordings share, and the files of each."""
    lines = ["[defaults]", *(f"{_key(name)} = {_toml(value)}" for name, value in given.items())]
    for one in found:
        name = one.folder.relative_to(folder).as_posix()
        paths = {"calibration": one.calibration, "detections": one.detections, "output": output_of(one.folder)}
        lines += ["", "[[session]]", f"name = {_toml(name)}"]
        lines += [f"{key} = {_toml(f'{name}/{path}')}" for key, path in paths.items()]
    return "\n".join([*lines, ""])


def _key(name: str) -> str:
    """Return an option's name in the file, from that of its parameter."""
    row = next(row for row in OPTIONS["refine"] if row.name == name)
    return row.flag.lstrip("-")


def _toml(value: Any) -> str:
    """Return a flag, a text or texts in TOML; its strings are those of JSON."""
    return json.dumps(value, ensure_ascii=False)
