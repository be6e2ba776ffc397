"""Human3.6M in every layout: it comes back as it was written, and what is wrong is refused by name."""

from __future__ import annotations

import json
import pickle
import re

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import DatasetError, datasets
from skelsplat.exceptions import InvalidInputError
from writers import human36m as write

FORMATS = ("skelsplat", "karfly", "adafuse", "videopose3d")
# float32 keeps 2⁻²⁴ of the largest coordinate, about 5 m or 1000 px.
TOLERANCE = {"skelsplat": 1e-9, "karfly": 1e-3, "adafuse": 1e-9, "videopose3d": 1e-3}
ALIASES = {"TakingPhoto": "Photo"}


def write_as(name, root, recording):
    """Write a recording in a layout; return the options to read it with."""
    if name == "karfly":
        write.write_karfly(root, recording)
        write.write_detections(root / "2d_cpn", recording, numbered=True)
        return {"detections": root / "2d_cpn"}
    {
        "skelsplat": write.write_skelsplat,
        "adafuse": write.write_adafuse,
        "videopose3d": write.write_videopose3d,
    }[name](root, recording)
    return {}


def refused(root, options, file, *words):
    """Read, and check that the error names the file and holds the words."""
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", root, **options)
    message = str(caught.value)
    assert caught.value.path.is_relative_to(root)
    assert file in str(caught.value.path)
    for word in words:
        assert re.search(word, message), message
    report = datasets.check("human36m", root, **options)
    assert not report.ok
    return caught.value


@pytest.fixture(scope="module")
def recording():
    return write.record()


@pytest.fixture
def spoiled():
    """Give a recording of its own, to spoil."""
    return write.record()


@pytest.mark.parametrize("name", FORMATS)
def test_every_layout_comes_back(tmp_path, recording, name):
    options = write_as(name, tmp_path, recording)
    dataset = datasets.read("human36m", tmp_path, **options)
    numbered = name in ("karfly", "adafuse")
    assert dataset.name == "human36m"
    assert dataset.layout == sk.layouts.H36M17
    assert [take.subject for take in dataset] == ["S9"] * 4 + ["S11"] * 4
    assert name in dataset.source
    for take, written in zip(dataset, recording.takes, strict=True):
        activity = written.numbered if numbered else written.name
        assert take.key.replace("/Photo", "/TakingPhoto") == f"{written.subject}/{activity}"
        assert take.action == ALIASES.get(written.action, written.action)
        assert take.rig.names == write.CAMERAS
        assert take.rig.unit == "mm"
        atol = TOLERANCE[name]
        for camera, true in zip(take.rig, recording.rigs[written.subject], strict=True):
            np.testing.assert_allclose(camera.K, true.K, atol=atol)
            np.testing.assert_allclose(camera.R, true.R, atol=1e-6)
            np.testing.assert_allclose(camera.t, true.t, atol=atol)
            np.testing.assert_allclose(camera.distortion, true.distortion, atol=1e-7)
            assert camera.size == true.size
        np.testing.assert_allclose(take.truth, written.truth, atol=atol)
        np.testing.assert_allclose(take.detections[..., :2], written.pixels, atol=atol)
        assert (take.detections[..., 2] == 1).all()
        np.testing.assert_array_equal(take.frames, written.frames + (name == "adafuse"))
        assert {"truth", "detections", "cameras"} <= set(take.files)
        assert all(path.exists() for path in take.files.values())


@pytest.mark.parametrize("name", FORMATS)
def test_check_finds_nothing_wrong(tmp_path, recording, name):
    report = datasets.check("human36m", tmp_path, **write_as(name, tmp_path, recording))
    assert report.ok
    assert report.survey.format == name
    assert not report.survey.missing
    assert not report.findings
    assert all(path.exists() for path in report.survey.there)


@pytest.mark.parametrize("name", FORMATS)
def test_metres_for_millimetres(tmp_path, spoiled, name):
    spoiled.scale_truth(1000.0 if name == "videopose3d" else 0.001)
    options = write_as(name, tmp_path, spoiled)
    if name == "adafuse":  # in the camera's frame, where the scaling was of the world's
        records = write.adafuse_records(write.record())
        for each in records:
            each["joints_3d"] = each["joints_3d"] / 1000
        (tmp_path / "annot" / "h36m_validation.pkl").write_bytes(pickle.dumps(records))
    words = "a body of [0-9.e+]+ mm" + ("" if name == "videopose3d" else ", which it would be in m")
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
    assert (finding.topic, finding.fatal, len(finding.takes)) == ("sides", True, 8)


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


