"""Human3.6M in every layout with something wrong: it is refused, file and field by name."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

from human36m_case import FORMATS, refused, write_as
from skelsplat import DatasetError, datasets
from skelsplat.exceptions import InvalidInputError
from writers import human36m as write


@pytest.fixture(scope="module")
def recording():
    return write.record()


@pytest.fixture
def spoiled():
    """Give a recording of its own, to spoil."""
    return write.record()


@pytest.mark.parametrize("name", FORMATS)
def test_metres_for_millimetres(tmp_path, spoiled, name):
    spoiled.scale_truth(1000.0 if name == "videopose3d" else 0.001)
    options = write_as(name, tmp_path, spoiled)
    if name == "adafuse":  # in the camera's frame, where the scaling was of the world's
        records = write.adafuse_records(write.record())
        for each in records:
            each["joints_3d"] = each["joints_3d"] / 1000
        (tmp_path / "annot" / "h36m_validation.pkl").write_bytes(pickle.dumps(records))
    words = "a body of [0-9.e+]+ mm" + ("" if name == "videopose3d" else " \\(plausible in m\\)")
    refused(tmp_path, options, "", "truth", "joints in mm", words)


@pytest.mark.parametrize("name", ["skelsplat", "videopose3d"])
def test_cameras_in_metres(tmp_path, recording, name):
    options = write_as(name, tmp_path, recording)
    path = next(tmp_path.rglob("camera-parameters.json"))
    content = json.loads(path.read_text())
    for cameras in content["extrinsics"].values():
        for camera in cameras.values():
            camera["t"] = (np.array(camera["t"]) / 1000).tolist()
    path.write_text(json.dumps(content))
    refused(tmp_path, options, "camera-parameters.json", "cameras: expected translations in mm", "by 1000")


@pytest.mark.parametrize("name", FORMATS)
def test_exchanged_sides(tmp_path, spoiled, name):
    spoiled.exchange_sides()
    options = write_as(name, tmp_path, spoiled)
    error = refused(
        tmp_path, options, "", "left and right", r"\d\.\d px exchanged", "S9/Directions.* and 7 more"
    )
    assert error.path.exists()
    (finding,) = datasets.check("human36m", tmp_path, **options).findings
    assert (finding.kind, finding.severity, len(finding.subject.takes)) == ("dataset_sides", "error", 8)


@pytest.mark.parametrize(
    ("name", "file", "field"),
    [
        ("skelsplat", "3d_gt/S9/Directions/poses.npz", "poses: expected 17 joints of h36m17, got 16"),
        ("karfly", "human36m-multiview-labels-GTbboxes.npy", "table.keypoints: expected 17 joints"),
        ("adafuse", "h36m_validation.pkl", "S9/Directions-1, joints_3d: expected 17 joints"),
        ("videopose3d", "data_3d_h36m.npz", "positions_3d.S9.Directions: expected 32 joints.* got 16"),
    ],
)
def test_a_wrong_joint_count(tmp_path, spoiled, name, file, field):
    spoiled.drop_joint()
    refused(tmp_path, write_as(name, tmp_path, spoiled), file, field)


@pytest.mark.parametrize("name", ["skelsplat", "karfly", "videopose3d"])
def test_a_wrong_joint_count_of_the_detections(tmp_path, spoiled, name):
    for take in spoiled.takes:
        take.pixels = take.pixels[:, :, :16]
    refused(tmp_path, write_as(name, tmp_path, spoiled), "2d", "17 joints of h36m17", "16")


def test_a_missing_camera_of_the_parameters(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording)
    path = tmp_path / "cameras" / "camera-parameters.json"
    content = json.loads(path.read_text())
    del content["extrinsics"]["S11"]["58860488"]
    path.write_text(json.dumps(content))
    refused(tmp_path, {}, "camera-parameters.json", "extrinsics.S11.58860488")


def test_a_missing_camera_of_the_authors_detections(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording)
    file = tmp_path / "2d_metrabs" / "S9" / "Greeting 1" / "55011271" / "poses.npz"
    file.unlink()
    refused(tmp_path, {}, "2d_metrabs/S9/Greeting 1/55011271", "detections of camera 55011271")
    assert (file, "detections of 55011271") in datasets.check("human36m", tmp_path).survey.missing


def test_a_missing_camera_of_karfly(tmp_path, recording):
    path = write.write_karfly(tmp_path, recording)
    labels = write.karfly_labels(recording)
    labels["camera_names"][2] = "1"
    np.save(path, labels, allow_pickle=True)
    refused(tmp_path, {}, path.name, "camera_names", "58860488")
    labels = write.karfly_labels(recording)
    labels["cameras"] = labels["cameras"][:, :3]
    np.save(path, labels, allow_pickle=True)
    refused(tmp_path, {}, path.name, r"cameras\[S9, 60457274\]", r"shape \(2, 3\)")


def test_a_missing_camera_of_adafuse(tmp_path, recording):
    path = write.write_adafuse(tmp_path, recording)
    records = [r for r in write.adafuse_records(recording) if r["camera_id"] != 2 or r["action"] != 5]
    path.write_bytes(pickle.dumps(records))
    refused(tmp_path, {}, path.name, "S9/Greeting-2, camera_id", "58860488")


def test_a_missing_camera_of_videopose3d(tmp_path, spoiled):
    write.write_videopose3d(tmp_path, spoiled)
    path = tmp_path / "data_2d_h36m_cpn_ft_h36m_dbb.npz"
    positions = np.load(path, allow_pickle=True)["positions_2d"].item()
    positions["S11"]["Photo 1"].pop()
    np.savez(path, positions_2d=np.array(positions, dtype=object))
    refused(tmp_path, {}, path.name, r"positions_2d\.S11\.Photo 1", "4 cameras", "got 3")


@pytest.mark.parametrize("name", ["skelsplat", "karfly"])
def test_frames_that_do_not_match(tmp_path, spoiled, name):
    options = write_as(name, tmp_path, spoiled)
    for take in spoiled.takes:
        take.truth, take.pixels, take.frames = take.truth[:-1], take.pixels[:-1], take.frames[:-1]
    if name == "karfly":
        write.write_karfly(tmp_path, spoiled)
    else:
        take = spoiled.takes[0]
        np.savez(tmp_path / "3d_gt" / take.subject / take.name / "poses.npz", poses=take.truth)
    refused(tmp_path, options, "54138969", "poses2d", "5 frames as in the truth", "6")


def test_views_of_adafuse_with_other_frames(tmp_path, recording):
    path = write.write_adafuse(tmp_path, recording)
    records = write.adafuse_records(recording)
    for record in records:
        record["image_id"] += 1000 * (record["camera_id"] == 3)
    path.write_bytes(pickle.dumps(records))
    refused(tmp_path, {}, path.name, "image_id", "the same frames in every view", "0 of 12")


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_file_cut_short(tmp_path, recording, name, share):
    options = write_as(name, tmp_path, recording)
    files = {
        "skelsplat": "3d_gt/S9/Directions/poses.npz",
        "karfly": "human36m-multiview-labels-GTbboxes.npy",
        "adafuse": "annot/h36m_validation.pkl",
        "videopose3d": "data_3d_h36m.npz",
    }
    path = tmp_path / files[name]
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refused(tmp_path, options, path.name, "expected")


@pytest.mark.parametrize("name", FORMATS)
def test_a_forbidden_class_does_not_run(tmp_path, recording, name):
    class Bomb:
        def __reduce__(self):
            import os

            return os.mkdir, (str(tmp_path / "made"),)

    options = write_as(name, tmp_path, recording)
    bomb = np.array({"S9": Bomb()}, dtype=object)
    if name == "skelsplat":
        file = tmp_path / "3d_gt" / "S9" / "Directions" / "poses.npz"
        np.savez(file, poses=bomb)
    elif name == "videopose3d":
        file = tmp_path / "data_2d_h36m_cpn_ft_h36m_dbb.npz"
        np.savez(file, positions_2d=bomb)
    elif name == "karfly":
        file = tmp_path / "human36m-multiview-labels-GTbboxes.npy"
        np.save(file, bomb, allow_pickle=True)
    else:
        file = tmp_path / "annot" / "h36m_validation.pkl"
        file.write_bytes(pickle.dumps([Bomb()]))
    refused(tmp_path, options, file.name, "NumPy arrays, numbers and builtin containers only", r"\.mkdir")
    assert not (tmp_path / "made").exists()
    if name == "adafuse":
        pickle.loads(file.read_bytes())
        assert (tmp_path / "made").exists()


def test_views_of_adafuse_that_disagree_about_the_truth(tmp_path, recording):
    path = write.write_adafuse(tmp_path, recording)
    records = write.adafuse_records(recording)
    records[1]["joints_3d"] = records[1]["joints_3d"] + 50.0
    path.write_bytes(pickle.dumps(records))
    refused(tmp_path, {}, path.name, "joints_3d", "the same pose in all views", "mm apart")


def test_options_that_do_not_exist(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording)
    with pytest.raises(InvalidInputError, match="detecter: expected an option of human36m"):
        datasets.read("human36m", tmp_path, detecter="cpn")
    with pytest.raises(InvalidInputError, match="format: expected one of"):
        datasets.read("human36m", tmp_path, format="coco")
    with pytest.raises(InvalidInputError, match="subjects: expected names"):
        datasets.read("human36m", tmp_path, subjects="S9")
    with pytest.raises(InvalidInputError, match="name: expected one of human36m"):
        datasets.read("human37m", tmp_path)
    with pytest.raises(DatasetError, match="nothing in this place"):
        datasets.read("human36m", tmp_path / "nowhere")
    with pytest.raises(DatasetError, match="subjects: expected S1, got only S9, S11"):
        datasets.read("human36m", tmp_path, subjects=("S1",))
    assert len(datasets.read("human36m", tmp_path, subjects=None)) == 8
    assert len(datasets.read("human36m", tmp_path, subjects=["S11"])) == 4


def test_no_format_and_two_formats(tmp_path, recording):
    with pytest.raises(DatasetError, match=r"data_3d_h36m\.npz \(format videopose3d\) or .*3d_gt"):
        datasets.read("human36m", tmp_path)
    report = datasets.check("human36m", tmp_path)
    assert not report.ok
    assert report.survey.missing[0][0] == tmp_path
    write.write_skelsplat(tmp_path, recording)
    write.write_adafuse(tmp_path, recording)
    with pytest.raises(DatasetError, match=r"or the option format, got adafuse at .*, skelsplat at"):
        datasets.read("human36m", tmp_path)
    assert "skelsplat" in datasets.read("human36m", tmp_path, format="skelsplat").source
