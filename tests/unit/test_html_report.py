"""report.html as a file: what it holds, how large it is, and that no name from outside becomes markup."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest

from people_page import crowd, people_report
from report_page import JOINTS, NASTY, data_of, heat, numbers, report_data, sequence, shapes, text_of
from skelsplat.viz import report
from skelsplat.viz._body import upright
from skelsplat.viz.report._scene import MISSING, MOST_POSITIONS


@pytest.fixture
def written(tmp_path):
    """Write a report and return its text."""
    return lambda data=None: text_of(report.write_report, tmp_path, report_data() if data is None else data)


def test_positions_and_ellipsoids_come_back_to_the_stated_accuracy(written):
    walk = sequence()
    packed = data_of(written(report_data(walk)))["scene"]
    grid = packed["grid"]
    assert grid["step_mm"] < 0.2
    for name, pose in (("refined", walk.refined), ("start", walk.start)):
        found = np.array(grid["origin"]) + grid["step_mm"] * numbers(packed[name]).reshape(pose.shape)
        np.testing.assert_allclose(found, pose @ upright(walk.up)[0].T, atol=0.51 * grid["step_mm"])
    roots = packed["spread"]["step_mm"] * numbers(packed["spread"]["numbers"]).reshape(40, 3, 6)
    np.testing.assert_allclose(roots, np.broadcast_to([20.0, 0, 0, 20, 0, 20], roots.shape), atol=0.01)
    np.testing.assert_array_equal(numbers(packed["frames"], "<f8"), walk.frames)


def test_names_from_files_are_escaped_in_markup_and_in_data(written):
    walk = sequence(joint_names=(NASTY, "left_knee", "right_knee"), start_name=NASTY)
    table = report.Table(NASTY, [(NASTY, NASTY)], [[NASTY]], marks=[(NASTY, NASTY)])
    data = report_data(
        walk,
        names=(NASTY, "window"),
        title=NASTY,
        facts=[(NASTY, NASTY)],
        warnings=[(NASTY, [NASTY, "x = '<b>'"])],
        notes=[NASTY],
        numbers=[(NASTY, NASTY, NASTY)],
        tables=[table],
        lines=[report.TimeLines(NASTY, NASTY, [(NASTY, "left", np.zeros(40))])],
        problems=[(101, 103, NASTY)],
    )
    text = written(data)
    assert "<b onclick" not in text
    assert text.count("</script>") == 3
    assert data_of(text)["scene"]["joints"][0] == data_of(text)["heat"]["rows"][0] == NASTY
    assert data_of(text)["problems"] == [[101, 103, NASTY]]
    assert "<td>&lt;/script&gt;&lt;b onclick=x&gt;&quot;&#x27;&amp;" in text


def test_the_policy_allows_the_programs_of_the_page_and_no_connection(written):
    text = written()
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)[1]
    assert policy.startswith("default-src 'none'; ")
    assert not re.search(r"https?:|\*|unsafe-eval|connect-src|script-src[^;]*unsafe-inline", policy)
    for program in re.findall(r"<script>(.*?)</script>", text, re.S):
        digest = base64.b64encode(hashlib.sha256(program.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    page = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert not re.search(r"\son\w+=|\bsrc=|<link|@import|url\(", page)


def test_a_long_sequence_is_thinned_out_and_says_so(written):
    walk = sequence(20_000, 25)
    rejected = np.zeros(20_000)
    rejected[12_345] = 7.0
    data = report_data(
        walk,
        lines=[report.TimeLines("Rejected", "", [("", "left", rejected)], peaks=True)],
        problems=[(1101, 1101, "weak"), (15_003, 15_009, "weak")],
    )
    text = written(data)
    packed = data_of(text)
    shown = numbers(packed["scene"]["frames"], "<f8")
    assert len(shown) == packed["scene"]["count"] <= MOST_POSITIONS // 25
    assert {100, 1101, 15_003, 15_009} <= set(shown.tolist())
    assert numbers(packed["lines"][0]["curves"][0]["values"], "<f4").max() == 7.0
    assert f"Of 20,000 frames, the 3D view and the curves show {len(shown):,}: " in text
    assert len(text.encode()) < 8e6


@pytest.mark.parametrize("frames", [1, 3])
def test_a_sequence_without_a_single_joint_has_a_page(written, frames):
    nothing = np.full((frames, 3, 3), np.nan)
    walk = sequence(
        frames,
        refined=nothing,
        start=nothing,
        error_bar=np.full((frames, 3, 3, 3), np.nan),
        status=np.full((frames, 3), "unobserved"),
        frame_rate=None,
    )
    unknown = {"heat": heat(("door", "window"), JOINTS, np.nan)}
    lines = [report.TimeLines("Error", "px", [("", "left", np.full(frames, np.nan))], peaks=True)]
    text = written(report_data(walk, **unknown, lines=lines, problems=[], warnings=[]))
    packed = data_of(text)["scene"]
    assert set(numbers(packed["refined"])) == set(numbers(packed["spread"]["numbers"])) == {MISSING}
    assert "<p>None.</p>" in text


def about_cameras(**changes):
    """Build a report on two cameras, one of them with an ellipsoid, without poses before or problems."""
    stood = shapes(("door", "window"))
    covariances = np.stack([np.diag([400.0, 100.0, 25.0]), np.full((3, 3), np.nan)])
    walk = sequence(start=None, error_bar=np.full((40, 3, 3, 3), np.nan), floor_mm=0.0)
    given = {"shapes": replace(stood, covariances=covariances), "problems": None, "lines": [], **changes}
    return report_data(walk, heat=heat(("door", "window"), ("door", "window")), **given)


def test_ellipsoids_of_cameras_are_drawn_at_the_stated_multiple(written):
    text = written(about_cameras())
    packed = data_of(text)["scene"]
    door, window = packed["cameras"]
    # the widest, of 20 mm, as long as the pyramids of 135 mm at most
    assert "error ellipsoids of cameras, 5σ" in text
    np.testing.assert_allclose(door["root"], np.diag([100.0, 50.0, 25.0]), atol=1e-9)
    assert window["root"] is None
    assert packed["start"] is None
    assert packed["floor_mm"] == 0.0


# Several people


def test_everybody_is_in_the_scene_where_they_are_there(written):
    people = crowd()
    packed = data_of(written(people_report(people)))["scene"]
    frames = numbers(packed["frames"], "<f8")
    np.testing.assert_array_equal(frames, np.arange(100, 140))
    grid = packed["grid"]
    coded = numbers(packed["refined"]).reshape(40, 3, 3, 3)  # frames, people, joints, axes
    found = np.array(grid["origin"]) + grid["step_mm"] * coded
    for place, one in enumerate(people):
        there = np.isin(frames, one.frames)
        assert (coded[~there, place] == MISSING).all()
        np.testing.assert_allclose(found[there, place], one.refined, atol=0.51 * grid["step_mm"])


def test_findings_stand_with_their_person(written):
    text = re.sub(r"<style>.*?</style>|<script.*?</script>", "", written(people_report()), flags=re.S)
    warnings = re.search(r'<section class="loud".*?</section>', text, re.S)[0]
    assert (
        "<li>door disagrees with the other cameras. Setting: <code>without = &quot;door&quot;</code></li>"
        in warnings
    )
    assert '<p>On <a href="#on-1">person 1</a> (1): see below.</p>' in warnings
    assert "<p>None on person 0, person 2.</p>" in warnings
    own = re.search(r'<section aria-labelledby="findings-title".*?</section>', text, re.S)[0]
    assert re.findall(r'<h3 id="(on-\d)">', own) == ["on-1"]
    assert own.index('<span class="person person-1">person 1</span>') < own.index("The left leg varies.")
    assert '<th scope="row" class="person-1"><a href="person_1/report.html">person 1</a></th>' in text
    quiet = written(people_report(warnings=[], findings=[[], [], []]))
    assert '<section class="quiet"' in quiet
    assert "findings-title" not in quiet


def test_left_and_right_have_their_colours(written):
    packed = data_of(written())["scene"]
    sides = [packed["groups"][side] for side in packed["sides"]]
    assert dict(zip(packed["joints"], sides, strict=True)) == {
        "hip": "middle",
        "left_knee": "left",
        "right_knee": "right",
    }
