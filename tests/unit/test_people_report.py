"""The page of several people as a file: what it holds of whom, its size, and that no name becomes markup."""

from __future__ import annotations

import re

import numpy as np
import pytest

from colour_vision import DEFICIENCIES, closest
from people_page import CAMERAS, crowd, nobody, people_report, person
from report_page import NASTY, data_of, numbers, text_of
from skelsplat.viz import _style, report
from skelsplat.viz.report._people import with_gaps
from skelsplat.viz.report._scene import MISSING, MOST_POSITIONS


@pytest.fixture
def written(tmp_path):
    """Write a page and return its text."""
    return lambda data=None: text_of(
        report.write_people_report, tmp_path, people_report() if data is None else data
    )


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


def test_limbs_and_joints_have_the_colour_of_their_person(written):
    packed = data_of(written())["scene"]
    assert packed["groups"] == ["person-0", "person-1", "person-2"]
    assert packed["sides"] == [0] * 3 + [1] * 3 + [2] * 3
    assert packed["limbs"] == [[3 * k + a, 3 * k + b, k] for k in range(3) for a, b in ((0, 1), (0, 2))]
    assert [(one["from"], one["to"]) for one in packed["people"]] == [(0, 3), (3, 6), (6, 9)]
    assert packed["joints"][4] == "person 1, left_knee"


def test_the_style_has_the_colours_of_the_pictures(written):
    text = written()
    for place, colour in enumerate(_style.PEOPLE):
        assert re.findall(rf"--person-{place}: (#\w+);", text)[0] == colour


def test_colours_of_people_differ_for_everyone_on_dark_paper_too(written):
    dark = [re.findall(rf"--person-{place}: (#\w+);", written())[1] for place in range(len(_style.PEOPLE))]
    for seen in DEFICIENCIES.values():
        assert closest(dark, seen) > 15


def test_the_bars_count_the_views_of_each_frame(written):
    seen = np.ones((40, 2), dtype=bool)
    seen[5:9, 0], seen[7, 1] = False, False
    late = person("person 1", range(110, 150))
    bars = data_of(written(people_report([person(seen=seen), late], bones=report.Table([], []))))["bars"]
    assert bars["views"] == 2
    first, second = (numbers(one["views"]).tolist() for one in bars["people"])
    assert first == [2] * 5 + [1, 1, 0, 1] + [2] * 31 + [-1] * 10
    assert second == [-1] * 10 + [2] * 40


def test_curves_have_a_value_per_person(written):
    lines = data_of(written())["lines"]
    assert [line["title"] for line in lines][:2] == ["Median reprojection error", "Detections rejected"]
    for line in lines:
        assert [curve["colour"] for curve in line["curves"]] == ["person-0", "person-1", "person-2"]
    rejected = numbers(lines[1]["curves"][1]["values"], "<f4")
    np.testing.assert_allclose(rejected[10:], 10.0)
    assert np.isnan(rejected[:10]).all()
    apart = numbers(lines[2]["curves"][0]["values"], "<f4")
    np.testing.assert_allclose(apart[0], 1.6, atol=1e-6)  # only the third is there, 1600 mm away
    assert not any(
        "Distance" in line["title"] for line in data_of(written(people_report([person()])))["lines"]
    )


def test_findings_stand_with_their_person(written):
    text = re.sub(r"<style>.*?</style>|<script.*?</script>", "", written(), flags=re.S)
    warnings = re.search(r'<section class="loud".*?</section>', text, re.S)[0]
    assert "<li>door disagrees with the other cameras.</li>" in warnings
    assert '<p>On <a href="#on-1">person 1</a> (1): see below.</p>' in warnings
    assert "<p>None on person 0, person 2.</p>" in warnings
    own = re.search(r'<section aria-labelledby="findings-title".*?</section>', text, re.S)[0]
    assert re.findall(r'<h3 id="(on-\d)">', own) == ["on-1"]
    assert own.index('<span class="person person-1">person 1</span>') < own.index("The left leg varies.")
    assert '<th scope="row" class="person-1"><a href="person_1/report.html">person 1</a></th>' in text
    quiet = written(people_report(warnings=[], findings=[[], [], []]))
    assert '<section class="quiet"' in quiet
    assert "findings-title" not in quiet


