"""The sentences of findings, by kind: one module per origin, each with a table ``SENTENCES``.

A sentence is a format string, or a function of the finding. A format string is filled with the finding's
numbers and with ``{cameras}``, ``{joints}``, ``{frames}``, ``{files}`` and ``{takes}`` of its subject, listed
with commas.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

from skelsplat._sentences import arrays, run

if TYPE_CHECKING:
    from skelsplat.findings import Finding

Sentence = str | Callable[["Finding"], str]

ORIGINS: tuple[Mapping[str, Sentence], ...] = (
    arrays.SENTENCES,
    run.SENTENCES,
)
SENTENCES: dict[str, Sentence] = {kind: form for origin in ORIGINS for kind, form in origin.items()}


def sentence(finding: Finding) -> str:
    """Return the text of a finding."""
    form = SENTENCES[finding.kind]
    if not isinstance(form, str):
        return form(finding)
    subject = {name: ", ".join(map(str, values)) for name, values in asdict(finding.subject).items()}
    return form.format(**{**subject, **finding.numbers})
