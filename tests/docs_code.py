"""Run the code blocks of a page, so that README and docs show what really happens.

Blocks run in the order of the page, in one folder and with one namespace for Python:

``python``    is executed. The text in ``print(…)  # text`` must be printed; a ``text`` block that follows
              directly is the whole output of the block.
``console``   lines that begin with ``$`` are run and must succeed, or exit with the status in a trailing
              comment (``# exit status 1``). Lines below a command are its whole output.
``toml``      must be valid TOML; with a first line ``# name.toml`` it is saved in the folder under that name.

In expected output, … matches any text, and on a separate line any lines. Other blocks (``sh``, ``text``) are
not run.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import skelsplat
from command_line import invoke

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_FENCE = re.compile(
    r"^(?P<tail>`{3,})(?P<kind>\w+)\n(?P<text>.*?)^(?P=tail)[ \t]*\n", re.DOTALL | re.MULTILINE
)
_RUN = ("python", "console", "toml")
_STATUS = re.compile(r"\s+# exit status (\d+)$")
_SHELL = re.compile(r"[|<>;&*$]")


@dataclass(frozen=True)
class Block:
    """A fenced block: its kind, its text, where it begins, and what a ``text`` block right below promises."""

    kind: str
    text: str
    line: int
    promised: str | None


def blocks(text: str) -> list[Block]:
    """Return the blocks that are run."""
    found = list(_FENCE.finditer(text))
    after = {match.start(): match for match in found}
    out = []
    for match in found:
        if match["kind"] in _RUN:
            rest = text[match.end() :]
            below = after.get(match.end() + len(rest) - len(rest.lstrip("\n")))
            promised = below["text"] if below and below["kind"] == "text" else None
            line = text.count("\n", 0, match.start()) + 1
            out.append(Block(match["kind"], match["text"], line, promised))
    return out


@dataclass
class Page:
    """A page whose blocks are run in `folder`, which is the working directory."""

    path: Path
    folder: Path
    namespace: dict[str, object] = field(default_factory=lambda: {"__name__": "__main__"})

    def run(self) -> None:
        """Run all blocks; an assertion names the page and the line."""
        for block in blocks(self.path.read_text(encoding="utf-8")):
            getattr(self, f"_{block.kind}")(block, f"{self.path.name}:{block.line}")

    def _python(self, block: Block, where: str) -> None:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block.text, where, "exec"), self.namespace)
        for promise in re.findall(r"print\(.*\)\s+# (.+)$", block.text, flags=re.MULTILINE):
            lines = printed.getvalue().splitlines()
            assert any(re.search(_pattern(promise), line) for line in lines), f"{where}: {promise!r}: {lines}"
        if block.promised is not None:
            assert_output(printed.getvalue(), block.promised, where)

    def _toml(self, block: Block, where: str) -> None:
        assert tomllib.loads(block.text), where
        if name := re.match(r"# (\S+\.toml)\n", block.text):
            (self.folder / name[1]).write_text(block.text, encoding="utf-8")

    def _console(self, block: Block, where: str) -> None:
        for command, promised in commands(block.text):
            stated = _STATUS.search(command)
            status, output = run(command, self.folder)
            assert status == (int(stated[1]) if stated else 0), f"{where}: {command}: {status}\n{output}"
            if promised.strip():
                assert_output(output, promised, f"{where}: {command}")


def commands(text: str) -> list[tuple[str, str]]:
    """Return every command of a console block, and the lines below it."""
    joined = re.sub(r" *\\\n *", " ", text)
    parts = re.split(r"^\$ (.*)\n", joined, flags=re.MULTILINE)
    assert not parts[0].strip(), f"expected a line that begins with $, got {parts[0]!r}"
    return list(zip(parts[1::2], parts[2::2], strict=True))


def run(command: str, folder: Path) -> tuple[int, str]:
    """Return exit status and output: of skelsplat in this process, of anything else in a shell."""
    words = shlex.split(command, comments=True)
    if words[0] == "skelsplat" and not _SHELL.search(_STATUS.sub("", command)):
        result = invoke(*words[1:])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result.exit_code, result.output
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    own = {"PATH": path, "PYTHONPATH": str(Path(skelsplat.__file__).parents[1])}
    env = {**os.environ, **own, "COLUMNS": "80", "MPLBACKEND": "Agg"}
    shell = ["bash", "-o", "pipefail", "-c", f"{{ {command}\n}} 2>&1"]
    done = subprocess.run(
        shell, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=100
    )
    return done.returncode, done.stdout


def assert_output(actual: str, promised: str, where: str) -> None:
    """Compare line by line, without blanks at the ends of lines."""
    lines = [line.rstrip() for line in promised.strip("\n").splitlines()]
    pattern = "".join(r"(?:.*\n)*?" if line == "…" else _pattern(line) + "\n" for line in lines)
    shown = "".join(f"{line.rstrip()}\n" for line in actual.strip("\n").splitlines())
    assert re.fullmatch(pattern, shown), f"{where}: expected\n{promised}\ngot\n{actual}"


def _pattern(promised: str) -> str:
    return ".*?".join(re.escape(part) for part in promised.split("…"))