def test_frames_of_adafuse_that_one_view_lacks_are_left_out(tmp_path, recording):
    path = write.write_adafuse(tmp_path, recording)
    path.write_bytes(pickle.dumps(write.adafuse_records(recording)[1:]))
    dataset = datasets.read("human36m", tmp_path)
    assert [len(take) for take in dataset] == [5] + [6] * 7
    assert dataset.notes == ("S9/Directions-1: 1 frames left out, not seen by every view",)


def test_detections_of_videopose3d_that_end_early(tmp_path, recording):
    write.write_videopose3d(tmp_path, recording)
    path = tmp_path / "data_2d_h36m_cpn_ft_h36m_dbb.npz"
    positions = np.load(path, allow_pickle=True)["positions_2d"].item()
    positions["S9"]["Directions"][1] = positions["S9"]["Directions"][1][:4]
    np.savez(path, positions_2d=np.array(positions, dtype=object))
    refused(tmp_path, {}, path.name, r"positions_2d\.S9\.Directions, camera 55011271", "6 frames", "4")


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


def test_adafuse_in_world_coordinates_and_in_pickles_of_python_2(tmp_path, recording):
    for protocol, in_world in ((2, True), (0, False)):
        write.write_adafuse(tmp_path, recording, in_world=in_world, protocol=protocol)
        dataset = datasets.read("human36m", tmp_path)
        for take, written in zip(dataset, recording.takes, strict=True):
            np.testing.assert_allclose(take.truth, written.truth, atol=1e-9)
        assert dataset.detector == "gt"
        assert "oracle" in dataset.source


def test_views_of_adafuse_that_disagree_about_the_truth(tmp_path, recording):
    path = write.write_adafuse(tmp_path, recording)
    records = write.adafuse_records(recording)
    records[1]["joints_3d"] = records[1]["joints_3d"] + 50.0
    path.write_bytes(pickle.dumps(records))
    refused(tmp_path, {}, path.name, "joints_3d", "the same pose in all views", "mm apart")


def test_boxes_are_left_top_right_bottom(tmp_path, recording):
    write.write_karfly(tmp_path / "k", recording)
    write.write_adafuse(tmp_path / "a", recording)
    for folder, atol in (("k", 1.0), ("a", 1e-9)):
        take = datasets.read("human36m", tmp_path / folder).takes[0]
        pixels = recording.takes[0].pixels
        expected = np.concatenate([pixels.min(axis=2), pixels.max(axis=2)], axis=-1)
        np.testing.assert_allclose(take.boxes, expected, atol=atol)


def test_a_box_of_zeros_is_a_missing_view(tmp_path, recording):
    path = write.write_karfly(tmp_path, recording)
    labels = write.karfly_labels(recording)
    labels["table"]["bbox_by_camera_tlbr"][0, 2] = 0
    np.save(path, labels, allow_pickle=True)
    boxes = datasets.read("human36m", tmp_path).takes[0].boxes
    assert np.isnan(boxes[0, 2]).all()
    assert np.isfinite(np.delete(boxes.reshape(-1, 4), 2, axis=0)).all()


def test_the_order_of_learnable_triangulation_is_the_published_one():
    """Joint k of h36m17 and place ORDER[k] of the file's order are the same of the 32."""
    from skelsplat.datasets.human36m._karfly import ORDER
    from skelsplat.datasets.human36m._videopose3d import JOINTS_OF_32

    assert JOINTS_OF_32 == write.OF_32
    own = [write.KARFLY_OF_32[place] for place in ORDER]
    # The top of the head (15) and the nose (14) are the file's 9 and 16.
    assert own == list(write.OF_32)


@pytest.mark.parametrize("kind", ["npz", "json", "flat", "positions", "document"])
def test_detections_kept_apart(tmp_path, recording, kind):
    write.write_karfly(tmp_path, recording)
    path = tmp_path / "resnet152"
    if kind in ("npz", "json"):
        write.write_detections(path, recording, json_files=kind == "json", numbered=True)
    elif kind == "flat":
        path = tmp_path / "resnet152.npz"
        np.savez(path, **{f"{take.subject}/{take.numbered}": take.pixels for take in recording.takes})
    else:
        nested: dict = {}
        for take in recording.takes:
            pixels = take.pixels.tolist() if kind == "document" else [take.pixels[:, v] for v in range(4)]
            nested.setdefault(take.subject, {})[take.numbered] = pixels
        if kind == "document":
            nested["S9"]["Directions-1"][0][0][0] = [None, None]
            path = tmp_path / "resnet152.json"
            path.write_text(json.dumps(nested))
        else:
            path = tmp_path / "resnet152.npz"
            np.savez(path, positions_2d=np.array(nested, dtype=object))
    dataset = datasets.read("human36m", tmp_path, detections=path)
    assert dataset.detector == "resnet152"
    for take, written in zip(dataset, recording.takes, strict=True):
        there = np.isfinite(take.detections[..., 0])
        assert (~there).sum() == (kind == "document" and take.key == "S9/Directions-1")
        np.testing.assert_allclose(take.detections[there][:, :2], written.pixels[there], atol=1e-9)
        np.testing.assert_array_equal(take.detections[..., 2], there.astype(float))


