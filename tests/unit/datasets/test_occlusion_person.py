"""Occlusion-Person: both layouts come back as written, and what does not fit is refused by name."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from skelsplat import DatasetError, InvalidInputError, datasets
from writers import occlusion_person as writer

ROWS = 12  # two scenes of six frames
RIGHT_LEFT = [0, 4, 5, 6, 1, 2, 3, 7, 8, 12, 13, 14, 9, 10, 11]


@pytest.fixture
def pickled(tmp_path):
    return tmp_path, writer.write(tmp_path)


def edit(root, change) -> None:
    records = writer.load(root)
    change(records)
    writer.save(writer.pickle_path(root), records)


def read(root, **options):
    return datasets.read("occlusion-person", root, **{"step": 1, **options})


@pytest.mark.parametrize("layout", ["adafuse", "skelsplat"])
@pytest.mark.parametrize("per_camera", [False, True])
@pytest.mark.parametrize(("views", "cameras"), [(8, list(range(8))), (4, [1, 3, 5, 7]), ([2, 0], [2, 0])])
def test_both_layouts_come_back(tmp_path, layout, per_camera, views, cameras):
    written = writer.write(tmp_path, layout=layout, per_camera=per_camera)
    data = read(tmp_path, views=views)
    assert (data.layout.name, data.detector, len(data)) == ("occlusion_person15", "resnet50", 2)
    assert len(data.takes[0]) == written.per_scene, "frames with the same cameras are a take"
    assert data.takes[0].rig.names == tuple(map(str, cameras))
    assert data.takes[0].rig != data.takes[1].rig
    truth, detections = (
        np.concatenate([getattr(take, name) for take in data]) for name in ("truth", "detections")
    )
    np.testing.assert_allclose(truth, written.truth, atol=1e-9)
    np.testing.assert_array_equal(detections, written.detections[:, cameras])
    if layout == "adafuse":
        visible = np.concatenate([take.visible for take in data])
        np.testing.assert_array_equal(visible, written.visible[:, cameras])
        boxes = np.concatenate([take.boxes for take in data])
        pixels = detections[..., :2]
        assert (boxes[..., None, :2] < pixels + 3).all()
        assert (boxes[..., None, 2:] > pixels - 3).all()


def test_every_fifth_frame_is_taken_by_default(pickled):
    root, written = pickled
    data = datasets.read("occlusion-person", root)
    np.testing.assert_allclose(np.concatenate([take.truth for take in data]), written.truth[::5], atol=1e-9)
    with pytest.raises(InvalidInputError, match="step: expected an integer >= 1, got 0"):
        read(root, step=0)


def test_views_that_are_not_there_are_refused(pickled):
    with pytest.raises(InvalidInputError, match="views: expected 4, 8 or different cameras of 0 to 7, got 5"):
        read(pickled[0], views=5)


def test_all_is_well(pickled):
    report = datasets.check("occlusion-person", pickled[0])
    assert report.ok
    assert report.findings == ()
    assert report.survey.format == "adafuse"


def test_frames_without_all_cameras_are_left_out(pickled):
    root, _ = pickled
    edit(root, lambda records: records.pop(8 * 3 + 7))
    np.savez(
        root / "2d_resnet50" / "S0" / "validation" / "poses.npz",
        poses2d=np.delete(pickled[1].detections, 3, 0),
    )
    data = read(root)
    assert sum(map(len, data)) == ROWS - 1
    assert data.notes == ("1 frames left out, not in every camera",)


def test_a_missing_camera_is_refused(pickled):
    root, _ = pickled

    def without(records):
        records[:] = [record for record in records if record["camera_id"] != 5]

    edit(root, without)
    with pytest.raises(
        DatasetError, match=r"unrealcv_validation.pkl: camera_id: expected camera 5, got only"
    ):
        read(root, views=4)


def test_a_missing_camera_in_the_table_by_frame_is_refused(tmp_path):
    writer.write(tmp_path, layout="skelsplat")
    path = tmp_path / "cameras" / "cameras.json"
    table = json.loads(path.read_text())
    table["4"] = table["4"][:7]
    path.write_text(json.dumps(table))
    with pytest.raises(DatasetError, match=r"cameras.json: 4: expected camera 7 .* got 7"):
        read(tmp_path, views=4)


@pytest.mark.parametrize("key", ["joints_gt", "joints_2d"])
def test_a_wrong_number_of_joints_is_refused(pickled, key):
    root, _ = pickled

    def shorter(records):
        records[9][key] = records[9][key][:14]

    edit(root, shorter)
    with pytest.raises(DatasetError, match=rf"unrealcv_validation.pkl: \[9\].{key}: expected shape \(15, "):
        read(root)


def test_detections_with_other_joints_are_refused(pickled):
    root, written = pickled
    np.savez(root / "2d_resnet50" / "S0" / "validation" / "poses.npz", poses2d=written.detections[:, :, :14])
    with pytest.raises(DatasetError, match=r"poses.npz: poses2d: expected 15 joints .* got 14"):
        read(root)


def test_metres_are_refused(pickled):
    root, _ = pickled

    def metres(records):
        for record in records:
            record["joints_gt"] = record["joints_gt"] / 1000.0

    edit(root, metres)
    with pytest.raises(
        DatasetError, match=r"unrealcv_validation.pkl: truth: expected joints in mm, .* in m\b"
    ):
        read(root)


def test_a_translation_in_place_of_the_centre_is_refused(pickled):
    root, _ = pickled

    def translation(records):
        for record in records:
            camera = record["camera"]
            camera["T"] = -camera["R"] @ camera["T"]

    edit(root, translation)
    with pytest.raises(DatasetError, match=r"unrealcv_validation.pkl: camera.* expected"):
        read(root)


def test_exchanged_sides_are_refused(pickled):
    root, written = pickled

    def exchanged(records):
        for record in records:
            record["joints_gt"] = record["joints_gt"][RIGHT_LEFT]

    np.savez(
        root / "2d_resnet50" / "S0" / "validation" / "poses.npz", poses2d=written.detections[:, :, RIGHT_LEFT]
    )
    with pytest.raises(DatasetError, match=r"S0/validation/poses.npz: left and right: expected the same"):
        read(root)
    edit(root, exchanged)
    with pytest.raises(DatasetError, match=r"unrealcv_validation.pkl: left and right: expected the same"):
        read(root)


def test_truncated_files_are_refused(pickled):
    root, _ = pickled
    path = root / "2d_resnet50" / "S0" / "validation" / "poses.npz"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match=r"poses.npz: file: expected a complete npz file"):
        read(root)
    path.write_bytes(whole)
    annotation = writer.pickle_path(root)
    annotation.write_bytes(annotation.read_bytes()[:5000])
    with pytest.raises(DatasetError, match=r"unrealcv_validation.pkl: pickle: expected a complete pickle"):
        read(root)


def test_other_classes_in_the_pickle_are_refused(pickled):
    root, _ = pickled
    edit(root, lambda records: records[0].update(scale=Fraction(1, 2)))
    with pytest.raises(DatasetError, match=r"unrealcv_validation.pkl: pickle: .* fractions.Fraction"):
        read(root)


def test_frames_that_do_not_match_are_refused(pickled):
    root, written = pickled
    path = root / "2d_resnet50" / "S0" / "validation" / "poses.npz"
    np.savez(path, poses2d=written.detections[:-1])
    with pytest.raises(DatasetError, match=r"poses.npz: poses2d: expected 12 frames .* got 11"):
        read(root)

    def moved(records):
        records[1]["joints_gt"] = records[1]["joints_gt"] + 50.0

    edit(root, moved)
    with pytest.raises(DatasetError, match=r"\[0\].joints_gt: expected the same joints in every camera"):
        read(root)


def test_detections_may_say_which_frames_they_are(pickled):
    root, written = pickled
    rows = np.array([1, 2, 7])
    np.savez(
        root / "2d_resnet50" / "S0" / "validation" / "poses.npz",
        poses2d=written.detections[rows],
        frames=rows,
    )
    data = read(root)
    np.testing.assert_allclose(np.concatenate([take.truth for take in data]), written.truth[rows], atol=1e-9)


def test_the_table_by_frame_must_have_the_frames(tmp_path):
    written = writer.write(tmp_path, layout="skelsplat")
    folder = tmp_path / "3d_gt" / "S0" / "validation 1"
    np.savez(folder / "poses.npz", poses3d=written.truth[:-2])
    with pytest.raises(DatasetError, match=r"poses.npz: poses3d: expected 12 frames .* got 10"):
        read(tmp_path)
    np.savez(folder / "poses.npz", poses3d=written.truth, frames=1000 + np.arange(ROWS))
    with pytest.raises(
        DatasetError, match=r"poses.npz: frames: expected frames of .*cameras.json, got frame 1000"
    ):
        read(tmp_path)


def test_missing_files_are_said_where_they_were_expected(pickled):
    root, _ = pickled
    writer.pickle_path(root).unlink()
    report = datasets.check("occlusion-person", root)
    assert report.survey.missing[0][0] == writer.pickle_path(root)
    assert "nor at" in str(report.error)
