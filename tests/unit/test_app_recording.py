"""From settings to commands and to Python, and back from an earlier run."""

from __future__ import annotations

import shlex
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event

import pytest

import skelsplat as sk
from skelsplat._budget import read_toml
from skelsplat._optional import pip_words
from skelsplat.app.places import Place
from skelsplat.app.recording import Recording
from skelsplat.app.recordings import Recordings
from skelsplat.cli.batch import job_of, sessions_of
from skelsplat.cli.of_found import lines_of
from skelsplat.cli.process import CANCELLED, Bar, Work
from skelsplat.cli.rows import texts_in, texts_of, typed
from skelsplat.cli.settings import OPTIONS, are_wrong, required, wrong
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Remedy
from skelsplat.run import Job
from skelsplat.run.compared import compared, findings_of, open_run
from skelsplat.run.found import Found, Lack

pytest.importorskip("nicegui")
from nicegui import Client, ui
from nicegui.page import page

from skelsplat.app.forms import Form

ROWS = OPTIONS["refine"]
GIVEN = {"unit": "m", "fps": "60", "offsets": ["cam1=-2"], "adjust_cameras": True, "write": "trc,bvh"}
WORDS = ["--unit", "m", "--offset", "cam1=-2", "--adjust-cameras", "--fps", "60", "--write", "trc,bvh"]


@pytest.fixture
def recording(tmp_path):
    (tmp_path / "walk").mkdir()
    made = Recording(Place(tmp_path.resolve()), tmp_path.resolve() / "walk")
    made.found = Found(made.folder, calibration="Calib.toml", detections="pose")
    return made


def test_settings_are_typed_as_on_the_command_line_and_read_back():
    assert typed(ROWS, GIVEN) == WORDS
    assert texts_in(ROWS, WORDS) == GIVEN
    job = job_of(["Calib.toml", "pose", "-o", "out", *WORDS])
    assert (job.fps, job.offsets, job.write) == (60.0, {"cam1": -2}, ("trc", "bvh"))
    assert texts_of(ROWS, vars(job)) == GIVEN


def test_a_command_of_a_recording(recording):
    recording.given["refine"] = dict(GIVEN)
    assert recording.words("refine") == ["refine", "Calib.toml", "pose", "-o", "out", *WORDS]
    assert recording.words("calibrate")[:4] == ["calibrate", "pose", "-o", "Calib-from-people.toml"]
    assert recording.words("calibrate")[-2:] == ["--fps", "60"]
    lines = lines_of(recording.found, recording.given, [])
    assert shlex.join(["skelsplat", *recording.words("refine")]) in lines["the commands"]
    assert "fps=60.0" in lines["the Python lines"]


def test_the_detector_that_is_installed_is_used(recording, monkeypatch):
    for installed, words in (("mediapipe", []), ("rtmlib", ["--backend", "rtmlib"])):
        monkeypatch.setattr("skelsplat.cli.of_found.find_spec", lambda name, it=installed: name == it or None)
        assert recording.words("detect")[4:] == words


def test_a_path_that_leads_out_is_refused(recording):
    recording.given["refine"] = {"init": "../../pose.npz"}
    with pytest.raises(InvalidInputError, match=r"^folder: expected one in"):
        recording.words("refine")


def test_a_remedy_that_was_cancelled_leaves_the_settings(recording, monkeypatch):
    monkeypatch.setattr(Recording, "look", lambda _: None)
    started = []
    monkeypatch.setattr(Work, "start", lambda work: started.append(work.words[0]))
    recording.given["refine"], recording.result = {"fps": "60"}, object()
    recording.try_remedy(next(row for row in ROWS if row.name == "without"), Remedy("without", "cam1"))
    assert recording.given["refine"] == {"fps": "60", "without": ["cam1"]}
    work = Work(["refine"], recording.folder)
    work.state = CANCELLED
    recording._ended(work)
    assert (recording.given["refine"], recording.before, started) == ({"fps": "60"}, None, ["refine"])


