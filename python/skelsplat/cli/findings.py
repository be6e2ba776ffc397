"""Findings on the console: the sentence, and the options that help against it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence

from rich.console import Console

from skelsplat.cli.output import print_message, print_text, say
from skelsplat.findings import Finding, Remedy


def remedy_words(remedy: Remedy) -> str:
    """Return a remedy as it is pasted into a shell: ``--without cam_03``."""
    flag = "--" + remedy.setting.replace("_", "-")
    value = remedy.value
    return flag if value is None or value is True else f"{flag} {shlex.quote(str(value))}"


def tell(finding: Finding, of: str = "") -> None:
    """Print a finding on stderr after its severity, and ``of``, whom or what it is of."""
    options = _lacking(finding)
    print_message(f"{finding.severity}: {of}{finding.text}{_advice(options)}", _pasted(finding))


def telling(*, quiet: bool) -> Callable[[Finding], None]:
    """Return `tell`; with ``quiet``, one that prints warnings and errors alone."""
    return lambda finding: None if quiet and finding.severity == "note" else tell(finding)


def print_finding(console: Console, finding: Finding, of: str = "", *, own_line: bool = False) -> None:
    """Print a finding on stdout, after ``!`` unless it is a note, and ``of``.

    With ``own_line`` all its options follow on a line of their own, to be pasted however long it is.
    """
    mark = "" if finding.severity == "note" else "! "
    options = _lacking(finding)
    command = "adjust-cameras" if any(one.setting == "move" for one in finding.remedy) else "refine"
    end = f" Correct it in {command} with:" if own_line and options else _advice(options)
    print_text(console, f"{mark}{of}{finding.text}{end}", _pasted(finding))
    if own_line and options:
        say(f"  {' '.join(options)}")


def print_findings(console: Console, findings: Sequence[Finding], of: str = "") -> None:
    """Print findings, and an empty line if there are any."""
    for finding in findings:
        print_finding(console, finding, of)
    if findings:
        console.print()


def _lacking(finding: Finding) -> list[str]:
    """Return the remedies in words, unless the sentence has them."""
    options = [remedy_words(remedy) for remedy in finding.remedy]
    return [] if all(option in finding.text for option in options) else options


def _advice(options: Sequence[str]) -> str:
    return f" Try {', '.join(options)}." if options else ""


def _pasted(finding: Finding) -> list[str]:
    """Return what is pasted from a finding's words: a command, and options."""
    return [*filter(None, [finding.numbers.get("check")]), *map(remedy_words, finding.remedy)]
