"""Findings: facts, one sentence each, and the way through JSON and through Python warnings."""

from __future__ import annotations

import json
import re
import warnings

import findings_table
from skelsplat.findings import Finding, FindingWarning, Remedy, Subject, collected_warnings, remark


def test_a_finding_survives_json():
    finding = Finding(
        "off",
        "error",
        Subject(cameras=("a", "b c"), frames=(3, 4)),
        {"error_px": 2.25},
        (Remedy("without", "b c"), Remedy("y_up")),
        sentence="a and b c are 2.2 px off.",
    )
    entry = json.loads(json.dumps(finding.to_dict()))
    assert entry["text"] == finding.text == finding.sentence
    assert Finding.from_dict(entry) == finding


def test_warnings_are_collected_as_findings_each_once():
    finding = remark("of a file")
    told = []
    with collected_warnings(told.append) as found:
        for _ in range(2):
            warnings.warn("one\n  line", stacklevel=1)
            warnings.warn(FindingWarning(finding), stacklevel=1)
    assert found == told == [remark("one line"), finding]
    assert [one.text for one in found] == ["one line", "of a file"]
    assert {one.severity for one in found} == {"note"}


def test_every_kind_of_finding_is_in_the_documentation_with_its_sentence():
    """If the page differs, run tools/findings_table.py."""
    assert findings_table.main(check=True) == 0
    page = findings_table.PAGE.read_text(encoding="utf-8")
    table = page.partition(findings_table.BEGIN)[2].partition(findings_table.END)[0]
    rows = [row.split(" | ") for row in table.strip().splitlines()[2:]]
    assert len(rows) > 50
    assert all(re.fullmatch(r"\| `[a-z_]+`", kind) and severity for kind, severity, _ in rows)
    assert [kind for kind, _, sentence in rows if sentence == "… |"] == ["| `remark`"]
