"""Findings, their way through JSON and warnings, and which of them belong to single frames."""

from __future__ import annotations

import json
import re
import warnings

import numpy as np
import pytest

import findings_table
import skelsplat as sk
from command_line import READ, read_report, succeed
from skelsplat import synthetic
from skelsplat.findings import Finding, FindingWarning, Remedy, Subject, collected_warnings, remark
from skelsplat.layouts import mirror_images
from skelsplat.run import Run
from skelsplat.run.frames import rows_of

T, LAYOUT = 30, sk.layouts.H36M17
RIG = synthetic.human36m_like()


@pytest.fixture
def seen():
    """Return the detections of a walk with little noise (T, 4, 17, 3)."""
    noise, walk = synthetic.DetectionNoise(sigma_px=2.0), synthetic.motion("walk", T, seed=1)
    return synthetic.simulate_detections(walk, RIG, noise=noise, seed=2)


def problems(seen):
    """Refine frames 50, 51, … alone, with free bones; return what is said of single ones, by number."""
    config, words = sk.RefineConfig(bones="free"), {}
    result = sk.refine(None, seen, RIG, layout=LAYOUT, config=config)
    found = Run.from_arrays(result, RIG, seen, LAYOUT, frames=np.arange(50, 50 + T), config=config)
    for finding in found.frame_findings:
        for frame in finding.subject.frames:
            words.setdefault(frame, set()).add(finding.text)
    return words


def test_what_stands_out_of_a_recording_is_named(seen):
    assert problems(seen) == {}
    knee, wrist = (LAYOUT.joints.index(f"right_{name}") for name in ("knee", "wrist"))
    seen[5, 1] = seen[5, 1, mirror_images(17, LAYOUT.left_right)]
    seen[3, :, knee] = seen[3, 1:, wrist] = seen[10] = np.nan
    seen[8, 0, :, 0] += 80.0
    seen[12, ..., :2] += np.random.default_rng(0).normal(0.0, 20.0, seen[12, ..., :2].shape)
    found = problems(seen)
    assert found.keys() == {53, 55, 58, 60, 62}
    assert found[53] == {"unobserved: right_knee", "weak: right_wrist"}
    assert (found[55], found[60]) == ({"left–right swap: cam2"}, {"no detection could be used"})
    assert "many detections rejected" in found[58] - found[62]
    assert "large reprojection error" in found[62] - found[58]
    assert any(text.startswith("scatter far above normal: ") for text in found[62])


def test_a_third_rejected_is_a_problem_even_if_it_is_usual(seen):
    seen[:, 0, :, 0] += 80.0
    seen[:, 1, :9, 1] += 80.0
    found = problems(seen)
    assert sum("many detections rejected" in texts for texts in found.values()) > 0.9 * T


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
