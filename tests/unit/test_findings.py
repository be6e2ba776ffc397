"""Findings: facts, one sentence each, and the way through JSON and through Python warnings."""

from __future__ import annotations

import json
import re
import warnings
from itertools import combinations

import pytest

from skelsplat import _sentences
from skelsplat.findings import Finding, FindingWarning, Remedy, Subject, collected_warnings, remark


def test_kinds_of_different_origins_differ():
    for one, other in combinations(_sentences.ORIGINS, 2):
        assert not set(one) & set(other)


def test_a_finding_survives_json(monkeypatch):
    monkeypatch.setitem(_sentences.SENTENCES, "off", "{cameras} is {error_px:.1f} px off in frames {frames}.")
    finding = Finding(
        "off",
        "error",
        Subject(cameras=("a", "b c"), frames=(3, 4)),
        {"error_px": 2.25},
        (Remedy("without", "b c"), Remedy("y_up")),
    )
    entry = json.loads(json.dumps(finding.to_dict()))
    assert entry["text"] == finding.text == "a, b c is 2.2 px off in frames 3, 4."
    assert entry["subject"] == {"cameras": ["a", "b c"], "frames": [3, 4]}
    assert Finding.from_dict(entry) == finding
    assert [remedy.text for remedy in finding.remedy] == ["--without 'b c'", "--y-up"]


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


def test_a_finding_warns_with_its_text():
    with pytest.warns(UserWarning, match="^of a file$"):
        warnings.warn(FindingWarning(remark("of a file")), stacklevel=1)


def test_sides_swapped_in_part_of_the_detections_are_no_mirrored_image():
    def said(share):
        subject = Subject(cameras=("cam1",))
        return Finding("camera_mirrored", "warning", subject, {"swapped_share": share}).text

    assert said(0.71).endswith("swapped in 71% of its detections. Is the image mirrored?")
    assert said(0.33).endswith(
        "swapped in 33% of its detections. Does the detector confuse the sides in this view?"
    )


@pytest.mark.parametrize(("rival", "words"), [(23.6, "as well"), (24.0, "as well"), (24.1, "almost as well")])
def test_another_explanation_that_is_better_is_not_almost_as_good(rival, words):
    change = {"degrees": 1.4, "mm": 0.0, "mean_px": rival}
    other = {"kind": "camera_rotated", "camera": "cam1", **change}
    numbers = {**change, "before_px": 34.4, "after_px": 15.3, "mean_px": 24.0, "rivals": [other]}
    text = Finding("camera_rotated", "warning", Subject(cameras=("cam3",)), numbers).text
    assert f"Rotating cam1 by 1.4° explains it {words} (mean error {rival} px instead of 24.0 px)." in text


def test_sentences_begin_with_a_capital_a_name_or_an_option_and_end():
    for kind, form in _sentences.SENTENCES.items():
        if isinstance(form, str) and kind not in ("frame_empty", "frame_diverged", "frame_max_steps"):
            assert re.match(r"[A-Z{]|--|init_pose|report\.html", form), (kind, form)
            assert re.search(r"[.?]$|{(text|why)}$|pip install '[^']+'$", form), (kind, form)
