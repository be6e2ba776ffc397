"""Running the command line in tests."""

from __future__ import annotations

import json

import typer
from typer.testing import CliRunner

from skelsplat.cli import app

READ = ["--unit", "mm", "--layout", "h36m17"]
FAST = ["--max-steps", "30", "--fps", "50"]
RESULTS = {
    *("pose.npz", "pose.csv", "pose.trc", "report.json", "overview.png", "weights.png"),
    *("report.html", "cameras.json", "detections.npz"),
}


ROOT = typer.main.get_command(app)


def commands(group, path=()):
    """Yield the names that lead to each command, and the command."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


def invoke(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args], env={"COLUMNS": "80"})


def succeed(*args):
    """Run a command that has to succeed; return what came of it."""
    result = invoke(*args)
    assert result.exit_code == 0, result.output
    return result


def read_report(out):
    return json.loads((out / "report.json").read_text())


def texts(report, *severities):
    """Return the sentences of a report's findings: of warnings and errors, if nothing else is asked for."""
    wanted = severities or ("error", "warning")
    return [finding["text"] for finding in report["findings"] if finding["severity"] in wanted]


def assert_fails(result, status, *parts):
    """One line on stderr that starts with ``error:`` and holds ``parts``; nothing on stdout."""
    assert result.exit_code == status, result.output
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    for part in parts:
        assert part in lines[0]
