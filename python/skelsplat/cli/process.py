"""A command in a process of its own: how far it is, the time left, what it said, and how it is cancelled."""

from __future__ import annotations

import json
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skelsplat.cli._app import app
from skelsplat.cli.output import heard
from skelsplat.run.process import Child

RUNNING, DONE, FAILED, CANCELLED = "running", "done", "failed", "cancelled"
_BAR = "\x1e"  # begins a line that says how far a command is
_PROGRAM = "from skelsplat.cli.process import _do; _do()"
_EVERY_S = 0.1
_JUDGED_BY_FILES = ("refine", "batch")  # whose errors may be findings, with results to be looked at


_BY_CAMERA = ("detect", "overlay")
_DOING = {
    "detect": ("Finding people in the videos", "frames"),
    "calibrate": ("Finding the cameras", "steps"),
    "refine": ("Finding the pose in 3D", "frames"),
    "overlay": ("Drawing", "frames"),
    "batch": ("Refining the recordings", "recordings"),
}


@dataclass(frozen=True)
class Bar:
    """How far a command is with what it does at present."""

    name: str
    done: int | None
    total: int | None
    since: float  # s, as of `time.monotonic`

    @property
    def share(self) -> float | None:
        """The share that is done, 0 to 1; None if unknown."""
        return min(1.0, (self.done or 0) / self.total) if self.total else None

    @property
    def seconds_left(self) -> float | None:
        """Time left if it goes on as until now; None if unknown."""
        passed = time.monotonic() - self.since
        return passed * (1.0 / self.share - 1.0) if self.share and passed > 1.0 else None


@dataclass
class Work:
    """A command, the words after `skelsplat`, done in a folder; ``then`` is called in a thread at its end."""

    words: Sequence[str]
    folder: Path
    then: Callable[[Work], object] = lambda _: None
    state: str = RUNNING
    bar: Bar | None = None
    messages: list[str] = field(default_factory=list)  # lines: "warning: …", or at last "error: …"
    document: dict[str, Any] = field(default_factory=dict)  # what ``--json`` prints
    _child: Child | None = None
    _cancelled: bool = False

    @property
    def command(self) -> str:
        """The command as it is typed."""
        return shlex.join(["skelsplat", *self.words])

    @property
    def error(self) -> str:
        """Why it failed, in one line."""
        errors = [line.removeprefix("error: ") for line in self.messages if line.startswith("error: ")]
        last = (errors or self.messages or [f"{self.command} ended without a word"])[-1]
        return last.partition(" (see skelsplat ")[0]

    @property
    def left(self) -> str:
        """What it left behind when it was interrupted, in a sentence."""
        said = "".join(self.messages[-1:]).partition("interrupted; ")[2]
        return f"{said[:1].upper()}{said[1:]}." if said else ""

    @property
    def words_of_bar(self) -> str:
        """What it does, how far it is, and the time left."""
        (what, unit), bar = _DOING[self.words[0]], self.bar
        if self._cancelled or bar is None or not bar.total:
            return "Cancelling …" if self._cancelled else f"{what} …"
        name = f", {bar.name}" if self.words[0] in _BY_CAMERA else ""
        left = "" if bar.seconds_left is None else f", {_time(bar.seconds_left)} left"
        return f"{what}{name}: {bar.done or 0} of {bar.total} {unit}{left}"

    def start(self) -> Work:
        """Start the process."""
        words = [*self.words, "--json"]
        self._child = Child(_PROGRAM, *words, folder=self.folder, hear=self._hear, alone=True)
        threading.Thread(target=self._follow, args=(self._child,), daemon=True).start()
        return self

    def cancel(self) -> None:
        """Interrupt it."""
        if self._child is not None and self.state == RUNNING:
            self._cancelled = True
            self._child.interrupt()

    def wait(self) -> None:
        """Wait for the end of the process."""
        if self._child is not None:
            self._child.wait()

    def _follow(self, child: Child) -> None:
        status, printed = child.outcome()
        if self._cancelled and status:
            self.state = CANCELLED
        else:
            self.document = json.loads(printed) if printed.strip() else {}
            by_files = self.words[0] in _JUDGED_BY_FILES
            if status and not by_files:
                found = self.document.get("findings", ())
                self.messages += [f"error: {one['text']}" for one in found if one["severity"] == "error"]
            self.state = DONE if status == 0 or (by_files and self.document) else FAILED
        self.then(self)

    def _hear(self, line: str) -> None:
        if not line.startswith(_BAR):
            self.messages.append(line)
            return
        name, done, total = json.loads(line[len(_BAR) :])
        same = self.bar is not None and self.bar.name == name
        self.bar = Bar(name, done, total, self.bar.since if self.bar and same else time.monotonic())


def _time(seconds: float) -> str:
    """Return a time in words, as exact as it can be foreseen."""
    minutes = round(seconds / 60)
    return f"about {max(1, round(seconds))} s" if seconds < 60 else f"about {minutes} min"


def _do() -> None:
    """Do the command in the arguments of this process."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    sys.argv[0] = "skelsplat"
    said = 0.0

    def say(name: str, done: int | None, total: int | None) -> None:
        nonlocal said
        if time.monotonic() - said > _EVERY_S or done == total:
            said = time.monotonic()
            sys.stderr.write(f"{_BAR}{json.dumps([name, done, total])}\n")
            sys.stderr.flush()

    with heard(say):
        app(prog_name="skelsplat")