def test_names_are_escaped_in_markup_and_in_data(written):
    people = [person(NASTY), person("person 1")]
    table = report.Table([(NASTY, NASTY)], [[NASTY], [NASTY]], marks=[(NASTY, NASTY), ("", "")])
    data = people_report(
        people,
        names=(NASTY, "window"),
        title=NASTY,
        facts=[(NASTY, NASTY)],
        warnings=[NASTY],
        notes=[NASTY],
        numbers=[(NASTY, NASTY, NASTY)],
        findings=[[NASTY], []],
        table=table,
        bones=table,
        joint_names=(NASTY, "left_knee", "right_knee"),
        start_name=NASTY,
        problems=[(101, 103, NASTY)],
    )
    text = written(data)
    assert "<b onclick" not in text
    assert text.count("</script>") == 3
    assert data_of(text)["scene"]["people"][0]["name"] == data_of(text)["bars"]["people"][0]["name"] == NASTY


def test_all_people_together_keep_to_the_limit_of_positions(written):
    frames, joints = 10_000, 25
    pose = np.zeros((frames, joints, 3)) + np.arange(frames)[:, None, None] / 10
    people = [
        person(
            f"person {k}",
            range(frames),
            start=pose,
            refined=pose + 500.0 * k,
            error_bar=np.broadcast_to(400.0 * np.eye(3), (frames, joints, 3, 3)),
            status=np.full((frames, joints), "ok"),
        )
        for k in range(6)
    ]
    names = [f"j{k}" for k in range(joints)]
    text = written(people_report(people, joint_names=names, bones=report.Table([], []), problems=[]))
    count = data_of(text)["scene"]["count"]
    assert count * 6 * joints <= MOST_POSITIONS
    assert f"Of 10,000 frames, the 3D view and the curves show {count:,}: " in text
    assert "Tables cover all frames." in text
    assert len(text.encode()) < 8e6


def test_the_ends_of_gaps_are_frames_in_which_nobody_is_there(written):
    assert with_gaps(np.array([3, 4, 5, 9, 10])).tolist() == [3, 4, 5, 6, 8, 9, 10]
    assert with_gaps(np.array([0, 10, 20, 40])).tolist() == [0, 10, 20, 30, 40]
    assert with_gaps(np.array([7])).tolist() == [7]
    page = data_of(written(people_report([person(frames=[0, 1, 2, 50, 51])], bones=report.Table([], []))))
    assert numbers(page["bars"]["people"][0]["views"]).tolist() == [2, 2, 2, -1, -1, 2, 2]


def test_a_person_far_from_the_others_is_drawn(written):
    people = [person(), person("person 1", range(100, 101), at=(9000.0, 0.0))]  # in one frame of 40
    packed = data_of(written(people_report(people, bones=report.Table([], []))))["scene"]
    coded = numbers(packed["refined"]).reshape(40, 2, 3, 3)
    assert (coded[0, 1] != MISSING).all()
    assert packed["reach"][1][0] == pytest.approx(9000.0)


@pytest.mark.parametrize("people", [[nobody()], [person(), nobody()], [person(frames=[7])]])
def test_people_of_whom_little_is_known_have_a_page(written, people):
    text = written(people_report(people, bones=report.Table([], []), problems=[]))
    assert len(data_of(text)["bars"]["people"]) == len(people)
    assert 'id="bones-title"' not in re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert len(CAMERAS) == data_of(text)["bars"]["views"]


def test_the_floor_is_that_of_people_whom_three_views_see_or_the_most(written):
    def floor(*views):
        people = [
            person(refined=person().refined - [0, 0, 300 * k], seen=np.arange(4) < np.full((40, 1), count))
            for k, count in enumerate(views)
        ]
        return data_of(written(people_report(people)))["scene"]["floor_mm"]

    assert floor(4, 3, 2) == pytest.approx(150.0)
    assert floor(2, 1) == pytest.approx(450.0)
    assert floor(0, 0) == pytest.approx(150.0)
