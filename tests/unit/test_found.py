"""What a folder holds, what is missing, and what helps."""

from __future__ import annotations

import shutil

import pytest

from command_line import succeed
from skelsplat.io import sample
from skelsplat.run.contents import kind_of
from skelsplat.run.found import look, output_of

GIVEN = {"unit": "m", "layout": "body25b", "fps": 60.0}


@pytest.fixture
def folder(tmp_path):
    """Give the recording of the package, 3 frames of it."""
    paths = sample.extract(tmp_path)
    for camera in paths.detections.iterdir():
        for path in sorted(camera.iterdir())[3:]:
            path.unlink()
    return tmp_path


def lacks(found):
    return [(lack.command or lack.setting or lack.text, lack.optional) for lack in found.lacks]


def test_what_files_do_not_state_is_asked_for_with_values(folder):
    found = look(folder, {})
    assert (found.calibration, found.detections, found.videos) == ("Calib.toml", "openpose", "")
    assert [(one.name, one.frames) for one in found.cameras] == [(f"cam0{k}", 3) for k in (1, 2, 3, 4)]
    assert lacks(found) == [("unit", False), ("layout", False), ("fps", True)]
    assert found.lacks[0].values["m"] == "m: cameras are up to 6.69 m apart"
    assert list(found.lacks[1].values) == ["body25", "body25b"]
    assert not found.ready
    found = look(folder, GIVEN)
    assert (found.ready, found.lacks, found.unit, found.layout) == (True, (), "m", "body25b")
    assert found.facts["people at once"] == "up to 2"
    assert found.names == ("cam_01", "cam_02", "cam_03", "cam_04")  # as the calibration calls them


def test_a_question_keeps_its_place_and_its_answers(folder):
    for given in ({}, {"unit": "m"}, {"layout": "body25b"}, GIVEN):
        asked = look(folder, given).asked
        assert [(one.setting, len(one.values)) for one in asked] == [("unit", 3), ("layout", 2), ("fps", 5)]
    assert [lack.value for lack in asked] == ["m", "body25b", "60"]


def test_without_a_calibration_cameras_can_be_found(folder):
    (folder / "Calib.toml").unlink()
    found = look(folder, GIVEN)
    assert lacks(found) == [("size", False), ("calibrate", False)]
    assert list(found.lacks[0].values) == [
        "1080x1920",
        "3840x2160",
        "2160x3840",
    ]  # people are lower than 1080
    assert lacks(look(folder, {**GIVEN, "size": (1088, 1920)})) == [("calibrate", False)]
    assert not found.ready


def test_a_broken_calibration_is_named_in_one_line(folder):
    (folder / "Calib.toml").write_text("[cam_01]\nmatrix = [[1, 2", encoding="utf-8")
    found = look(folder, GIVEN)
    text = next(lack.text for lack in found.lacks if not lack.setting)
    assert text.startswith("Calib.toml: ")
    assert "\n" not in text
    assert found.lacks[-1].command == "calibrate"


def test_keypoints_that_do_not_fit_the_cameras_are_an_error_in_one_line(folder):
    shutil.rmtree(folder / "openpose" / "cam04_json")
    (lack,) = look(folder, GIVEN).lacks
    assert "cam_04" in lack.text or "cam04" in lack.text


def test_videos_alone_need_a_detector(tmp_path):
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "cam01.mp4").write_bytes(b"none")
    found = look(tmp_path, {})
    assert (found.videos, lacks(found)) == ("videos", [("detect", False)])
    assert kind_of(tmp_path) == "recording"


def test_an_empty_folder_holds_nothing(tmp_path):
    found = look(tmp_path, {})
    assert found.empty
    assert kind_of(tmp_path) == ""
    (lack,) = found.lacks
    assert not lack.command
    (tmp_path / "people_simulated_good.npz").touch()
    assert "--openpose" in look(tmp_path, {}).lacks[0].text


def test_the_folder_of_a_run_is_the_output_again(run_folder):
    assert (output_of(run_folder), output_of(run_folder.parent)) == (".", "out")
    found = look(run_folder.parent, {"layout": "h36m17"})
    assert found.keypoints == () or "out" not in found.keypoints


def test_a_folder_of_several_recordings_is_none_itself(folder, tmp_path):
    top = tmp_path / "top"
    for name in ("a", "b"):
        shutil.copytree(folder / "openpose", top / name / "openpose")
    assert kind_of(top) == "recordings"
    assert kind_of(top / "a") == "recording"
    found = look(top, GIVEN)
    assert (found.inside, found.empty, found.lacks) == (("a", "b"), True, ())
    shutil.copytree(folder / "openpose", top / "openpose")  # of a recording whose parts are in folders
    assert kind_of(top) == "recording"


def test_cameras_without_keypoints_can_be_left_out(folder):
    for name in ("cam01", "cam02"):
        shutil.rmtree(folder / "openpose" / f"{name}_json")
    (lack,) = look(folder, {**GIVEN, "fps": 50.0}).lacks
    assert (lack.setting, lack.values) == ("without", {"cam_01,cam_02": "Without cam_01, cam_02"})
    assert look(folder, {**GIVEN, "fps": 50.0, "without": ("cam_01", "cam_02")}).ready


def test_folders_with_videos_each_are_several_recordings(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "cam1.mp4").write_bytes(b"none")
    assert (kind_of(tmp_path), kind_of(tmp_path / "a"), look(tmp_path, {}).inside) == ("", "", ())
    assert "one video in each of a, b" in look(tmp_path, {}).lacks[0].text  # of one camera each
    for name in ("a", "b"):
        (tmp_path / name / "cam2.mp4").write_bytes(b"none")
    assert kind_of(tmp_path) == "recordings"
    assert look(tmp_path, {}).inside == ("a", "b")


def test_folders_that_are_called_after_videos_are_of_one_recording(tmp_path):
    for name in ("annotated_videos", "synchronized_videos"):  # FreeMoCap's
        (tmp_path / name).mkdir()
        (tmp_path / name / "cam1.mp4").write_bytes(b"none")
    assert look(tmp_path, {}).videos == "synchronized_videos"


def test_a_calibration_of_several_recordings_may_be_above_them(folder, tmp_path):
    shutil.copytree(folder / "openpose", tmp_path / "top" / "a" / "pose")
    (tmp_path / "top" / "calibration").mkdir()
    shutil.copy(folder / "Calib.toml", tmp_path / "top" / "calibration")
    found = look(tmp_path / "top" / "a", GIVEN, tmp_path / "top")
    assert (found.calibration, found.ready) == ("../calibration/Calib.toml", True)
    assert look(tmp_path / "top" / "a", GIVEN).calibration == ""


@pytest.mark.parametrize(
    ("name", "more", "given", "asked"),
    [
        ("people", "--people=2 --scenes=2 --frames=4 --openpose", {"layout": "h36m17"}, "layout"),
        ("dome", "--poses=12", {"layout": "panoptic19", "order": "sorted"}, "order"),
    ],
)
def test_data_sets_of_synth_are_recordings(tmp_path, name, more, given, asked):
    succeed("synth", name, tmp_path / "set", *more.split())
    assert kind_of(tmp_path / "set") == "recordings"
    take = next((tmp_path / "set" / "takes").rglob("truth.npz")).parent
    found = look(take, {}, tmp_path)
    assert "truth.npz" not in found.keypoints
    assert lacks(found)[0] == (asked, False)
    assert look(take, given, tmp_path).ready
