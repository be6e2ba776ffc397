"""A recording on the page: what was found, its settings, the commands they make, and what is being done."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

import skelsplat as sk
from skelsplat.app.found import Found, look, output_of
from skelsplat.app.places import Place
from skelsplat.app.results import Result, earlier_settings, read_result
from skelsplat.app.work import DONE, Work
from skelsplat.cli import calibrate, detect, options, pictures
from skelsplat.cli.batch import REFINE
from skelsplat.cli.rows import NAME_OR_PATH, Option, typed
from skelsplat.exceptions import InvalidInputError, SkelSplatError
from skelsplat.run import Job

FOUND_CAMERAS, PAGE_OF_CAMERAS, KEYPOINTS = "Calib-from-people.toml", "calibration.html", "pose"
_OF_FILES = ("calibration", "detections", "output", "videos", "report", "force", "overwrite", "run", "plain")
# By command, its options on the page: all but those that say which files.
OPTIONS: dict[str, tuple[Option, ...]] = {
    command: tuple(row for row in rows if row.name not in _OF_FILES)
    for command, rows in {
        "refine": options.JOB,
        "calibrate": calibrate.OPTIONS,
        "detect": detect.OPTIONS,
        "overlay": pictures.OVERLAY_OPTIONS,
    }.items()
}
# Options of calibrate that are those of refine, and are set once.
SHARED = ("layout", "frames", "format", "mapping", "sequence", "fps")
Given = dict[str, dict[str, Any]]


@dataclass
class Recording:
    """A recording in a folder; ``given`` has by command the texts of its settings, as they are typed."""

    place: Place
    folder: Path
    given: Given = field(default_factory=lambda: {command: {} for command in OPTIONS})
    found: Found | None = None
    result: Result | None = None
    before: tuple[Result, str, dict[str, Any]] | None = None  # a remedy was tried: result, what, settings
    work: Work | None = None
    queue: list[str] = field(default_factory=list)  # commands that follow if the present one succeeds
    done: list[str] = field(default_factory=list)  # commands as they are typed
    version: int = 0  # goes up whenever something else is to be shown

    def look(self) -> Recording:
        """Look at the folder anew; the settings of an earlier run there count until others are given."""
        self.result = read_result(self.folder / output_of(self.folder))
        if self.result is not None and self.found is None and not self.given["refine"]:
            self.given["refine"] = earlier_settings(self.result.report)
        self.found = look(self.folder, self.given["refine"])
        self.version += 1
        return self

    @property
    def running(self) -> bool:
        """Whether a command is being done."""
        return self.work is not None and self.work.running

    def set(self, command: str, name: str, value: Any) -> None:
        """Set the text of a setting; nothing takes it back."""
        set_in(self.given[command], name, value)

    def words(self, command: str) -> list[str]:
        """Return a command as it is typed, without `skelsplat`; paths are relative to the folder."""
        found, out = self.found or Found(self.folder), output_of(self.folder)
        given = self.given[command]
        if command == "calibrate":
            given = {**{name: self.given["refine"].get(name) for name in SHARED}, **given}
        self._check(OPTIONS[command], given)
        files = {
            "detect": [found.videos, "-o", KEYPOINTS],
            "calibrate": [
                *(found.detections, "-o", FOUND_CAMERAS, "--force", "--report", PAGE_OF_CAMERAS)
            ],
            "refine": [found.calibration, found.detections, "-o", out],
            "overlay": [out, found.videos or "--plain"],
        }
        return [command, *files[command], *typed(OPTIONS[command], given)]

    def _check(self, rows: Sequence[Option], given: Mapping[str, Any]) -> None:
        """Refuse paths outside of where the page may read and write."""
        for row in rows:
            if (row.kind is Path or NAME_OR_PATH in row.marks) and given.get(row.name):
                self.place.inside(given[row.name], self.folder)

    def start(self, *commands: str) -> None:
        """Start a command, and the others after it, each if that before it succeeded."""
        if self.running:
            raise InvalidInputError(f"folder: expected one command at a time, got {commands[0]} while another runs")
        self.place.inside(self.folder / output_of(self.folder))
        first, *self.queue = commands
        self.work = Work(self.words(first), self.folder, self._ended).start()
        self.version += 1

    def cancel(self) -> None:
        """Cancel what is being done, and what would follow."""
        self.queue.clear()
        if self.work is not None:
            self.work.cancel()

    def _ended(self, work: Work) -> None:
        """Go on after a command: take over what it found, look again, start the next."""
        if work.state == DONE:
            self.done.append(work.command)
            if work.words[0] == "calibrate":
                self._take_over(work.document)
        self.look()
        if work.state == DONE and self.queue:
            try:
                self.start(*self.queue)
            except (SkelSplatError, OSError) as error:
                work.messages.append(f"error: {error}")

    def _take_over(self, document: Mapping[str, Any]) -> None:
        """Set what refines with cameras that were found: the command that calibrate prints."""
        for command in document.get("refine", ()):
            self.given["refine"] |= {"calibration": FOUND_CAMERAS, **_texts(shlex.split(command))}
            self.given["refine"].pop("unit", None)

    def job(self) -> Job:
        """Return the job of the settings, checked as on the command line."""
        try:
            job: Job = REFINE.main(self.words("refine")[1:], prog_name="refine", standalone_mode=False)
        except Exception as error:
            if not hasattr(error, "format_message"):  # what every error of usage has
                raise
            raise InvalidInputError(error.format_message()) from error
        return job

    def try_remedy(self, setting: str, value: Any) -> None:
        """Refine with a remedy of a finding, and keep the result before it for comparison."""
        if self.result is None:
            return
        row = next((row for row in OPTIONS["refine"] if row.flag == f"--{setting.replace('_', '-')}"), None)
        if row is None:
            raise InvalidInputError(f"{setting}: expected a setting of refine, got one of another command")
        settings = dict(self.given["refine"])
        text = True if value is True else str(value)
        text = [*settings.get(row.name, []), text] if row.many else text
        self.before = (self.result, " ".join(typed([row], {row.name: text})), settings)
        self.set("refine", row.name, text)
        self.start("refine")

    def go_back(self) -> None:
        """Refine with the settings before a remedy."""
        if self.before is not None:
            self.given["refine"], self.before = self.before[2], None
            self.start("refine")


def set_in(given: dict[str, Any], name: str, value: Any) -> None:
    """Set the text of a setting; nothing takes it back."""
    if value in (None, "", False, []):
        given.pop(name, None)
    else:
        given[name] = value


def _texts(words: Sequence[str]) -> dict[str, Any]:
    """Return the options in words, by name, as texts."""
    found: dict[str, Any] = {}
    rows = {flag: row for row in OPTIONS["refine"] for flag in row.flags}
    for place, word in enumerate(words):
        row = rows.get(word)
        if row is not None:
            value = True if row.kind is bool else words[place + 1]
            found[row.name] = [*found.get(row.name, []), value] if row.many else value
    return found


def python_of(job: Job) -> str:
    """Return the lines of Python that do what a job does."""
    function = "run" if job.people is None else "run_people"
    given = [repr(str(job.calibration)), repr(str(job.detections))]
    for one in fields(job):
        if one.name in ("calibration", "detections", "config"):
            continue
        usual = one.default_factory() if one.default_factory is not MISSING else one.default
        value = getattr(job, one.name)
        if value != usual:
            given.append(f"{one.name}={str(value) if isinstance(value, Path) else value!r}")
    config = _config_of(job.settings)
    if config:
        given.append(f"config=sk.RefineConfig{config}")
    lines = [f"from skelsplat.run import Job, {function}", "", f"job = Job({', '.join(given)})"]
    lines += [f"found = {function}(job)", "print(*found.findings, sep='\\n')"]
    return "\n".join(["import skelsplat as sk"] * bool(config) + lines)


def _config_of(settings: sk.RefineConfig) -> str:
    """Return how the settings are made, from the bracket or ``.paper(`` on; nothing of the defaults."""
    usual = sk.RefineConfig.paper() if settings.method == "paper" else sk.RefineConfig()
    plain = usual.to_dict()
    changed = [f"{name}={value!r}" for name, value in settings.to_dict().items() if plain.get(name) != value]
    start = ".paper" if settings.method == "paper" else ""
    return f"{start}({', '.join(changed)})" if start or changed else ""
