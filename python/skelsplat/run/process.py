"""Python in a process of its own: what it says while it works, what it prints, and how it is interrupted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_PATIENCE_S = 10.0  # from an interruption until a process that goes on is killed
# The folder that it works in holds what somebody filmed, and perhaps files with names of modules.
_BEGIN = "import sys; sys.path[:] = [path for path in sys.path if path]; "


class Child:
    """A process with this interpreter and its modules."""

    def __init__(
        self,
        program: str,
        *words: str,
        given: bytes = b"",
        folder: Path | None = None,
        hear: Callable[[str], object] = lambda _: None,
        alone: bool = False,
    ) -> None:
        """Start ``program`` with ``words`` in ``sys.argv``; `hear` is called with each line on stderr.

        One that is ``alone`` is not reached by Ctrl-C here, and `interrupt` also reaches what it has started.
        """
        paths = os.pathsep.join(path for path in sys.path if path)
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BEGIN + program, *words],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": paths, "PYTHONIOENCODING": "utf-8"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=alone,
        )
        self._given, self._hear, self._alone = given, hear, alone and os.name == "posix"

    def outcome(self) -> tuple[int, str]:
        """Wait for its end, once; return its exit status, below zero of a signal, and what it printed."""
        with self._process as process:
            assert process.stdin is not None
            assert process.stdout is not None
            ear = threading.Thread(target=self._listen, daemon=True)
            ear.start()
            with suppress(OSError):  # it has ended already
                process.stdin.write(self._given)
                process.stdin.close()
            printed = process.stdout.read()
            ear.join()
        return process.returncode, printed.decode(errors="replace")

    def _listen(self) -> None:
        for line in self._process.stderr or ():
            self._hear(line.decode(errors="replace").rstrip())

    def interrupt(self) -> None:
        """Interrupt it as Ctrl-C does, so that its files are whole; kill it if it goes on."""
        if self._process.poll() is not None:
            return
        self._send(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
        if os.name == "posix":
            late = threading.Timer(_PATIENCE_S, lambda: self._send(signal.SIGKILL))
            late.daemon = True
            late.start()

    def _send(self, sign: signal.Signals) -> None:
        if not self._alone:
            self._process.send_signal(sign)
        elif self._process.poll() is None:
            os.killpg(self._process.pid, sign)

    def wait(self) -> None:
        """Wait for its end."""
        self._process.wait()
