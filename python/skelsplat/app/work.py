"""A command in a process of its own: how far it is, the time left, what it said, and how it is cancelled."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any


RUNNING, DONE, FAILED, CANCELLED = "running", "done", "failed", "cancelled"
_INTERRUPTED = 130
_BAR = "\x1e"  # begins a line of stderr that says how far a command is
# Not the current folder, which holds what somebody filmed, and perhaps files with names of modules.
_PROGRAM = "import sys; sys.path[:] = [p for p in sys.path if p]; from skelsplat.app.work import _do; _do()"
_PATIENCE_S = 10.0  # until a command that does not end when cancelled is killed


@dataclass(frozen=True)
class Bar:
    """How far a command is with what it does at present."""

    name: str
    done: int | None
    total: int | None
    since: float  # s, as of `time.monotonic`
    at: float

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
    """A command of `skelsplat`, the words after it, done in the folder of a recording."""

    words: Sequence[str]
    folder: Path
    then: Callable[[Work], None] = lambda _: None  # called at its end, in another thread
    state: str = RUNNING
    bar: Bar | None = None
    messages: list[str] = field(default_factory=list)  # each a line: "warning: …", or at last "error: …"
    document: dict[str, Any] = field(default_factory=dict)  # what ``--json`` prints
    started: float = field(default_factory=time.monotonic)
    _process: subprocess.Popen[str] | None = None

    @property
    def command(self) -> str:
        """The command as it is typed."""
        return shlex.join(["skelsplat", *self.words])

    @property
    def error(self) -> str:
        """Why it failed, in one line."""
        errors = [line.removeprefix("error: ") for line in self.messages if line.startswith("error: ")]
        last = errors[-1] if errors else (self.messages or [f"{self.command} ended without a word"])[-1]
        return last.partition(" (see skelsplat ")[0]

    @property
    def running(self) -> bool:
        """Whether it is not at its end."""
        return self.state == RUNNING

    def start(self) -> Work:
        """Start the process."""
        paths = os.pathsep.join(path for path in sys.path if path)
        self._process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *self.words, "--json"],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": paths, "PYTHONIOENCODING": "utf-8"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
        )
        threading.Thread(target=self._follow, args=(self._process,), daemon=True).start()
        return self

    def cancel(self) -> None:
        """Interrupt it as Ctrl-C does, so that files are whole; kill it if it does not end."""
        process = self._process
        if process is None or process.poll() is not None:
            return
        self.state = CANCELLED
        process.send_signal(signal.SIGINT) if os.name == "posix" else process.terminate()
        late = threading.Timer(_PATIENCE_S, process.kill)
        late.daemon = True
        late.start()

    def wait(self) -> None:
        """Wait for its end."""
        if self._process is not None:
            self._process.wait()

    def _follow(self, process: subprocess.Popen[str]) -> None:
        """Read what the process says until its end."""
        assert process.stdout is not None
        assert process.stderr is not None
        ear = threading.Thread(target=self._listen, args=(process.stderr,), daemon=True)
        ear.start()
        printed = process.stdout.read()
        ear.join()
        status = process.wait()
        if self.state == CANCELLED or status == _INTERRUPTED:
            self.state = CANCELLED
        else:
            self._judge(status, printed)
        self.then(self)

    def _judge(self, status: int, printed: str) -> None:
        """Take what it printed, and whether it failed: a run that found errors has results to be looked at."""
        self.document = json.loads(printed) if printed.strip() else {}
        if status and self.words[0] not in ("refine", "batch"):
            found = self.document.get("findings", ())
            self.messages += [f"error: {one['text']}" for one in found if one["severity"] == "error"]
        fine = status == 0 or (self.document and self.words[0] in ("refine", "batch"))
        self.state = DONE if fine else FAILED

    def _listen(self, stderr: IO[str]) -> None:
        for line in map(str.rstrip, stderr):
            if not line.startswith(_BAR):
                self.messages.append(line)
                continue
            name, done, total = json.loads(line[1:])
            now, before = time.monotonic(), self.bar
            since = before.since if before is not None and before.name == name else now
            self.bar = Bar(name, done, total, since, now)


def _do() -> None:
    """Do the command in the arguments of this process."""
    from skelsplat.cli import main
    from skelsplat.cli.output import heard

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    sys.argv[0] = "skelsplat"
    said = 0.0

    def say(name: str, done: int | None, total: int | None) -> None:
        nonlocal said
        if time.monotonic() - said > 0.1 or done == total:
            said = time.monotonic()
            sys.stderr.write(f"{_BAR}{json.dumps([name, done, total])}\n")
            sys.stderr.flush()

    with heard(say):
        main()
