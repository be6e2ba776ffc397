"""Findings: facts, one sentence each, and the way through JSON and through Python warnings."""

from __future__ import annotations

import json
import warnings

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
