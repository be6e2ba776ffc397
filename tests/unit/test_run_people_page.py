"""Page and picture of everybody in a run of several people."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from skelsplat import synthetic
from skelsplat.io import write_calibration
from skelsplat.run import Job, PeopleRun, run_people
from skelsplat.run.figures import tracks_of
from two_people import LAYOUT, crossing, seen, shuffled

pytestmark = pytest.mark.drawn

RIG = synthetic.human36m_like()
FRAMES = 40
HIDDEN = slice(10, 20)  # frames in which the first camera sees nobody


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the folder of a run of two people; not to be written to."""
    folder = tmp_path_factory.mktemp("two")
    people = shuffled(seen(crossing(FRAMES), RIG))
    people[HIDDEN, 0] = np.nan
    write_calibration(folder / "Calib.toml", RIG)
    names = {"camera_names": np.array(RIG.names), "joint_names": np.array(LAYOUT.joints)}
    np.savez(folder / "take.npz", detections=people, **names)
    given = {"unit": "mm", "layout": LAYOUT.name, "fps": 50, "people": "all", "output": folder / "out"}
    run_people(Job(folder / "Calib.toml", folder / "take.npz", **given))
    return folder / "out"


@pytest.fixture(scope="module")
def text(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def rows(text, section):
    """Return the cells of the first table of a section."""
    table = re.search(rf'aria-labelledby="{section}".*?<tbody>(.*?)</tbody>', text, re.S)[1]
    return [re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>.*?</tr>", table)]


def test_the_table_has_a_row_per_person_with_a_link_to_their_page(folder, text):
    first, second = rows(text, "table-people")
    assert first[:4] == ['<a href="person_0/report.html">person 0</a>', "0–39", "40", "4"]
    assert second[0] == '<a href="person_1/report.html">person 1</a>'
    for link in re.findall(r'<a href="(person_\d/.*?)"', text):
        assert (folder / link).is_file()


def test_the_page_counts_as_the_report_does(folder, text):
    report = json.loads((folder / "report.json").read_text())
    detected = sum(camera["detected"] for camera in report["detections"]["cameras"])
    assert f"of {detected:,} in all views, to the people above" in text
    assert "<h1>SkelSplat: take.npz, 2 people</h1>" in text
    errors = [f"→ {entry['median_error_px']:.1f}" for entry in report["people"]]
    assert [row[4].split(" → ")[1] for row in rows(text, "table-people")] == [error[2:] for error in errors]


def test_tracks_are_in_mm_and_know_who_sees_whom(folder):
    found = PeopleRun.open(folder)
    for track, one in zip(tracks_of(found), found.people.values(), strict=True):
        np.testing.assert_array_equal(track.refined, one.poses.pose)
        assert not track.seen[HIDDEN, 0].any()
        assert track.seen[:10].all(axis=1).mean() > 0.8
        assert track.middle[:, 2].min() > 500.0
        np.testing.assert_array_equal(track.frames, np.arange(FRAMES))
    assert (folder / "overview.png").read_bytes().startswith(b"\x89PNG")
