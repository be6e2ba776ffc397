"""A recording on the page: what was found, its settings, the commands that they make, and what is done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import invalidate_caches
from pathlib import Path
from threading import Lock
from typing import Any

from skelsplat._optional import pip_words
from skelsplat.app.places import Place
from skelsplat.cli.of_found import after_calibrate, paths_in, words_of
from skelsplat.cli.process import DONE, RUNNING, Work
from skelsplat.cli.rows import Option, texts_of
from skelsplat.cli.settings import OPTIONS, put, reading_of
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Remedy
from skelsplat.run.compared import AnyRun, open_run, options_of
from skelsplat.run.files import videos_of_run
from skelsplat.run.found import Found, look, output_of


@dataclass
class Recording:
    """A recording in a folder; ``given`` has by command the texts of its settings, as they are typed."""

    place: Place
    folder: Path
    given: dict[str, dict[str, Any]] = field(default_factory=lambda: {command: {} for command in OPTIONS})
    found: Found = field(default_factory=lambda: Found(Path()))
    result: AnyRun | None = None
    drawn: dict[str, bool] = field(default_factory=dict)  # as `videos_of_run` has them
    before: tuple[AnyRun, str, dict[str, Any]] | None = None  # until a remedy: result, what, settings
    work: Work | None = None
    done: list[str] = field(default_factory=list)  # commands as they are typed
    version: int = 0  # goes up whenever something else is to be shown
    looking: Lock = field(default_factory=Lock)  # held while it is first looked at

    @property
    def output(self) -> Path:
        """The folder of the results."""
        return self.place.inside(output_of(self.folder), self.folder)

    @property
    def running(self) -> bool:
        """Whether a command is being done."""
        return self.work is not None and self.work.state == RUNNING

    def look(self) -> Recording:
        """Look at the folder anew; the settings of an earlier run there count until others are given."""
        self.result = open_run(self.output)
        if self.result is not None and not self.version and not self.given["refine"]:
            self.given["refine"] = texts_of(OPTIONS["refine"], options_of(self.result.report))
        self.drawn = videos_of_run(self.output) if self.result is not None else {}
        self.found = look(self.folder, reading_of(self.given), self.place.root)
        self.version += 1
        return self

    def choose(self, setting: str, value: str) -> None:
        """Take over the value of a setting that something lacks."""
        put(self.given["refine"], setting, value.split(",") if setting == "without" else value)
        self.look()

    def words(self, command: str) -> list[str]:
        """Return a command as it is typed, without `skelsplat`; no path in it leads out."""
        for path in paths_in(self.given):
            self.place.inside(path, self.folder)
        return words_of(command, self.found, self.given)

    def start(self, command: str) -> None:
        """Start a command; what it finds is compared with nothing but after a remedy."""
        self._start(self.words(command), self.before if command == "overlay" else None)

    def install(self, extra: str) -> None:
        """Install what an extra adds."""
        self._start(pip_words(extra), self.before)

    def _start(self, words: list[str], before: tuple[AnyRun, str, dict[str, Any]] | None) -> None:
        if self.running:
            raise InvalidInputError(f"{words[0]}: expected one command at a time, got a second one")
        self.before = before
        self.work = Work(words, self.folder, self._ended).start()
        self.version += 1

    def _ended(self, work: Work) -> None:
        """Take over what a command has found, and look again."""
        invalidate_caches()  # it may have installed something
        if work.state == DONE:
            self.done.append(work.command)
            if work.words[0] == "calibrate":
                self.given["refine"].pop("unit", None)
                self.given["refine"] |= after_calibrate(work.document["refine"])
        elif self.before is not None and work.words[0] == "refine":  # a remedy that was cancelled, or failed
            self.given["refine"], self.before = self.before[2], None
        self.look()

    def try_remedy(self, row: Option, remedy: Remedy, also: Mapping[str, Any] | None = None) -> None:
        """Refine with a remedy of a finding, ``also`` with other settings, and keep the result before it."""
        assert self.result is not None
        settings, texts = self.given["refine"], remedy.texts
        before = (self.result, f"{row.title} {', '.join(texts)}".rstrip(), dict(settings))
        put(settings, row.name, [*settings.get(row.name, []), *texts] if row.many else (*texts, True)[0])
        settings |= also or {}
        self._start(self.words("refine"), before)

    def go_back(self) -> None:
        """Refine with the settings before a remedy."""
        if self.before is not None:
            self.given["refine"], self.before = self.before[2], None
            self.start("refine")
