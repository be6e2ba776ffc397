"""Findings: facts, one sentence each, and the way through JSON and through Python warnings."""

from __future__ import annotations

import json
import re
import warnings
from itertools import combinations

import pytest

from skelsplat import _sentences
from skelsplat import _words as words
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


@pytest.mark.parametrize(
    ("mm", "text"),
    [
        (1234.5, "1,234.5"),
        (14.22, "14.2"),
        (1.04, "1.0"),
        (0.96, "0.96"),
        (0.0046, "0.0046"),
        (4e-6, "0.0000040"),
    ],
)
def test_lengths_have_one_decimal_or_two_digits(mm, text):
    assert words.length(mm) == text
    assert words.length(-mm) == f"-{text}"


def test_lengths_that_are_none_are_written_as_before():
    assert (words.length(0.0), words.length(float("nan")), words.length(0.0, 0)) == ("0.0", "–", "0")


@pytest.mark.parametrize(
    ("sizes", "text"),
    [((234.0, 87.4), "a to b 234 mm and c to d 87 mm"), ((1.63, 0.3), "a to b 1.6 mm and c to d 0.30 mm")],
)
def test_limbs_below_a_centimetre_have_two_digits(sizes, text):
    numbers = {"limbs": [("a", "b"), ("c", "d")], "lengths_mm": sizes, "layouts_of_as_many_joints": ()}
    assert text in Finding("limbs_differ", numbers=numbers).text


def test_sentences_begin_with_a_capital_a_name_or_an_option_and_end():
    for kind, form in _sentences.SENTENCES.items():
        if isinstance(form, str) and kind not in ("frame_empty", "frame_diverged", "frame_max_steps"):
            assert re.match(r"[A-Z{]|--|init_pose|report\.html", form), (kind, form)
            assert re.search(r"[.?]$|{(text|why)}$|pip install '[^']+'$", form), (kind, form)
