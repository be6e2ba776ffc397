"""``skelsplat live --people``: several people, who is who included; nothing that is sent stays unanswered."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.io import read_calibration, write_calibration
from skelsplat.synthetic import Crowding, DetectionNoise

FPS = 30
OPTIONS = ["--unit", "mm", "--layout", "h36m17", "--fps", str(FPS), "--people", "all"]
RING = synthetic.ring(4, radius_mm=4500.0)


@pytest.fixture(scope="module")
def scene():
    noise = DetectionNoise.recording(FPS)
    return synthetic.simulate_scene(2, RING, n_frames=30, fps=FPS, noise=noise, crowding=Crowding(), seed=4)


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "Calib.toml"
    write_calibration(path, RING)
    return path


@pytest.fixture
def names(calibration):
    return read_calibration(calibration, unit="mm").names


def views_of(frame):
    """Return one frame (M, P, N, 3) as lists of the people who are there, null for a missing joint."""
    there = np.isfinite(frame[..., :2]).all(axis=-1).any(axis=-1)
    plain = np.where(np.isfinite(frame), frame, None)
    return [view[seen].tolist() for view, seen in zip(plain, there, strict=True)]


def line(frame, views, **more):
    return json.dumps({"frame": frame, "detections": views, **more})


def lines_of(scene):
    return [line(t, views_of(frame)) for t, frame in enumerate(scene.people)]


def run(calibration, *lines, options=("-q",)):
    arguments = ["live", str(calibration), *OPTIONS, *options]
    result = CliRunner().invoke(app, arguments, input="\n".join(lines) + "\n")
    assert result.exit_code == 0, result.output
    return [json.loads(text, parse_constant=pytest.fail) for text in result.stdout.splitlines()]


def ids(answer):
    return [person["id"] for person in answer["people"]]


def without_latency(answers):
    return [{key: value for key, value in answer.items() if key != "latency_ms"} for answer in answers]


def test_the_answers_are_those_of_a_tracker(calibration, scene, names):
    answers = run(calibration, *lines_of(scene))
    rig = read_calibration(calibration, unit="mm")
    tracker = sk.Tracker(rig, layout="h36m17", fps=FPS)
    assert len(answers) == len(scene.people)
    for t, (frame, answer) in enumerate(zip(scene.people, answers, strict=True)):
        lists = [np.array(view, dtype=float).reshape(-1, 17, 3) for view in views_of(frame)]
        expected = tracker.step(lists)
        assert answer.keys() == {"frame", "people", "ended", "unassigned", "latency_ms"}
        assert (answer["frame"], answer["ended"]) == (t, [])
        assert ids(answer) == [person.id for person in expected]
        assigned = [set() for _ in rig]
        for record, person in zip(answer["people"], expected, strict=True):
            assert record["pose"] == person.refinement.pose.tolist()
            assert record["joint_status"] == person.refinement.joint_status.tolist()
            bar = np.sqrt(np.diagonal(person.refinement.error_bar, axis1=1, axis2=2))
            assert record["error_bar"] == bar.tolist()
            for i, name in enumerate(names):
                slots = [s for s in (person.slots[i], person.more_slots[i]) if s >= 0]
                assigned[i] |= set(slots)
                assert (name in record["views"]) == bool(slots)
                if slots:
                    view, weights = record["views"][name], person.refinement.view_weights[i]
                    assert view["detections"] == slots
                    assert view["weight"] == pytest.approx(np.nanmean(weights), abs=1e-3)
                    assert view["rejected"] == np.flatnonzero(weights < 0.25).tolist()
        left = {name: sorted({*range(len(lists[i]))} - assigned[i]) for i, name in enumerate(names)}
        assert answer["unassigned"] == {name: free for name, free in left.items() if free}
    assert ids(answers[-1]) == [0, 1]
    assert any(view["rejected"] for a in answers for p in a["people"] for view in p["views"].values())


def test_people_alone_are_the_same(calibration, names):
    one = synthetic.simulate_scene(1, RING, n_frames=20, fps=FPS, crowding=Crowding.none(), seed=4)
    listed = [views_of(frame) for frame in one.people]
    alone = [[view[0] if view else None for view in views] for views in listed]
    forms = [run(calibration, *(line(0, views) for views in form)) for form in (listed, alone)]
    assert without_latency(forms[0]) == without_latency(forms[1])
    assert ids(forms[0][-1]) == [0]
    assert forms[0][-1]["people"][0]["views"][names[0]]["detections"] == [0]


def test_whoever_is_gone_ends_once(calibration, scene):
    empty = [line("gone", [[]] * 4)] * (7 * FPS)
    answers = run(calibration, *lines_of(scene), *empty, *lines_of(scene))
    gone = [answer for answer in answers if answer["frame"] == "gone"]
    assert ids(gone[0]) == [0, 1], "bridged at first"
    assert ids(gone[FPS]) == []
    assert sorted(number for answer in answers for number in answer["ended"]) == [0, 1]
    ended = next(t for t, answer in enumerate(gone) if answer["ended"])
    assert 4 * FPS < ended < 7 * FPS
    assert ids(answers[-1]) == [2, 3]


def test_a_reset_ends_everybody(calibration, scene):
    again = line("again", views_of(scene.people[0]), reset=True)
    answers = run(calibration, *lines_of(scene), again, *lines_of(scene)[1:])
    reset = len(scene.people)
    assert answers[reset]["ended"] == [0, 1]
    assert [answer["ended"] for answer in answers[reset + 1 :]] == [[]] * (reset - 1)
    assert ids(answers[-1]) == [2, 3]


@pytest.mark.parametrize(
    "views",
    [
        [[]] * 4,
        {},
        [[[None] * 17] * 2] * 4,
        [[[[0, 0, 0]] * 17]] * 4,
        [[[float("nan")] * 3] * 17] * 4,
        [[[None, None, 0.0]] * 17, [[None] * 3] * 17, [], None],
    ],
)
def test_nobody_there(calibration, views):
    (answer,) = run(calibration, line(0, views))
    assert without_latency([answer]) == [{"frame": 0, "people": [], "ended": [], "unassigned": {}}]


def test_everything_malformed_is_answered_and_changes_nothing(calibration, scene, names):
    good = lines_of(scene)
    person = scene.people[0, 0, 0].tolist()

    def views(first):
        return line("wrong", [first, [], [], []])

    malformed = {
        views(5): "detections[0]: ",
        views([[]]): "detections[0][0]: ",
        views([person, person[:16]]): "detections[0][1]: ",
        views([person, 7]): "detections[0][1]: ",
        views([person, [*person[:16], ["a", 1, 1]]]): "detections[0][1][16]: ",
        views([person, [*person[:16], [1, 2, 50000]]]): "detections[0][1][16][2]: ",
        line("wrong", {names[1]: [person[:3]]}): f'detections["{names[1]}"][0]: ',
        line("wrong", [[[*person[:16], [1, 2, -1]]], [], [], []], reset=True): "detections[0][0][16][2]: ",
    }
    mixed = [*good[:15], *malformed, *good[15:]]
    answers = run(calibration, *mixed)
    wrong = answers[15 : 15 + len(malformed)]
    for number, (error, place) in enumerate(zip(wrong, malformed.values(), strict=True), start=16):
        assert (error["frame"], error["line"]) == ("wrong", number)
        assert error["error"].startswith(place)
    right = answers[:15] + answers[15 + len(malformed) :]
    assert without_latency(right) == without_latency(run(calibration, *good))
