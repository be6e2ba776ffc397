"""All recordings that the page has open, by folder, and batches of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skelsplat._atomic import atomic_write_text
from skelsplat.app.places import Place
from skelsplat.app.recording import Recording
from skelsplat.cli.batch import sessions_of
from skelsplat.cli.process import RUNNING, Work
from skelsplat.cli.settings import reading_of
from skelsplat.exceptions import InvalidInputError
from skelsplat.run.found import Lack, lack_of_several, look

SESSIONS, RESULTS = "skelsplat-sessions.toml", "batch"


@dataclass
class Recordings:
    """The recordings in a place."""

    place: Place
    open: dict[Path, Recording] = field(default_factory=dict)
    batches: dict[Path, Work] = field(default_factory=dict)
    lacks: dict[Path, Lack | None] = field(default_factory=dict)  # by folder, of a recording in it
    given: dict[Path, dict[str, Any]] = field(default_factory=dict)  # by folder, settings for all in it

    def at(self, folder: Path) -> Recording:
        """Return the recording of a folder, the same for all who ask."""
        recording = self.open.setdefault(folder, Recording(self.place, folder))
        with recording.looking:
            return recording if recording.version else recording.look()

    def batch(self, folder: Path, chosen: Sequence[Path]) -> None:
        """Refine recordings in a folder, each into a folder of its own, unless one lacks something."""
        if folder in self.batches and self.batches[folder].state == RUNNING:
            raise InvalidInputError("batch: expected one at a time, got a second one")
        given = self.given.get(folder, {})
        found = [look(one, reading_of({"refine": given}), self.place.root) for one in chosen]
        offered, lack = self.lacks.get(folder), lack_of_several(found)
        self.lacks[folder] = lack
        if lack is not None and (not lack.optional or lack != offered):  # the next try is without it
            return
        file, _ = self.place.inside(SESSIONS, folder), self.place.inside(RESULTS, folder)
        atomic_write_text(file, sessions_of(folder, found, given))
        work = Work(["batch", SESSIONS, "-o", RESULTS], folder, lambda _: self._look(chosen))
        self.batches[folder] = work.start()

    def _look(self, folders: Sequence[Path]) -> None:
        for one in (self.open[folder] for folder in folders if folder in self.open):
            one.look()

    def cancel(self) -> None:
        """Cancel everything, and wait for its end."""
        works = [*self.batches.values(), *(one.work for one in self.open.values() if one.work is not None)]
        for each in (Work.cancel, Work.wait):
            for work in works:
                each(work)