def test_takes_that_the_detector_lacks_are_left_out_and_told(tmp_path, recording):
    import shutil

    write.write_skelsplat(tmp_path, recording)
    shutil.rmtree(tmp_path / "2d_metrabs" / "S11" / "Directions")
    dataset = datasets.read("human36m", tmp_path)
    assert len(dataset) == 7
    assert dataset.notes == ("left out, without detections: S11/Directions",)


def test_detectors_are_chosen_by_name_and_told(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording, detectors=("CPN", "ResNet-152"))
    dataset = datasets.read("human36m", tmp_path)
    assert dataset.detector == "resnet152"
    assert dataset.notes == ("detector resnet152 of cpn, resnet152",)
    assert datasets.read("human36m", tmp_path, detector="cpn").detector == "cpn"
    with pytest.raises(DatasetError, match="detections of metrabs, got only cpn, resnet152"):
        datasets.read("human36m", tmp_path, detector="MeTRAbs")


def test_confidences_missing_joints_and_monocular_poses_of_the_authors(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording)
    written = recording.takes[0]
    scores = np.linspace(0.0, 1.2, written.pixels[:, 0, :, 0].size).reshape(-1, 17)
    pixels = written.pixels.copy()
    pixels[1, :, 3] = 0.0
    for view, name in enumerate(write.CAMERAS):
        folder = tmp_path / "2d_metrabs" / "S9" / "Directions" / name
        world = written.truth + view
        np.savez(folder / "poses.npz", poses2d=pixels[:, view], scores=scores, coords3d_pred_world=world)
    fused = tmp_path / "initial_guess" / "fusion"
    for take in recording.takes:
        (fused / take.subject / take.name).mkdir(parents=True)
        np.savez(fused / take.subject / take.name / "poses.npz", poses3d=take.truth + 7)
    take = datasets.read("human36m", tmp_path).takes[0]
    assert np.isnan(take.detections[1, :, 3, :2]).all()
    assert (take.detections[1, :, 3, 2] == 0).all()
    expected = np.clip(scores, 0, 1)
    expected[1, 3] = 0
    np.testing.assert_allclose(take.detections[..., 2], np.repeat(expected[:, None], 4, axis=1))
    np.testing.assert_allclose(take.monocular[:, 2], written.truth + 2)
    take = datasets.read("human36m", tmp_path, monocular="fusion").takes[0]
    np.testing.assert_allclose(take.monocular[:, 0], written.truth + 7)
    with pytest.raises(DatasetError, match=r"initial_guess/other/.*poses 'other'"):
        datasets.read("human36m", tmp_path, monocular="other")


def test_the_root_may_be_one_folder_up(tmp_path, recording):
    write.write_skelsplat(tmp_path / "human36m", recording)
    assert len(datasets.read("human36m", tmp_path)) == 8


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


def test_occluded_variants_are_found_by_folder_and_option(tmp_path, recording):
    for variant in ("2", "3", "3-hard"):
        write.write_skelsplat(tmp_path / f"human36m-occ-{variant}", recording)
    for variant in ("2", "3", "3-Hard"):
        dataset = datasets.read("human36m-occ", tmp_path, variant=variant)
        assert dataset.source.startswith(f"Human3.6M-Occ-{variant.lower()}, skelsplat layout")
        assert dataset.name == "human36m-occ"
    assert "Occ-3-hard," in datasets.read("human36m-occ", tmp_path / "human36m-occ-3-hard").source
    with pytest.raises(DatasetError, match="variant: expected one of 2, 3, 3-hard, got none chosen"):
        datasets.read("human36m-occ", tmp_path)
    assert not datasets.check("human36m-occ", tmp_path).ok
    with pytest.raises(InvalidInputError, match="variant: expected one of 2, 3, 3-hard, got '4'"):
        datasets.read("human36m-occ", tmp_path, variant="4")
    with pytest.raises(DatasetError, match="variant: expected 2, got a folder of 3"):
        datasets.read("human36m-occ", tmp_path / "human36m-occ-3", variant="2")
    assert datasets.check("human36m-occ", tmp_path, variant="3").ok
