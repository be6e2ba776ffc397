"""What a folder holds, what is missing, and what helps."""

from __future__ import annotations

import shutil

import pytest

from skelsplat.io import sample
from skelsplat.run.found import holds_recording, look, output_of

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


def test_without_a_calibration_cameras_can_be_found(folder):
    (folder / "Calib.toml").unlink()
    found = look(folder, GIVEN)
    assert lacks(found) == [("image_size", False), ("calibrate", False)]
    assert lacks(look(folder, {**GIVEN, "image_size": "1088x1920"})) == [("calibrate", False)]
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
    assert found.videos == "videos"
    assert lacks(found) == [("detect", False)]
    assert holds_recording(tmp_path)


def test_an_empty_folder_holds_nothing(tmp_path):
    found = look(tmp_path, {})
    assert found.empty
    assert not holds_recording(tmp_path)
    (lack,) = found.lacks
    assert not lack.command


def test_the_folder_of_a_run_is_the_output_again(run_folder):
    assert output_of(run_folder) == "."
    assert output_of(run_folder.parent) == "out"
    found = look(run_folder.parent, {"layout": "h36m17"})
    assert found.keypoints == () or "out" not in found.keypoints
