"""CMU Panoptic: both layouts come back as written, and what does not fit is refused by name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from skelsplat import DatasetError, InvalidInputError, datasets
from writers import panoptic

SEQUENCE = panoptic.SEQUENCES[0]


@pytest.fixture
def toolbox(tmp_path):
    return tmp_path, panoptic.write(tmp_path)


def edit_json(path: Path, change) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def edit_npz(path: Path, **changes) -> None:
    with np.load(path) as archive:
        arrays = dict(archive) | changes
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})


def body(root: Path, frame: int = panoptic.FIRST_FRAME + 1) -> Path:
    return root / SEQUENCE / "hdPose3d_stage1_coco19" / f"body3DScene_{frame:08d}.json"


@pytest.mark.parametrize("views", [4, 8])
@pytest.mark.parametrize("per_camera", [False, True])
def test_the_toolbox_layout_comes_back(tmp_path, views, per_camera):
    written = panoptic.write(tmp_path, per_camera=per_camera)
    data = datasets.read("panoptic", tmp_path, views=views)
    assert (data.layout.name, data.detector, len(data)) == ("panoptic19", "metrabs", 2)
    for take, name in zip(data, panoptic.SEQUENCES, strict=True):
        assert take.rig.names == tuple(f"00_{number:02d}" for number in panoptic.HD[:views])
        assert take.rig.unit == "mm"
        assert take.frames.tolist() == written.frames[1:].tolist(), "the frame without a body is left out"
        np.testing.assert_allclose(take.truth, written.truth[name][1:], atol=1e-9)
        np.testing.assert_array_equal(take.detections[..., :2], written.detections[name][1:, :views, :, :2])
        np.testing.assert_allclose(take.rig[0].distortion, panoptic.LENS)


@pytest.mark.parametrize("per_camera", [False, True])
def test_the_authors_layout_comes_back(tmp_path, per_camera):
    written = panoptic.write(tmp_path, layout="skelsplat", per_camera=per_camera)
    for take, name in zip(datasets.read("panoptic", tmp_path), panoptic.SEQUENCES, strict=True):
        np.testing.assert_allclose(take.truth, written.truth[name], atol=1e-9)
        np.testing.assert_array_equal(take.detections[..., :2], written.detections[name][:, :4, :, :2])


def test_the_initial_guess_comes_with_the_detections(tmp_path):
    written = panoptic.write(tmp_path, layout="skelsplat")
    path = tmp_path / "2d_metrabs" / "S0" / SEQUENCE / "poses_filtered_4.npz"
    pixels = written.detections[SEQUENCE][:, :4].copy()
    pixels[1, 2] = np.nan
    edit_npz(path, poses2d=pixels)
    take = datasets.read("panoptic", tmp_path, monocular="metrabs").takes[0]
    assert take.monocular.shape == (4, 1, 19, 3)
    np.testing.assert_allclose(take.monocular[:, 0], take.truth + panoptic.GUESS_ERROR, atol=1e-9)
    with pytest.raises(DatasetError, match=r"initial_guess/other/.*: expected world poses, got no file"):
        datasets.read("panoptic", tmp_path, monocular="other")


def test_nothing_is_missing_and_all_is_well(toolbox):
    report = datasets.check("panoptic", toolbox[0])
    assert report.ok
    assert report.findings == ()


def test_cameras_can_be_chosen(toolbox):
    root, written = toolbox
    assert datasets.read("panoptic", root, views=4).takes[0].rig.names[3] == "00_13"
    with pytest.raises(InvalidInputError, match="views: expected 1 to 8"):
        datasets.read("panoptic", root, views=9)
    folder = root / "mine" / SEQUENCE
    folder.mkdir(parents=True)
    np.savez(folder / "poses.npz", poses2d=written.detections[SEQUENCE][:, [5, 0]], frames=written.frames)
    data = datasets.read("panoptic", root, views=[23, 1], detections=root / "mine", sequences=[SEQUENCE])
    assert data.takes[0].rig.names == ("00_23", "00_01")


def test_a_joint_that_was_not_measured_is_nan(toolbox):
    root, _ = toolbox

    def unmeasured(document):
        document["bodies"][0]["joints19"][7] = -1

    edit_json(body(root), unmeasured)
    truth = datasets.read("panoptic", root).takes[0].truth
    assert np.isnan(truth[0, 1]).all()
    assert np.isfinite(truth[0, [0, 2]]).all()


def test_frames_not_detected_in_every_view_are_left_out_and_counted(toolbox):
    root, written = toolbox
    pixels = written.detections[SEQUENCE][:, :4].copy()
    pixels[2, 1] = np.nan
    edit_npz(root / "2d_metrabs" / "S0" / SEQUENCE / "poses_filtered_4.npz", poses2d=pixels)
    data = datasets.read("panoptic", root)
    assert data.takes[0].frames.tolist() == [101, 103, 104]
    assert "1 of 4 frames left out" in data.notes[0]


def test_several_bodies_need_a_choice(toolbox):
    root, _ = toolbox

    def second(document):
        document["bodies"].append(dict(document["bodies"][0], id=7))

    edit_json(body(root), second)
    with pytest.raises(DatasetError, match=r"00000101.json: bodies: expected one person .* got ids 3, 7"):
        datasets.read("panoptic", root)
    assert len(datasets.read("panoptic", root, person=3, sequences=[SEQUENCE]).takes[0]) == 4


def test_a_wrong_number_of_joints_is_refused(toolbox):
    root, _ = toolbox

    def shorter(document):
        document["bodies"][0]["joints19"] = document["bodies"][0]["joints19"][:60]

    edit_json(body(root), shorter)
    with pytest.raises(DatasetError, match=r"00000101.json: bodies\[0\].joints19: .* got 60 numbers"):
        datasets.read("panoptic", root)


def test_detections_of_another_layout_are_refused(toolbox):
    root, written = toolbox
    path = root / "2d_metrabs" / "S0" / SEQUENCE / "poses_filtered_4.npz"
    edit_npz(path, poses2d=written.detections[SEQUENCE][:, :4, :17])
    with pytest.raises(DatasetError, match=r"poses_filtered_4.npz: poses2d: expected 19 joints .* got 17"):
        datasets.read("panoptic", root)


def test_a_missing_camera_is_refused(toolbox):
    root, _ = toolbox
    path = root / SEQUENCE / f"calibration_{SEQUENCE}.json"

    def without(document):
        document["cameras"] = [c for c in document["cameras"] if c["name"] != "00_10"]

    edit_json(path, without)
    with pytest.raises(DatasetError, match="cameras: expected HD camera 00_10, got only 00_01, 00_02"):
        datasets.read("panoptic", root)


def test_missing_detections_of_a_camera_are_refused(tmp_path):
    panoptic.write(tmp_path, per_camera=True)
    (tmp_path / "2d_metrabs" / "S0" / SEQUENCE / "10" / "poses_filtered_4.npz").unlink()
    with pytest.raises(DatasetError, match=r"00_10.*expected detections of camera 00_10, got no file"):
        datasets.read("panoptic", tmp_path)


def test_another_unit_of_the_truth_is_refused(tmp_path):
    panoptic.write(tmp_path, layout="skelsplat")
    with pytest.raises(DatasetError, match=r"poses_filtered_4.npz: truth: expected joints in mm"):
        datasets.read("panoptic", tmp_path, truth_unit="m")
    path = tmp_path / "3d_gt" / "S0" / SEQUENCE / "poses_filtered_4.npz"
    with np.load(path) as archive:
        metres = archive["poses3d"] / 100.0
    np.savez(path, poses3d=metres)
    with pytest.raises(
        DatasetError, match=r"171204_pose5.*poses_filtered_4.npz: truth: expected joints in mm"
    ):
        datasets.read("panoptic", tmp_path)


def test_cameras_in_metres_are_refused(toolbox):
    root, _ = toolbox

    def metres(document):
        for camera in document["cameras"]:
            camera["t"] = (np.array(camera["t"]) / 100.0).tolist()

    edit_json(root / SEQUENCE / f"calibration_{SEQUENCE}.json", metres)
    with pytest.raises(DatasetError, match=r"calibration_171204_pose5.json: cameras: .* multiplied by 100"):
        datasets.read("panoptic", root)


def test_exchanged_sides_are_refused(toolbox):
    root, written = toolbox
    order = np.arange(19)
    for left, right in datasets.read("panoptic", root).layout.left_right:
        order[[left, right]] = right, left
    path = root / "2d_metrabs" / "S0" / SEQUENCE / "poses_filtered_4.npz"
    edit_npz(path, poses2d=written.detections[SEQUENCE][:, :4, order])
    with pytest.raises(DatasetError, match=r"poses_filtered_4.npz: left and right: expected the same sides"):
        datasets.read("panoptic", root)


def test_truncated_files_are_refused(toolbox):
    root, _ = toolbox
    path = root / "2d_metrabs" / "S0" / SEQUENCE / "poses_filtered_4.npz"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match=r"poses_filtered_4.npz: file: expected a complete npz file"):
        datasets.read("panoptic", root)
    path.write_bytes(whole)
    body(root).write_text(body(root).read_text()[:50])
    with pytest.raises(DatasetError, match=r"body3DScene_00000101.json: JSON: expected a complete JSON"):
        datasets.read("panoptic", root)


def test_frames_that_do_not_match_are_refused(toolbox):
    root, written = toolbox
    path = root / "2d_metrabs" / "S0" / SEQUENCE / "poses_filtered_4.npz"
    edit_npz(path, frames=written.frames + 5000)
    with pytest.raises(
        DatasetError, match=r"poses_filtered_4.npz: frames: expected some of the frames of S0"
    ):
        datasets.read("panoptic", root)
    edit_npz(path, frames=None)  # four frames have a body, the file has five
    with pytest.raises(DatasetError, match=r"poses_filtered_4.npz: poses2d: expected 4 frames .* got 5"):
        datasets.read("panoptic", root)


def test_missing_files_are_said_where_they_were_expected(toolbox):
    root, _ = toolbox
    (root / SEQUENCE / f"calibration_{SEQUENCE}.json").unlink()
    report = datasets.check("panoptic", root)
    assert not report.ok
    assert report.survey.missing[0][0] == root / SEQUENCE / f"calibration_{SEQUENCE}.json"
    assert "calibration of 171204_pose5" in str(report.error)
