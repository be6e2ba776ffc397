"""A recording on the page: what was found, its settings, the commands that they make, and what is done."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import Any

from skelsplat.app.places import Place
from skelsplat.cli.batch import job_of
from skelsplat.cli.process import DONE, RUNNING, Work
from skelsplat.cli.rows import NAME_OR_PATH, Option, texts_in, texts_of, typed
from skelsplat.cli.settings import OPTIONS, SHARED, put, reading_of
from skelsplat.exceptions import InvalidInputError, SkelSplatError
from skelsplat.run.compared import AnyRun, open_run
from skelsplat.run.earlier import options_of
from skelsplat.run.files import videos_of_run
from skelsplat.run.found import Found, look, output_of

_CAMERAS, _PAGE_OF_CAMERAS, _KEYPOINTS = "Calib-from-people.toml", "calibration.html", "pose"


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

    def words(self, command: str) -> list[str]:
        """Return a command as it is typed, without `skelsplat`; paths are relative to the folder."""
        found, given, out = self.found, self.given[command], output_of(self.folder)
        if command == "detect" and find_spec("mediapipe") is None and find_spec("rtmlib") is not None:
            given = {"backend": "rtmlib", **given}
        if command == "calibrate":
            given = {**{name: self.given["refine"].get(name) for name in SHARED}, **given}
        for row in OPTIONS[command]:
            if (row.kind is Path or NAME_OR_PATH in row.marks) and given.get(row.name):
                self.place.inside(given[row.name], self.folder)
        files = {
            "detect": (found.videos, "-o", _KEYPOINTS),
            "calibrate": (found.detections, "-o", _CAMERAS, "--force", "--report", _PAGE_OF_CAMERAS),
            "refine": (found.calibration, found.detections, "-o", out),
            "overlay": (out, found.videos or "--plain"),
        }
        return [command, *files[command], *typed(OPTIONS[command], given)]

    def lines(self) -> dict[str, str]:
        """Return the commands that were done and that which refines, and Python that does; by name."""
        typed_so_far = [f"cd {shlex.quote(str(self.folder))}", *self.done]
        try:
            words = self.words("refine") if self.found.ready else []
            last = [shlex.join(["skelsplat", *words])] if words else []
            python = job_of(words[1:]).python if words else ""
        except SkelSplatError as error:
            last, python = [f"# {error}"], ""
        found = {"the commands": "\n".join(dict.fromkeys([*typed_so_far, *last])), "the Python lines": python}
        return {name: text for name, text in found.items() if text}

    def start(self, command: str) -> None:
        """Start a command."""
        if self.running:
            raise InvalidInputError(f"{command}: expected one command at a time, got a second one")
        self.work = Work(self.words(command), self.folder, self._ended).start()
        self.version += 1

    def cancel(self) -> None:
        """Cancel what is being done."""
        if self.work is not None:
            self.work.cancel()

    def _ended(self, work: Work) -> None:
        """Take over what a command has found, and look again."""
        if work.state == DONE:
            self.done.append(work.command)
            for command in work.document.get("refine", ()) if work.words[0] == "calibrate" else ():
                self.given["refine"].pop("unit", None)
                self.given["refine"] |= {"calibration": _CAMERAS}
                self.given["refine"] |= texts_in(OPTIONS["refine"], shlex.split(command))
        elif self.before is not None:  # a remedy that was cancelled, or failed
            self.given["refine"], self.before = self.before[2], None
        self.look()

    def try_remedy(self, row: Option, value: Any) -> None:
        """Refine with a remedy of a finding, and keep the result before it for comparison."""
        assert self.result is not None
        settings = self.given["refine"]
        text, what = (True, row.title) if value is True else (str(value), f"{row.title} {value}")
        self.before = (self.result, what, dict(settings))
        put(settings, row.name, [*settings.get(row.name, []), text] if row.many else text)
        self.start("refine")

    def keep(self) -> None:
        """Keep the result of a remedy."""
        self.before = None

    def go_back(self) -> None:
        """Refine with the settings before a remedy."""
        if self.before is not None:
            self.given["refine"], self.before = self.before[2], None
            self.start("refine")
