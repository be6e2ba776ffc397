"""A command in a process of its own: how far it is, the time left, what it said, and how it is cancelled."""

from __future__ import annotations

import json
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from skelsplat.cli._app import app
from skelsplat.cli.output import heard
from skelsplat.run.process import Child

RUNNING, DONE, FAILED, CANCELLED = "running", "done", "failed", "cancelled"
_BAR = "\x1e"  # begins a line that says how far a command is
_PROGRAM = "from skelsplat.cli.process import _do; _do()"
_PIP = """import importlib, importlib.util, runpy
if importlib.util.find_spec('pip') is None:
    __import__('ensurepip').bootstrap()
    importlib.invalidate_caches()
runpy.run_module('pip', run_name='__main__', alter_sys=True)"""
_EVERY_S = 0.1
_JUDGED_BY_FILES = ("refine", "batch")  # whose errors may be findings, with results to be looked at
_BY_PART = ("detect", "overlay")  # which name cameras; others what they do at present
_DOING = {
    "detect": ("Finding people in the videos", "frames"),
    "calibrate": ("Finding the cameras", "steps"),
    "refine": ("Finding the pose in 3D", "frames"),
    "overlay": ("Drawing", "frames"),
    "batch": ("Refining the recordings", "recordings"),
    "pip": ("Installing", "packages"),
}


@dataclass(frozen=True)
class Bar:
    """How far a command is, of each camera or other part that it names."""

    parts: Mapping[str, tuple[int, int]] = field(default_factory=dict)  # done and total, by name
    name: str = ""  # the last one
    begun: int = 0  # what was done when it began
    since: float = 0.0  # s, as of `time.monotonic`

    @property
    def done(self) -> int:
        """What is done of all parts."""
        return sum(done for done, _ in self.parts.values())

    @property
    def total(self) -> int:
        """What there is to do; 0 if unknown."""
        return sum(total for _, total in self.parts.values())

    @property
    def share(self) -> float | None:
        """The share that is done, 0 to 1; None if unknown."""
        return min(1.0, self.done / self.total) if self.total else None

    @property
    def seconds_left(self) -> float | None:
        """Time left if it goes on as until now; None if unknown."""
        passed, new = time.monotonic() - self.since, self.done - self.begun
        return passed * (self.total - self.done) / new if new > 0 and passed > 1.0 else None

    def after(self, name: str, done: int | None, total: int | None) -> Bar:
        """Return the bar after one of the parts went on; time counts anew if there is more or less to do."""
        new = Bar({**self.parts, name: (done or 0, total or 0)}, name, self.begun, self.since)
        anew = new.total != self.total or new.done < self.done
        return replace(new, begun=new.done, since=time.monotonic()) if anew else new


@dataclass
class Work:
    """A command, the words after `skelsplat`, done in a folder; ``then`` is called in a thread at its end."""

    words: Sequence[str]
    folder: Path
    then: Callable[[Work], object] = lambda _: None
    state: str = RUNNING
    bar: Bar = field(default_factory=Bar)
    messages: list[str] = field(default_factory=list)  # lines: "warning: …", or at last "error: …"
    document: dict[str, Any] = field(default_factory=dict)  # what ``--json`` prints
    _child: Child | None = None
    _cancelled: bool = False

    @property
    def command(self) -> str:
        """The command as it is typed."""
        if not self._pip:
            return shlex.join(["skelsplat", *self.words])
        first = f"{shlex.quote(sys.executable)} -m ensurepip && " if find_spec("pip") is None else ""
        return first + shlex.join([sys.executable, "-m", *self.words])

    @property
    def _pip(self) -> bool:
        return self.words[0] == "pip"

    @property
    def error(self) -> str:
        """Why it failed, in one line."""
        errors = [line[7:] for line in self.messages if line.lower().startswith("error: ")]
        last = (errors or self.messages or [f"{self.command} ended without a word"])[-1]
        return last.partition(" (see skelsplat ")[0]

    @property
    def words_of_end(self) -> str:
        """Why it failed, or what it left behind when it was cancelled."""
        left = "".join(self.messages[-1:]).partition("interrupted")[2]
        return self.error if self.state == FAILED else f"Cancelled{left}."

    @property
    def words_of_bar(self) -> str:
        """What it does, how far it is, and the time left."""
        (what, unit), bar = _DOING[self.words[0]], self.bar
        if self._cancelled:
            return "Cancelling …"
        if not bar.total:
            return f"{what}{'' if bar.done or self._pip else ': reading'} …"
        if bar.done == bar.total:
            return f"{what}: writing the results …"
        name = f", {bar.name}" if len(bar.parts) > 1 else ""
        left = "" if bar.seconds_left is None else f", {_time(bar.seconds_left)} left"
        return f"{what}{name}: {bar.done} of {bar.total} {unit}{left}"

    def start(self) -> Work:
        """Start the process."""
        program, words = (_PIP, self.words[1:]) if self._pip else (_PROGRAM, [*self.words, "--json"])
        self._child = Child(program, *words, folder=self.folder, hear=self._hear, alone=True)
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
            self.document = json.loads(printed) if printed.strip() and not self._pip else {}
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
        self.bar = self.bar.after(name if self.words[0] in _BY_PART else "", done, total)


def _time(seconds: float) -> str:
    """Return a time in words, as exact as it can be foreseen."""
    return f"about {max(1, round(seconds))} s" if seconds < 60 else f"about {round(seconds / 60)} min"


def _do() -> None:
    """Do the command in the arguments of this process."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    sys.argv[0] = "skelsplat"
    said: dict[str, float] = {}

    def say(name: str, done: int | None, total: int | None) -> None:
        if time.monotonic() - said.get(name, 0.0) > _EVERY_S or done == total:
            said[name] = time.monotonic()
            sys.stderr.write(f"{_BAR}{json.dumps([name, done, total])}\n")
            sys.stderr.flush()

    with heard(say):
        app(prog_name="skelsplat")
