"""Findings: faults and doubts about runs, rigs and data sets, in one type.

A `Finding` is made where it is noticed, with its sentence: its kind, what it concerns, the numbers and what
helps against it are for programs, which need not parse prose. A `Remedy` is a setting and its value;
how it is typed on the command line is up to `skelsplat.cli`.
"""

from __future__ import annotations

import contextlib
import inspect
import os
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from skelsplat._escape import escaped

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Subject:
    """What a finding concerns: names, and frame numbers of the files; an empty tuple means all of them."""

    cameras: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    frames: tuple[int, ...] = ()
    files: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Remedy:
    """A setting of a run (a field of `skelsplat.run.Job` or of its settings) that helps, and its value.

    ``("without", "cam_03")``; True for a switch, None where the user chooses, a list of several at once.
    """

    setting: str
    value: Any = True

    @property
    def texts(self) -> list[str]:
        """The values as texts; none of a switch, and where the user chooses."""
        if self.value in (None, True):
            return []
        return [str(one) for one in (self.value if isinstance(self.value, list) else [self.value])]


@dataclass(frozen=True)
class Finding:
    """Something that is wrong, may be wrong, or is worth knowing."""

    #: Such as ``"camera_disagrees"``; docs/errors.md lists all.
    kind: str
    #: ``"error"``: results are wrong until this is corrected; ``"warning"``: they may be wrong; ``"note"``.
    severity: Severity = "warning"
    subject: Subject = field(default_factory=Subject)
    #: What the sentence quotes, as values of JSON; lengths carry their unit in the key.
    numbers: Mapping[str, Any] = field(default_factory=dict)
    #: Settings that help.
    remedy: tuple[Remedy, ...] = ()
    #: The finding in words: one or a few sentences, which name no option of the command line.
    sentence: str = field(kw_only=True, compare=False)

    @property
    def text(self) -> str:
        """The sentence as it may be printed: control characters of names from files are escaped."""
        return escaped(self.sentence)

    def __str__(self) -> str:
        return self.text

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as values of JSON, with its text; empty parts of the subject are left out."""
        return {
            "kind": self.kind,
            "severity": self.severity,
            "text": self.text,
            "subject": {name: list(values) for name, values in asdict(self.subject).items() if values},
            "numbers": dict(self.numbers),
            "remedy": [asdict(remedy) for remedy in self.remedy],
        }

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> Finding:
        """Return the finding from which `to_dict` made ``entry``."""
        subject = Subject(**{name: tuple(values) for name, values in entry["subject"].items()})
        remedy = tuple(Remedy(**one) for one in entry["remedy"])
        facts = (entry["kind"], entry["severity"], subject, entry["numbers"], remedy)
        return cls(*facts, sentence=entry["text"])


class FindingWarning(UserWarning):
    """A warning that carries a `Finding`: ``warnings.warn(FindingWarning(finding), stacklevel=2)``."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(finding.text)
        self.finding = finding


def warn(finding: Finding) -> None:
    """Warn of a finding, as of the line outside the package."""
    frame, depth = inspect.currentframe(), 1
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == __package__:
        frame, depth = frame.f_back, depth + 1
    warnings.warn(FindingWarning(finding), stacklevel=depth)


def warn_of_clipped(argument: str, highest: float) -> None:
    """Warn that confidences above 1 count as 1, once per line. The compiled core calls this."""
    numbers = {"argument": argument, "highest": highest}
    sentence = f"{argument}: confidences slightly above 1, up to {highest}, count as 1."
    warn(Finding("confidence_clipped", "note", numbers=numbers, sentence=sentence))


def remark(text: str) -> Finding:
    """Return a note with the given sentence, such as the message of a warning."""
    sentence = " ".join(text.split())
    return Finding("remark", "note", numbers={"text": sentence}, sentence=sentence)


# Warnings belong to the process: two threads that collect at the same time would collect each other's.
_collecting = threading.RLock()


def _free() -> None:
    """Replace the lock in a child process: after a fork, the thread that held it may not exist."""
    global _collecting
    _collecting = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free)


@contextlib.contextmanager
def collected_warnings(tell: Callable[[Finding], None] | None = None) -> Iterator[list[Finding]]:
    """Collect Python warnings as findings, each once, and call ``tell`` with each as it occurs.

    Threads take turns. Warnings of threads that do not collect are included.
    """
    found: list[Finding] = []

    def show(message: Warning | str, *_: object, **__: object) -> None:
        finding = message.finding if isinstance(message, FindingWarning) else remark(str(message))
        if finding not in found:
            found.append(finding)
            if tell is not None:
                tell(finding)

    with _collecting, warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = show
        yield found
