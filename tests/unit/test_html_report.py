"""report.html as a file: what it holds, how large it is, and that no name from outside becomes markup."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest

from report_page import NASTY, data_of, numbers, report_data, sequence, shapes, text_of
from skelsplat.viz import report
from skelsplat.viz.report._scene import MISSING, MOST_POSITIONS, frames_to_show, thin_line, upright


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


def test_left_is_blue_and_right_is_vermilion(written):
    assert data_of(written())["colours"] == {"left": "#0072b2", "right": "#d55e00"}


def test_frame_numbers_may_be_time_stamps(written):
    stamps = 1_636_212_345_678 + 33 * np.arange(40)
    packed = data_of(written(report_data(replace(sequence(), frames=stamps), problems=[])))["scene"]
    np.testing.assert_array_equal(numbers(packed["frames"], "<f8"), stamps)


def test_names_from_files_are_escaped_in_markup_and_in_data(written):
    walk = sequence(joint_names=(NASTY, "left_knee", "right_knee"), start_name=NASTY)
    table = report.Table([(NASTY, NASTY)], [[NASTY]])
    data = report_data(
        walk,
        names=(NASTY, "window"),
        title=NASTY,
        facts=[(NASTY, NASTY)],
        warnings=[NASTY],
        notes=[NASTY],
        numbers=[(NASTY, NASTY, NASTY)],
        cameras=table,
        joints=table,
        lines=[report.TimeLine(NASTY, NASTY, np.zeros(40))],
        problems=[(101, 103, NASTY)],
    )
    text = written(data)
    assert "<b onclick" not in text
    assert text.count("</script>") == 3
    assert data_of(text)["scene"]["joints"][0] == data_of(text)["heat"]["cameras"][0] == NASTY
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


def test_a_thousand_frames_of_four_cameras_are_below_eight_megabytes(written):
    noise = np.random.default_rng(0).normal(0.0, 50.0, (1000, 25, 3))
    walk = sequence(1000, 25)
    moved = sequence(1000, 25, refined=walk.refined + noise, start=walk.start - noise)
    text = written(report_data(moved, names=("a", "b", "c", "d")))
    assert data_of(text)["scene"]["count"] == 1000
    assert len(text.encode()) < 6.5e6


def test_a_long_sequence_is_thinned_out_and_says_so(written):
    walk = sequence(20_000, 25)
    rejected = np.zeros(20_000)
    rejected[12_345] = 7.0
    data = report_data(
        walk,
        lines=[report.TimeLine("Rejected", "", rejected, peaks=True)],
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


def test_no_more_frames_are_kept_than_asked_for_when_all_have_a_problem():
    frames = np.arange(50_000)
    places, every = frames_to_show(frames, 25, frames.tolist())
    assert len(places) <= MOST_POSITIONS // 25
    assert every > 1
    line = np.where(frames == 49_999, 5.0, np.nan)
    assert np.nanmax(thin_line(line, places, peaks=True)) == 5.0


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
    unknown = {"errors_px": np.full((2, 3), np.nan), "rejected": np.full((2, 3), np.nan)}
    lines = [report.TimeLine("Error", "px", np.full(frames, np.nan), peaks=True)]
    text = written(report_data(walk, **unknown, lines=lines, problems=[], warnings=[]))
    packed = data_of(text)["scene"]
    assert set(numbers(packed["refined"])) == set(numbers(packed["spread"]["numbers"])) == {MISSING}
    assert "<p>None.</p>" in text


def test_a_joint_far_away_does_not_coarsen_the_others(written):
    walk = sequence(200)
    refined = walk.refined.copy()
    refined[7, 1] = 1e6
    packed = data_of(written(report_data(sequence(200, refined=refined))))["scene"]
    assert packed["grid"]["step_mm"] < 0.2
    assert (numbers(packed["refined"]).reshape(200, 3, 3)[7, 1] == MISSING).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_vertical_becomes_z_by_a_rotation_of_named_axes(axis, sign):
    up = np.zeros(3)
    up[axis] = sign
    turn, names = upright(up)
    np.testing.assert_array_equal(turn @ up, [0.0, 0.0, 1.0])
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert names[2] == ("" if sign > 0 else "−") + "xyz"[axis]
    assert sorted(name[-1] for name in names) == ["x", "y", "z"]


def test_cameras_are_drawn_in_proportion_to_the_room(written):
    near = shapes(("door", "window"))
    sizes = []
    for scale in (1.0, 2.0):
        wide = report.CameraShapes(near.names, near.centres * scale, near.corners)
        camera = data_of(written(report_data(shapes=wide)))["scene"]["cameras"][0]
        sizes.append(np.linalg.norm(np.array(camera["corners"][0]) - camera["centre"]))
    assert 1.2 < sizes[1] / sizes[0] < 2.5


def test_no_line_ends_within_an_option(written):
    text = written(report_data(warnings=["with --fps HZ, --fill-gaps N and --without cam-1; not pre--fps"]))
    options = re.findall(r'<span class="option">(.*?)</span>', text)
    assert options == ["--fps HZ", "--fill-gaps N", "--without"]
