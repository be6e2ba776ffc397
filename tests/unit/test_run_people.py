"""``refine --people``: everybody into a folder of their own, and all of them into one file."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, RESULTS, assert_fails, invoke, read_report, succeed
from detection_cases import CASES
from detection_files import Take
from skelsplat import synthetic
from skelsplat.io import write_calibration
from skelsplat.run import Job, PeopleRun, Run, run, run_batch, run_people
from skelsplat.run.figures import tracks_of
from two_people import LAYOUT, crossing, seen, shuffled

RIG = synthetic.human36m_like()
FPS = 50
FRAMES = 40


@pytest.fixture(scope="module")
def people():
    return shuffled(seen(crossing(FRAMES), RIG))


@pytest.fixture(scope="module")
def recording(people, tmp_path_factory):
    """Return a folder with the calibration and OpenPose's files of two people."""
    return written(tmp_path_factory.mktemp("two"), people)


def written(folder, people):
    """Write a calibration, and people (T, M, P, 17, 3) as OpenPose's files."""
    write_calibration(folder / "Calib.toml", RIG)
    (folder / "openpose").mkdir()
    CASES["openpose"].write(folder / "openpose", Take(people, list(RIG.names), list(LAYOUT.joints)))
    return folder


def job(folder, detections="openpose", **options):
    given = {"unit": "mm", "layout": LAYOUT.name, "fps": FPS, "people": "all"} | options
    return Job(folder / "Calib.toml", folder / detections, **given)


@pytest.fixture(scope="module")
def found(recording):
    return run_people(job(recording))


@pytest.fixture(scope="module")
def folder(recording, tmp_path_factory):
    """Return the folder that the command wrote; not to be written to."""
    out = tmp_path_factory.mktemp("run") / "out"
    succeed(*command(recording, out), "--people", "all", "--write", "csv,json,nc")
    return out


def command(recording, out):
    return ["refine", recording / "Calib.toml", recording / "openpose", "-o", out, *READ, "--fps", FPS]


def test_everybody_is_refined_as_alone(people, found):
    rig = next(iter(found.people.values())).cameras  # as read from the file
    everybody = sk.track(people, rig, fps=FPS, layout=LAYOUT)
    assert list(found.people) == [person.id for person in everybody] == [0, 1]
    for person, alone in zip(everybody, found.people.values(), strict=True):
        np.testing.assert_array_equal(alone.result.pose, person.refinement.pose)
        np.testing.assert_array_equal(alone.detections, person.detections(people))
        np.testing.assert_array_equal(alone.frames, person.frames)
    assert len(found.frames) == FRAMES


def test_each_folder_is_that_of_a_run(folder, found):
    together = {"people.csv", "people.json", "people.nc", "overview.png", "report.html", "report.json"}
    names = together | {"person_0", "person_1"}
    assert {path.name for path in folder.iterdir()} == names
    for identity, alone in found.people.items():
        own = folder / f"person_{identity}"
        assert {path.name for path in own.iterdir()} == RESULTS - {"pose.trc"} | {"pose.json", "pose.nc"}
        read = Run.open(own)
        np.testing.assert_array_equal(read.poses.pose, alone.poses.pose)
        assert read.report["input"]["person"] == str(identity)
    again = PeopleRun.open(folder)
    assert list(again.people) == [0, 1]
    assert again.report == json.loads((folder / "report.json").read_text())


def test_the_report_says_who_is_there_when(folder):
    report = read_report(folder)
    assert report["input"]["people"] == "all"
    assert report["folders"] == ["person_0", "person_1"]
    for identity, entry in enumerate(report["people"]):
        assert (entry["id"], entry["folder"]) == (identity, f"person_{identity}")
        assert entry["seen"] == [[0, FRAMES - 1]]
        assert entry["views_median"] == 4
        assert entry["findings"] == read_report(folder / entry["folder"])["findings"]
    for camera in report["detections"]["cameras"]:
        assert camera["detected"] == camera["assigned"] == 2 * FRAMES


def test_the_page_has_a_row_per_person_with_a_link_to_their_page(folder):
    text, report = (folder / "report.html").read_text(encoding="utf-8"), read_report(folder)
    assert "<h1>SkelSplat: openpose, 2 people</h1>" in text
    assert f"of {4 * 2 * FRAMES:,} in all views, to the people above" in text
    table = re.search(r'aria-labelledby="table-people".*?<tbody>(.*?)</tbody>', text, re.S)[1]
    for identity, row in enumerate(re.findall(r"<tr>.*?</tr>", table)):
        name, when, frames, views, error, *_ = re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row)
        assert name == f'<a href="person_{identity}/report.html">person {identity}</a>'
        assert (when, frames, views) == (f"0–{FRAMES - 1}", f"{FRAMES}", "4")
        assert error.endswith(f"→ {report['people'][identity]['median_error_px']:.1f}")
    for link in re.findall(r'<a href="(person_\d/.*?)"', text):
        assert (folder / link).is_file()


@pytest.mark.drawn
def test_the_picture_knows_who_sees_whom(found, tmp_path):
    for track, one in zip(tracks_of(found), found.people.values(), strict=True):
        np.testing.assert_array_equal(track.refined, one.poses.pose)  # mm
        np.testing.assert_array_equal(track.seen, np.isfinite(one.detections[..., 0]).any(axis=2))
    found.write(tmp_path / "out", (), html=False)
    assert (tmp_path / "out" / "overview.png").read_bytes().startswith(b"\x89PNG")


