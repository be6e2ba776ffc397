"""`skelsplat calibrate`: detections in; a calibration, its error bars, and the command that refines out."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest

import calibration_files as files
import skelsplat as sk
from command_line import assert_fails, invoke, read_report, succeed
from overlay_case import write_video
from report_page import data_of, numbers
from rig_room import LATE, RIG, write_room
from skelsplat.io import read_calibration, sample, write_calibration
from skelsplat.io.detections import camera_labels
from skelsplat.io.detections._record import Record, Video, write_record
from skelsplat.run import folder
from skelsplat.run.calibrate_findings import of_calibration

SIZE = "x".join(map(str, RIG[0].size))
LAYOUT = ["--layout", "h36m17"]


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return write_room(tmp_path_factory.mktemp("room"))


def pasted(result):
    """Return the command in the last line of what was printed."""
    line = result.stdout.splitlines()[-1]
    assert line.startswith("  skelsplat refine ")
    return shlex.split(line)[1:]


def error_after(command, folder):
    """Run a printed command and return the median reprojection error."""
    command[command.index("out")] = str(folder)
    succeed(*command, "--no-html", "--write", "csv")
    return read_report(folder)["reprojection_error"]["all"]["after_px"]


def distances(rig, names):
    """Return how far cameras are apart, in mm."""
    centres = np.stack([np.asarray(rig[name].centre) for name in names])
    return np.linalg.norm(centres[:, None] - centres, axis=2)[np.triu_indices(len(names), 1)]


def test_the_sample_without_its_places(tmp_path):
    paths, out = sample.extract(tmp_path), tmp_path / "new.toml"
    given = ["calibrate", paths.detections, "-o", out, "--intrinsics", paths.calibration]
    options = [*given, "--layout", "body25b", "--stature", 1.7]  # a bystander does no harm
    result = succeed(*options)
    assert max(map(len, result.stdout.splitlines()[:-2])) <= 80  # the last have paths
    assert "%, from the stature; z is up, ± " in result.stdout
    assert f"Wrote 4 cameras to {out}, lengths in mm." in result.stdout
    assert pasted(result)[3:] == ["-o", "out", "--layout", "body25b"]
    rig, shipped = read_calibration(out), read_calibration(paths.calibration, unit="m")
    assert rig.unit == "mm"
    np.testing.assert_allclose(rig[0].K, shipped[0].K)
    ratio = distances(rig, rig.names) / (1000 * distances(shipped, rig.names))
    assert ratio.std() / ratio.mean() < 0.05
    assert_fails(invoke(*options), 1, "new.toml: output: expected no file of this name (--force replaces")
    page = tmp_path / "cameras.html"
    document = json.loads(invoke(*options, "--force", "--json", "--report", page).stdout)
    assert document["report"] == str(page)
    assert len(data_of(page.read_text())["scene"]["cameras"]) == 4
    assert document["scale"]["from"] == "stature"
    assert [one["status"] for one in document["cameras"]] == ["placed"] * 4
    assert all(one["error_px"] < 10 and one["clock_sigma_frames"] is None for one in document["cameras"])


def test_the_printed_command_makes_late_cameras_step_together(room, tmp_path):
    out = tmp_path / "Calib.toml"
    options = ["--intrinsics", room / "lenses.toml", "--clock", "--fps", 25]
    options += ["--distance", "cam1", "CAM_2", 4.0]
    result = succeed("calibrate", room / "late", "-o", out, *LAYOUT, *options)
    command = pasted(result)
    assert {*command} >= {"--fps", "25", "--frames", "union"}
    assert read_calibration(out).clocks == {"cam2": LATE}
    assert distances(read_calibration(out), ["cam1", "cam2"]) == pytest.approx(4000)
    assert error_after(command, tmp_path / "out") < 4


def test_a_useless_camera_is_left_out(room, tmp_path):
    out = tmp_path / "Calib.json"
    options = ["--intrinsics", room / "lenses.toml", "--stature", 1.7, "--fps", 25]
    page = tmp_path / "cameras.html"
    result = succeed("calibrate", room / "other", "-o", out, *LAYOUT, *options, "--report", page)
    assert "! cam4 was left out" in result.stdout
    rig = read_calibration(out)
    assert rig.names == ("cam1", "cam2", "cam3")
    ratio = distances(rig, rig.names) / distances(RIG, rig.names)
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=0.01)
    command = pasted(result)
    assert command[-2:] == ["--order", "cam1,cam2,cam3"]
    data = data_of(page.read_text())
    assert [one["name"] for one in data["scene"]["cameras"]] == ["cam1", "cam2", "cam3"]
    explained, distance, shared = (
        numbers(kind["values"], "<f4").reshape(4, 4) for kind in data["heat"]["kinds"]
    )
    others = ~np.eye(4, dtype=bool)
    assert (shared[others] > 1000).all()
    others[3] = others[:, 3] = False  # cam4, which was left out, has no epipolar lines
    np.testing.assert_array_equal(np.isfinite(explained), others)
    assert (explained[others] > 90).all()
    assert (distance[others] < 3).all()
    assert error_after(command, tmp_path / "out") < 4


@pytest.mark.parametrize("sigma", [0.0, 3.0])
def test_a_camera_that_agrees_only_at_times_is_named(room, tmp_path, sigma):
    write_calibration(tmp_path / "lenses.toml", replace(RIG, joint_sigma=sigma))
    options = [*LAYOUT, "--intrinsics", tmp_path / "lenses.toml", "--json"]
    config = tmp_path / "config.toml"
    config.write_text(f"detections = ['{room / 'mixed'}']\n")
    result = succeed("calibrate", "--config", config, "-o", tmp_path / "mixed.toml", *options)
    found = {one["kind"]: one["subject"] for one in json.loads(result.stdout)["findings"]}
    assert found["camera_disagrees"]["cameras"] == ["cam4"]
    assert ("cameras_estimated" in found) == bool(sigma)  # lenses may be no better than those cameras


@pytest.mark.parametrize("clock", [[], ["--clock", "--fps", 25]])
def test_a_camera_that_skipped_frames_is_named_with_the_frame(room, tmp_path, clock):
    given = ["-o", tmp_path / "a.toml", *LAYOUT, "--intrinsics", room / "lenses.toml", "--json"]
    document = json.loads(invoke("calibrate", room / "skipped", *given, *clock).stdout)
    found = {one["kind"]: one for one in document["findings"] if "cam2" in one["subject"]["cameras"]}
    subject = found["clock_changes"]["subject"]
    assert (subject["cameras"], abs(subject["frames"][0] - 60) <= 3) == (["cam2"], True)
    if clock:
        assert [*found] == ["clock_changes", "cameras_not_calibrated"]
        assert found["cameras_not_calibrated"]["remedy"] == [{"setting": "without", "value": "cam2"}]
    else:  # it is left out, and why is said once
        assert [*found] == ["clock_changes"]
        assert [one["status"] for one in document["cameras"]].count("left_out") == 1


@pytest.mark.parametrize("explained", [0.95, 0.7, np.nan])
@pytest.mark.parametrize("layout", ["coco17", "mediapipe33"])
def test_a_detector_of_one_person_may_follow_another_in_each_camera(explained, layout):
    report = []
    for name, share in zip(RIG.names, (0.95, 0.96, 0.95, explained), strict=True):
        status = "placed" if share > 0 else "left_out"
        report.append(sk.CalibratedCamera(name, status, 0.0, 0.1, np.nan, np.nan, 2.0, share, 1.0, np.eye(3)))
    found = sk.RigCalibration(RIG, tuple(report), 0.05, 1.0)
    told = of_calibration(found, [], True, False, [], sk.layouts.get(layout))
    expected = explained != 0.95 and layout == "mediapipe33"
    assert ("detector_of_one_person" in [one.kind for one in told]) == expected


def test_focal_lengths_and_sizes_from_what_the_folder_knows(room, tmp_path):
    pose = tmp_path / "pose"
    (room / "pose").rename(pose)
    given = ["calibrate", pose, "-o", tmp_path / "a.toml", *LAYOUT, "--same-cameras"]
    assert_fails(invoke(*given), 2, "--size: expected the width and height of the images of cam1, cam2")
    for name in RIG.names:
        write_video(tmp_path / "videos" / f"{name}.mp4", 1, RIG[0].size)
    result = succeed(*given)
    rig = read_calibration(tmp_path / "a.toml")
    assert rig[0].size == RIG[0].size
    assert rig[0].K[0, 0] == pytest.approx(RIG[0].K[0, 0], rel=0.03)
    focal = [camera.K[0, 0] for camera in rig]
    assert np.ptp(focal) < 0.012 * focal[0]  # of one make
    assert "length [px]" in result.stdout
    videos = {name: Video(f"{name}.mp4", (800, 600), 25.0) for name in RIG.names}
    write_record(pose, Record({"backend": "own"}, "h36m17", videos=videos))
    assert_fails(invoke(*given, "--force", "--size", SIZE), 2, "--size: expected none or 800x600")


def test_a_recording_that_does_not_tell_is_refused_with_what_to_film(room, tmp_path):
    out, page = tmp_path / "a.toml", tmp_path / "a.html"
    given = [*LAYOUT, "--intrinsics", room / "lenses.toml", "--report", page]
    result = invoke("calibrate", room / "still", "-o", out, *given)
    assert result.exit_code == 1, result.output
    assert "! This recording does not tell where the cameras are" in result.stdout
    assert not out.exists()
    text = page.read_text()
    assert "<dd>not written</dd>" in text
    assert "This recording does not tell where the cameras are" in text
    assert len(data_of(text)["scene"]["cameras"]) == 4
    again = ("calibrate", room / "still", "-o", out)
    assert_fails(invoke(*again, *given), 1, "a.html: report: expected no file")
    assert_fails(invoke(*again, "--report", "a.pdf"), 2, "as .html, got '.pdf'")


@pytest.mark.parametrize(
    ("detections", "options", "status", "message"),
    [
        ("one", ["--size", SIZE], 1, "one: cameras: expected at least two cameras, got 1"),
        ("nobody", ["--size", SIZE], 1, "nobody: detections: expected a person to find the cameras by, got"),
        ("short", ["--size", SIZE, "--without", "cam4"], 1, "short: detections: expected at least"),
        ("two", ["--size", SIZE], 2, "--intrinsics: expected K of both cameras, got none"),
        ("two", ["--intrinsics", "zero.toml"], 1, "zero.toml: K of camera 'cam1': expected positive focal"),
        ("two", ["--intrinsics", "lenses.toml"], 1, "none for cam3, cam4"),
        ("late", ["--size", SIZE, "--clock"], 2, "--fps: expected the frame rate to find clocks, got none"),
        ("late", ["--size", SIZE, "--order", "sorted"], 2, "--order: expected none without --intrinsics"),
        ("late", ["--intrinsics", "lenses.toml", "--same-cameras"], 2, "--same-cameras: expected none with"),
        ("late", ["--size", SIZE, "--subject", "S1"], 2, "--subject: requires --intrinsics"),
        ("late", ["--size", SIZE, "--person", "moves-most"], 2, "--person: expected largest or an entry"),
        ("late", ["--size", SIZE, "--distance", "cam1", "cam9", 2], 2, "--distance: expected a camera, one"),
    ],
)
def test_what_is_refused(room, tmp_path, monkeypatch, detections, options, status, message):
    monkeypatch.chdir(room)
    text = (room / "lenses.toml").read_text()
    (room / "zero.toml").write_text(text.replace(str(RIG[0].K[0, 0]), "0.0"))
    assert_fails(
        invoke("calibrate", detections, "-o", tmp_path / "a.toml", *LAYOUT, *options), status, message
    )
    assert not (tmp_path / "a.toml").exists()


def test_the_demo_without_its_calibration_is_compared_with_it(tmp_path, monkeypatch):
    monkeypatch.setattr(folder, "can_draw", lambda: False)
    result = succeed("demo", "--no-calibration", "-o", tmp_path / "out")
    assert "Error with the cameras found: 7." in result.stdout
    assert read_calibration(tmp_path / "out" / "input" / "Found.toml").unit == "mm"
    assert_fails(invoke("demo", "--people", "--no-calibration"), 2, "cannot be combined with --people")


def test_cameras_have_the_names_of_the_files(tmp_path):
    files.openpose_folders(tmp_path, sk.CameraRig([RIG[0], RIG[1]]), np.full((3, 2, 17, 2), 5.0))
    (tmp_path / "cam2").rename(tmp_path / "cam2_json")
    (tmp_path / "empty").mkdir()
    assert camera_labels(tmp_path) == {"cam1": "cam1", "cam2": "cam2_json"}