def test_a_remedy_of_several_is_compared_until_an_ordinary_run(recording, monkeypatch):
    monkeypatch.setattr(Work, "start", lambda work: work)
    monkeypatch.setattr(Recording, "running", False)
    recording.given["refine"], recording.result = {"move": ["cam1"]}, object()
    recording.try_remedy(next(row for row in ROWS if row.name == "move"), Remedy("move", ["cam2", "cam3"]))
    assert recording.words("refine")[-6:] == ["--move", "cam1", "--move", "cam2", "--move", "cam3"]
    assert recording.before[1:] == ("Move cam2, cam3", {"move": ["cam1"]})
    for command, compared_with in (("overlay", True), ("refine", False)):
        recording.start(command)
        assert (recording.before is not None) == compared_with


def test_time_is_left_of_all_cameras_and_of_what_is_new():
    bar = Bar().after("cam1", 6, 10).after("cam2", 0, 10)
    assert (bar.done, bar.total, bar.begun) == (6, 20, 6)
    later = replace(bar.after("cam1", 8, 10), since=bar.since - 4.0)  # 2 in 4 s, 12 are left
    assert later.seconds_left == pytest.approx(24.0, abs=1.0)


def test_several_recordings_are_offered_what_they_can_do_without(recording, monkeypatch):
    monkeypatch.setattr(Work, "start", lambda work: work)
    rate = Lack("no rate", setting="fps", values={"50": "50 per second"}, optional=True)
    found = replace(recording.found, keypoints=("pose",), lacks=(rate,))
    monkeypatch.setattr("skelsplat.app.recordings.look", lambda *_: found)
    recordings, top = Recordings(recording.place), recording.place.root
    for started in (False, True):
        recordings.batch(top, [recording.folder])
        assert (recordings.lacks[top].values, top in recordings.batches) == (rate.values, started)


def test_what_an_extra_adds_is_installed_with_this_python(recording):
    work = Work(pip_words("rtmlib"), recording.folder)
    assert f"{shlex.quote(sys.executable)} -m pip install" in work.command
    assert "rtmlib" in work.command


def test_nothing_is_to_be_typed_before_all_is_there(recording):
    recording.found = Found(recording.folder, detections="pose", lacks=(Lack("none", "calibrate"),))
    assert lines_of(recording.found, recording.given, []) == {}


def test_commands_are_listed_where_they_were_done_last(recording):
    refine = lines_of(recording.found, recording.given, [])["the commands"].split("\n")[-1]
    done = ["skelsplat detect", refine, f"{refine} --without cam1", refine]
    listed = lines_of(recording.found, recording.given, done)["the commands"].split("\n")
    assert listed[1:] == ["skelsplat detect", f"{refine} --without cam1", refine]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("fps", "abc", "Expected a number, got 'abc'."),
        ("fps", "-3", "Expected a positive number, got -3."),
        ("max_steps", "1.5", "Expected a whole number from 0 on, got '1.5'."),
        ("min_confidence", "2", "Expected a number from 0 to 1, got '2'."),
        ("people", "many", "Expected all or a number of at least 1, got 'many'."),
        ("offsets", ["cam1"], "Expected A=B, each A once, got 'cam1'."),
        ("fps", "29.97", ""),
        ("offsets", ["cam1=-2", "cam2=3.5"], ""),
        ("filter", "any", "Expected butterworth[:HZ[:ORDER]], got any."),
        ("filter", "butterworth:6", "Requires “Frame rate”."),
        ("fill_weak", True, "Requires “Fill gaps”."),
        ("move", ["cam1"], "Requires “Adjust cameras”."),
        ("y_up", True, "Expected one of trc, c3d, bvh, glb in “Write”, got csv."),
        ("layout", "coco17", ""),
    ],
)
def test_what_is_wrong_with_a_setting_is_one_sentence_beside_it(recording, name, text, words):
    row = next(row for row in ROWS if row.name == name)
    recording.given["refine"] = {name: text, "write": "csv"}
    assert wrong("refine", row, text, recording.given["refine"]) == words
    assert are_wrong("refine", recording.given["refine"]) == bool(words)


