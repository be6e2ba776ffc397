"""Findings, their way through JSON and warnings, and which of them belong to single frames."""

from __future__ import annotations

import json
import re
import warnings
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

import findings_table
import skelsplat as sk
from command_line import READ, read_report, succeed
from skelsplat.findings import Finding, FindingWarning, Remedy, Subject, collected_warnings, remark
from skelsplat.run.frames import FrameFacts, Usual, find_in_frames, rows_of

T, M, N = 20, 4, 3


@pytest.fixture
def found():
    """Return a function that finds the problems of a clean recording with changes, as {frame: [words]}."""

    def find(**changes):
        parts = {
            "stop_reason": np.full(T, "converged", dtype="<U20"),
            "swapped": np.zeros((T, M, N), dtype=bool),
            "status": np.full((T, N), "ok", dtype="<U10"),
            "error_after": np.full((T, M, N), 2.0),
            "rejected": np.zeros((T, M, N), dtype=bool),
            "scatter_mm": np.full((T, N), 10.0),
        }
        for name, (index, value) in changes.items():
            parts[name][index] = value
        layout = SimpleNamespace(joints=("hip", "knee", "wrist"))
        inputs = SimpleNamespace(
            frames=np.arange(50, 50 + T), layout=layout, rig=SimpleNamespace(names="abcd")
        )
        result = SimpleNamespace(stop_reason=parts["stop_reason"], swapped=parts["swapped"])
        outcome = SimpleNamespace(result=result)
        stops = dict(Counter(parts["stop_reason"].tolist()))
        statistics = SimpleNamespace(stop_reasons=stops, **parts)
        facts = FrameFacts.of(inputs, outcome, statistics, parts["status"])
        usual = Usual.of(facts, statistics)
        findings, _ = find_in_frames([facts], usual, layout.joints, inputs.rig.names)
        words = {}
        for finding in findings:
            for frame in finding.subject.frames:
                words.setdefault(frame, []).append(finding.text)
        return words

    return find


@pytest.mark.parametrize(
    ("part", "index", "value", "words"),
    [
        ("status", (3, 1), "unobserved", "unobserved: knee"),
        ("status", (3, [1, 2]), "weak", "weak: knee, wrist"),
        ("status", (3, 2), "filled", "filled over time: wrist"),
        ("swapped", (3, [1, 3], 0), True, "left–right swap: b, d"),
        ("rejected", (3, [0, 1], 0), True, "many detections rejected"),
        ("error_after", (3,), 7.0, "large reprojection error"),
        ("scatter_mm", (3, 2), 31.0, "scatter far above normal: wrist"),
        ("stop_reason", 3, "diverged", "diverged"),
        ("stop_reason", 3, "max_steps", "stopped at the step limit"),
    ],
)
def test_what_stands_out_of_a_recording_is_named(found, part, index, value, words):
    assert found() == {}
    assert found(**{part: (index, value)}) == {53: [words]}


def test_a_third_rejected_is_a_problem_even_if_it_is_usual(found):
    assert len(found(rejected=((slice(None), [0, 1]), True))) == T


def test_a_frame_without_detections_has_one_reason(found):
    nothing = found(
        stop_reason=(3, "no_observations"),
        status=(3, "unobserved"),
        error_after=(3, np.nan),
        scatter_mm=(3, np.nan),
    )
    assert nothing == {53: ["no detection could be used"]}


def test_frames_that_follow_each_other_with_the_same_reasons_are_one_row():
    frames = (51, 52, 54)
    findings = [
        Finding("frame_stopped", "note", Subject(frames=(59,)), sentence="diverged"),
        Finding("frame_joints", "note", Subject(joints=("knee",), frames=frames), sentence="weak: knee"),
        Finding("frame_unusual", "note", Subject(frames=frames), sentence="many detections rejected"),
    ]
    assert rows_of(findings, range(50, 70)) == [
        (51, 52, "weak: knee; many detections rejected"),
        (54, 54, "weak: knee; many detections rejected"),
        (59, 59, "diverged"),
    ]


def test_report_json_has_the_facts_of_the_page(recording, arguments):
    folder, rig, _ = recording
    for camera in rig.names:
        path = folder / "openpose" / camera / "000002_keypoints.json"
        path.write_text(json.dumps({"people": []}))
    succeed(*arguments, *READ, "--fps", 50, "--frame-by-frame", "-q")
    report = read_report(folder / "out")
    (finding,) = report["frame_findings"]
    assert (finding["kind"], finding["subject"]) == ("frame_stopped", {"frames": [2]})
    assert finding["text"] == "no detection could be used"
    joints = report["reprojection_error"]["joints"]
    assert [joint["views_used_median"] for joint in joints] == [4.0] * 3 + [3.0] + [4.0] * 13
    assert {joint["views_used_min"] for joint in joints} == {0}
    assert report["reprojection_error"]["down_weighted_below"] > sk.REJECTED_WEIGHT
    for group in joints:
        assert group["down_weighted_share"] == group["down_weighted"] / group["used"]
        assert group["down_weighted"] >= group["rejected"]
    assert {"down_weighted", "views_used", "frame_findings"} <= set(report["meanings"])
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert '<a href="#frame=2">2</a></th><td>no detection could be used</td>' in page


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
    page = findings_table.PAGE.read_text(encoding="utf-8")
    assert page == findings_table.current()
    table = page.partition(findings_table.BEGIN)[2].partition(findings_table.END)[0]
    rows = [row.split(" | ") for row in table.strip().splitlines()[2:]]
    assert len(rows) > 50
    assert all(re.fullmatch(r"\| `[a-z_]+`", kind) and severity for kind, severity, _ in rows)
    assert [kind for kind, _, sentence in rows if sentence == "… |"] == ["| `remark`"]