def test_people_are_in_one_file(folder, found):
    with (folder / "people.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 2 * FRAMES * 17
    assert {row["person"] for row in rows} == {"0", "1"}
    pose = found.people[1].poses.pose
    own = [float(row["x"]) for row in rows if row["person"] == "1"]
    np.testing.assert_array_equal(own, pose[..., 0].ravel())
    document = json.loads((folder / "people.json").read_text())
    assert document["format"] == "skelsplat-people"
    assert [one["person"] for one in document["people"]] == [0, 1]
    with pytest.importorskip("xarray").open_dataset(folder / "people.nc", engine="h5netcdf") as dataset:
        assert dataset["individuals"].values.tolist() == ["person_0", "person_1"]
    np.testing.assert_array_equal([frame["pose"] for frame in document["people"][1]["frames"]], pose)


def test_of_a_run_of_several_one_is_converted_or_plotted(folder, tmp_path):
    parts = "one person", "(person_0, person_1)", f"for example {folder / 'person_0'}"
    assert_fails(invoke("convert", folder, tmp_path / "walk.trc"), 1, *parts)
    assert_fails(invoke("plot", folder), 1, parts[0])
    assert invoke("convert", folder / "person_1", tmp_path / "walk.trc").exit_code == 0


def test_notes_on_a_persons_files_name_the_person(recording, tmp_path, monkeypatch):
    monkeypatch.setattr("skelsplat.run.folder.can_draw", lambda: False)
    told = []
    run_people(job(recording, output=tmp_path, angles=True), tell=told.append)
    assert [one.sentence[:9] for one in told if one.kind == "no_strides"] == ["person 0:", "person 1:"]


def test_a_later_run_removes_what_an_earlier_one_wrote(recording, tmp_path):
    out = tmp_path / "out"
    several = run_people(job(recording))
    several.write(out, ("csv", "json"), html=False)
    (out / "person_1" / "notes.txt").write_text("mine")
    (out / "person_7").mkdir()
    run_people(job(recording, people=1, output=out, write=("trc",), html=False))
    names = {"person_0", "person_1", "person_7", "overview.png", "report.json"}
    assert {path.name for path in out.iterdir()} == names
    assert [path.name for path in (out / "person_1").iterdir()] == ["notes.txt"]
    assert not (out / "person_0" / "pose.csv").exists()
    later = run(job(recording, people=None, output=out, html=False))
    (gone,) = (one for one in later.findings if one.kind == "earlier_removed")
    assert gone.subject.files == ("person_0",)
    assert {path.name for path in out.iterdir()} == RESULTS - {"report.html"} | {"person_1", "person_7"}
    several.write(out, (), html=False)
    names = {"person_0", "person_1", "person_7", "overview.png", "report.json"}
    assert {path.name for path in out.iterdir()} == names


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--people", "some"], ["--people: expected all or a number of at least 1, got 'some'"]),
        (["--people", "0"], ["--people: expected all or a number of at least 1, got '0'"]),
        (["--people", "all", "--person", "1"], ["--person: cannot be combined with --people"]),
        (["--person", "entry:5"], ["--person: expected less than 2 (no file has more people), got entry:5"]),
        (["--person", "5"], ["--person: expected one of 0, 1 (the people found), got 5"]),
        (["--person", "cam9:3,4"], ["--person: expected a camera, one of", "got 'cam9'"]),
        (
            ["--person", "cam1:2,2"],
            ["--person: expected a point on a person in frame 0", ", the nearest, at "],
        ),
    ],
)
def test_a_wrong_choice_is_named(recording, tmp_path, options, parts):
    assert_fails(invoke(*command(recording, tmp_path / "out"), *options), 2, *parts)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [["--people", "all"], ["--person", "moves-most"], ["--person", 0]])
def test_the_frame_rate_has_to_be_known(recording, tmp_path, options):
    arguments = [argument for argument in command(recording, tmp_path) if argument not in ("--fps", FPS)]
    text = "--fps: expected the frame rate, which following people over time needs"
    assert_fails(invoke(*arguments, *options), 2, text)


def test_one_person_is_the_same_as_among_all(recording, found):
    one = run(job(recording, people=None, person=1))
    np.testing.assert_array_equal(one.poses.pose, found.people[1].poses.pose)
    np.testing.assert_array_equal(one.poses.uncertainty, found.people[1].poses.uncertainty)
    assert one.report["input"]["person"] == "1"


def test_in_the_table_of_a_batch_everybody_has_a_row(recording, tmp_path):
    rows = run_batch({"walk": job(recording, write=(), html=False)}, tmp_path).rows()
    shown = [(row["recording"], row["person"], row["frames"], row["frame_rate_hz"]) for row in rows]
    assert shown == [("walk", identity, FRAMES, FPS) for identity in (0, 1)]


@pytest.mark.parametrize("views", [(1, 2), (1, 1)])
def test_one_finding_on_the_rig_sums_up_all_people(views, tmp_path):
    people = seen(crossing(FRAMES), RIG)
    for person, view in enumerate(views):
        people[:, view, person, :, 0] += 15.0
    found = run_people(job(written(tmp_path, people)))
    (rig,) = (one for one in found.findings if one.kind == "cameras_over_people")
    assert rig.numbers["contradict"] == (views[0] != views[1])
    assert {*rig.subject.cameras} == {RIG.names[view] for view in views}