def test_a_setting_that_was_kept_is_shown_even_if_it_is_no_choice():
    with Client(page("")) as client:
        row = next(row for row in ROWS if row.name == "without")
        Form({"refine": {"without": ["cam_03"]}}, print, ["cam01", "cam03"]).field("refine", row)
        (field,) = (one for one in client.elements.values() if isinstance(one, ui.select))
    assert (field.value, field.options) == (["cam_03"], ["cam01", "cam03", "cam_03"])


def test_what_a_setting_requires_is_asked_for_and_its_mark_goes_when_it_is_given():
    given, rows = {"fill_weak": True}, {row.name: row for row in ROWS}
    assert required(rows["fill_weak"], True, {}) == [rows["fill_gaps"]]
    with Client(page("")) as client:
        form = Form({"refine": given}, print)
        for name in ("fill_weak", "fill_gaps"):
            form.field("refine", rows[name])
        (mark,) = (one for one in client.elements.values() if one.props.get("role") == "alert")
        (field,) = (one for one in client.elements.values() if isinstance(one, ui.input))
        assert mark.text == "Requires “Fill gaps”."
        field.value = "many"
        assert field.error == "Expected a whole number from 1 on, got 'many'."
        field.value = "5"
    assert (given, mark.text) == ({"fill_weak": True, "fill_gaps": "5"}, None)


def test_two_tabs_that_open_a_recording_look_once(recording, monkeypatch):
    looks, goes_on = [], Event()

    def slow(folder, *_):
        looks.append(folder)
        goes_on.wait(30)
        return recording.found

    monkeypatch.setattr("skelsplat.app.recording.look", slow)
    recordings = Recordings(recording.place)
    with ThreadPoolExecutor(2) as pool:
        tabs = [pool.submit(recordings.at, recording.folder) for _ in range(2)]
        goes_on.set()
    assert tabs[0].result() is tabs[1].result()
    assert looks == [recording.folder]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"people": "all", "fps": 30.0, "without": ("cam2",), "mapping": {"nose": None}},
        {"config": sk.RefineConfig.paper(max_steps=7)},
        {"config": sk.RefineConfig(bones="free")},
    ],
)
def test_the_lines_of_python_make_the_same_job(options):
    job = Job("Calib.toml", "pose", unit="m", output="out", **options)
    call = job.python.partition("found = ")[2].partition("\n")[0]
    made = eval(call.partition("(")[2][:-1], {"Job": Job, "sk": sk})
    assert call.startswith("run_people(" if job.people else "run(")
    assert replace(made, config=None) == replace(job, config=None)
    assert made.settings == job.settings


def test_a_file_of_sessions_has_what_all_share(tmp_path):
    path = tmp_path / "sessions.toml"
    found = Found(tmp_path / 'a "b"', calibration="Calib.toml", detections="pose")
    path.write_text(sessions_of(tmp_path, [found], GIVEN), encoding="utf-8")
    document = read_toml(path)
    assert document["defaults"]["adjust-cameras"] is True
    assert document["defaults"]["offset"] == ["cam1=-2"]
    assert document["session"][0]["detections"] == 'a "b"/pose'


def test_an_earlier_run_gives_its_settings_and_is_compared(run_folder):
    made = Recording(Place(run_folder.parent.resolve()), run_folder.parent.resolve()).look()
    assert made.given["refine"] == {"unit": "mm", "layout": "h36m17", "fps": "50", "write": "csv"}
    earlier = open_run(run_folder)
    assert earlier is not None
    assert findings_of(earlier) == [("", one) for one in earlier.findings]
    rows = {name: (before, after) for name, before, after in compared(earlier, earlier)}
    assert all(before == after for before, after in rows.values())
    assert {"warnings", "median reprojection error"} <= {*rows}
    assert open_run(run_folder.parent) is None
