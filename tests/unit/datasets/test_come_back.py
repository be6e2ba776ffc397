"""Human3.6M, CMU Panoptic, Occlusion-Person, Shelf and Campus come back as they were written."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import DatasetError, datasets
from writers import human36m as write
from writers import occlusion_person, panoptic, shelf_campus

SEQUENCE = panoptic.SEQUENCES[0]
DETECTED = f"2d_metrabs/S0/{SEQUENCE}/poses_filtered_4.npz"
PERSON = f"2d_resnet50/S0/{occlusion_person.ACTIVITY}/poses.npz"


@pytest.mark.parametrize(("layout", "views", "per_camera"), [
    ("toolbox", 4, False), ("toolbox", 8, True), ("skelsplat", 4, True), ("skelsplat", 4, False),
])  # fmt: skip
def test_panoptic_comes_back(tmp_path, layout, views, per_camera):
    written = panoptic.write(tmp_path, layout=layout, per_camera=per_camera)
    data = datasets.read("panoptic", tmp_path, views=views)
    assert (data.layout.name, data.detector, len(data)) == ("panoptic19", "metrabs", 2)
    first = int(layout == "toolbox")  # the frame without a body is left out
    for take, name in zip(data, panoptic.SEQUENCES, strict=True):
        assert take.rig.names == tuple(f"00_{number:02d}" for number in panoptic.HD[:views])
        assert take.rig.unit == "mm"
        if first:
            assert take.frames.tolist() == written.frames[1:].tolist()
        np.testing.assert_allclose(take.truth, written.truth[name][first:], atol=1e-9)
        pixels = written.detections[name][first:, :views, :, :2]
        np.testing.assert_array_equal(take.detections[..., :2], pixels)
        np.testing.assert_allclose(take.rig[0].distortion, panoptic.LENS)
    report = datasets.check("panoptic", tmp_path)
    assert (report.ok, report.findings) == (True, ())


def test_frames_not_detected_in_every_view_are_left_out_with_their_monocular_poses(tmp_path):
    written = panoptic.write(tmp_path, layout="skelsplat")
    pixels = written.detections[SEQUENCE][:, :4].copy()
    pixels[1, 2] = np.nan
    np.savez(tmp_path / DETECTED, poses2d=pixels)
    data = datasets.read("panoptic", tmp_path, monocular="metrabs")
    take = data.takes[0]
    assert take.frames.tolist() == [0, 2, 3, 4]
    assert "1 of 5 frames" in data.notes[0]
    assert take.monocular.shape == (4, 1, 19, 3)
    np.testing.assert_allclose(take.monocular[:, 0], take.truth + panoptic.GUESS_ERROR, atol=1e-9)


def test_cameras_bodies_and_joints_of_panoptic_can_be_chosen(tmp_path):
    written = panoptic.write(tmp_path)
    body = tmp_path / SEQUENCE / "hdPose3d_stage1_coco19" / f"body3DScene_{panoptic.FIRST_FRAME + 1:08d}.json"
    content = json.loads(body.read_text())
    content["bodies"][0]["joints19"][7] = -1  # the confidence of joint 1: not measured
    content["bodies"].append(dict(content["bodies"][0], id=7))
    body.write_text(json.dumps(content))
    folder = tmp_path / "mine" / SEQUENCE
    folder.mkdir(parents=True)
    np.savez(folder / "poses.npz", poses2d=written.detections[SEQUENCE][:, [5, 0]], frames=written.frames)
    chosen = {"views": [23, 1], "detections": tmp_path / "mine", "sequences": [SEQUENCE], "person": 3}
    take = datasets.read("panoptic", tmp_path, **chosen).takes[0]
    assert take.rig.names == ("00_23", "00_01")
    assert len(take) == 4
    assert np.isnan(take.truth[0, 1]).all()
    assert np.isfinite(take.truth[0, [0, 2]]).all()


def person(root, **options):
    return datasets.read("occlusion-person", root, **{"step": 1, **options})


@pytest.mark.parametrize(("per_camera", "views", "cameras"), [
    (False, 8, list(range(8))), (True, [2, 0], [2, 0]), (True, 4, [1, 3, 5, 7]),
])  # fmt: skip
def test_occlusion_person_comes_back(tmp_path, per_camera, views, cameras):
    written = occlusion_person.write(tmp_path, per_camera=per_camera)
    data = person(tmp_path, views=views)
    assert (data.layout.name, data.detector, len(data)) == ("occlusion_person15", "resnet50", 2)
    assert len(data.takes[0]) == written.per_scene, "frames with the same cameras are a take"
    assert data.takes[0].rig.names == tuple(map(str, cameras))
    assert data.takes[0].rig != data.takes[1].rig
    truth, detections = (
        np.concatenate([getattr(take, name) for take in data]) for name in ("truth", "detections")
    )
    np.testing.assert_allclose(truth, written.truth, atol=1e-9)
    np.testing.assert_array_equal(detections, written.detections[:, cameras])
    report = datasets.check("occlusion-person", tmp_path)
    assert (report.ok, report.findings) == (True, ())


def test_frames_of_occlusion_person_are_chosen(tmp_path):
    written = occlusion_person.write(tmp_path)

    def read(**options):
        return np.concatenate([take.truth for take in person(tmp_path, **options)])

    np.testing.assert_allclose(read(step=5), written.truth[::5], atol=1e-9)
    rows = np.array([1, 2, 7])
    np.savez(tmp_path / PERSON, poses2d=written.detections[rows], frames=rows)
    np.testing.assert_allclose(read(), written.truth[rows], atol=1e-9)


@pytest.mark.parametrize(("name", "nested"), [("shelf", False), ("campus", True)])
def test_shelf_and_campus_come_back(tmp_path, name, nested):
    written = shelf_campus.write(tmp_path, name, nested=nested)
    data = datasets.read(name, tmp_path)
    assert (data.name, data.layout.name, data.detector) == (name, "shelf14", "hrnet")
    assert [take.action for take in data] == ["actor0", "actor1", "actor2"], "actors 0 to 2 are evaluated"
    for k, take in enumerate(data):
        assert take.frames.tolist() == list(range(k, 6)), "an actor is labelled in some frames"
        for camera, given in zip(take.rig, shelf_campus.rig_of(name), strict=True):
            assert (camera.size, camera.name) == (given.size, given.name)
            for part in ("K", "R", "t", "distortion"):
                np.testing.assert_allclose(getattr(camera, part), getattr(given, part), atol=1e-9)
        np.testing.assert_allclose(take.truth, written.truth[k], atol=1e-9)
        np.testing.assert_array_equal(take.detections, written.detections[k])
    report = datasets.check(name, tmp_path)
    assert (report.ok, report.findings) == (True, ())


def test_coco_detections_become_shelfs(tmp_path):
    written = shelf_campus.write(tmp_path, "shelf", coco=True)
    found = datasets.read("shelf", tmp_path).takes[0].detections
    distance = np.linalg.norm(found - written.detections[0], axis=-1)
    assert np.median(distance[..., :12]) < 2.0, "limbs are those of COCO"
    assert np.median(distance[..., 12:]) < 15.0, "neck and head top are interpolated"


@pytest.mark.parametrize(("name", "form"), [("shelf", "npz"), ("campus", "pickle")])
def test_everybody_comes_back_and_the_nearest_detection_is_the_actors(tmp_path, name, form):
    written = shelf_campus.write_everybody(tmp_path, name, form=form)
    data = datasets.read(name, tmp_path)
    assert data.detector == ("hrnet" if form == "npz" else "maskrcnn_hrnet")
    (scene,) = data.scenes
    first, count = shelf_campus.FIRST[name], shelf_campus.N_ACTORS[name]
    np.testing.assert_array_equal(scene.frames, first + np.arange(60))
    np.testing.assert_allclose(scene.truth[0], written.truth[0], atol=1e-9)
    assert scene.names == tuple(f"actor{k}" for k in range(count))
    assert scene.waived == (("actor3",) if name == "shelf" else ())
    if form == "npz":
        np.testing.assert_array_equal(scene.people, written.people)
        known = written.slots() >= 0
        assert (scene.slots == written.slots())[known].mean() > 0.97
    else:
        assert scene.people.shape[-2] == 14
    assert [take.action for take in data] == ["actor0", "actor1", "actor2"]
    off = [
        np.linalg.norm(sk.project(t.truth, t.rig).swapaxes(0, 1) - t.detections[..., :2], axis=-1)
        for t in data
    ]
    assert max(np.nanmedian(one) for one in off) < 6.0
    assert datasets.check(name, tmp_path).ok


# float32 keeps 2⁻²⁴ of the largest coordinate, about 5 m or 1000 px.
TOLERANCE = {"skelsplat": 1e-9, "videopose3d": 1e-3}


@pytest.fixture(scope="module")
def recording():
    return write.record()


@pytest.mark.parametrize("name", TOLERANCE)
def test_every_layout_comes_back(tmp_path, recording, name):
    getattr(write, f"write_{name}")(tmp_path, recording)
    dataset = datasets.read("human36m", tmp_path)
    assert dataset.name == "human36m"
    assert dataset.layout == sk.layouts.H36M17
    assert [take.subject for take in dataset] == ["S9"] * 4 + ["S11"] * 4
    assert name in dataset.source
    for take, written in zip(dataset, recording.takes, strict=True):
        assert take.key.replace("/Photo", "/TakingPhoto") == f"{written.subject}/{written.name}"
        assert take.action == written.action.replace("Taking", "")
        assert take.rig.names == write.CAMERAS
        assert take.rig.unit == "mm"
        for camera, true in zip(take.rig, recording.rigs[written.subject], strict=True):
            for part in ("K", "R", "t", "distortion"):
                np.testing.assert_allclose(getattr(camera, part), getattr(true, part), atol=1e-9)
            assert camera.size == true.size
        np.testing.assert_allclose(take.truth, written.truth, atol=TOLERANCE[name])
        np.testing.assert_allclose(take.detections[..., :2], written.pixels, atol=TOLERANCE[name])
        assert (take.detections[..., 2] == 1).all()
        np.testing.assert_array_equal(take.frames, written.frames)
        assert all(take.files[part].exists() for part in ("truth", "detections", "cameras"))
    report = datasets.check("human36m", tmp_path)
    assert (report.ok, report.survey.format, report.findings) == (True, name, ())
    assert not report.survey.missing
    assert all(path.exists() for path in report.survey.there)


def test_hourglass_takes_come_back_with_the_joints_that_they_have(tmp_path, recording):
    write.write_hourglass(tmp_path, recording)
    dataset = datasets.read("human36m-hourglass", tmp_path)
    assert [take.subject for take in dataset] == ["S9"] * 4 + ["S11"] * 4
    there = np.arange(17) != sk.layouts.H36M17.joints.index("spine")
    for take, written in zip(dataset, recording.takes, strict=True):
        assert (take.rig.names, take.rig.unit, take.fps) == (write.CAMERAS, "mm", 50.0)
        assert take.rig[1].size == recording.rigs[written.subject][1].size
        np.testing.assert_array_equal(take.truth[:, there], written.truth[:, there])
        np.testing.assert_array_equal(take.detections[:, :, there, :2], written.pixels[:, :, there])
        assert np.isnan(take.truth[:, ~there]).all()
        assert (take.detections[:, :, ~there, 2] == 0).all()
    assert len(datasets.read("human36m-hourglass", tmp_path, subjects=["S11"])) == 4
    report = datasets.check("human36m-hourglass", tmp_path)
    assert (report.ok, report.findings) == (True, ())


def test_detections_kept_apart(tmp_path, recording):
    write.write_skelsplat(tmp_path / "data", recording, detectors=())
    write.write_detections(tmp_path / "2d_resnet152", recording)
    dataset = datasets.read("human36m", tmp_path / "data", detections=tmp_path / "2d_resnet152")
    assert dataset.detector == "resnet152"
    for take, written in zip(dataset, recording.takes, strict=True):
        np.testing.assert_array_equal(take.detections[..., :2], written.pixels)


def test_detectors_are_chosen_by_name_and_takes_without_any_left_out(tmp_path, recording):
    write.write_skelsplat(tmp_path, recording, detectors=("CPN", "ResNet-152"))
    shutil.rmtree(tmp_path / "2d_CPN" / "S11" / "Directions")
    dataset = datasets.read("human36m", tmp_path)
    assert dataset.detector == "resnet152"
    assert dataset.notes == ("detector resnet152 of cpn, resnet152",)
    dataset = datasets.read("human36m", tmp_path, detector="cpn")
    assert (dataset.detector, len(dataset)) == ("cpn", 7)
    assert dataset.notes == ("left out, without detections: S11/Directions",)
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", tmp_path, detector="MeTRAbs")
    assert caught.value.field == "detector"


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
    with pytest.raises(DatasetError, match=r"initial_guess/other/"):
        datasets.read("human36m", tmp_path, monocular="other")


def test_an_occluded_variant_is_a_folder_whose_name_goes_under_the_tables(tmp_path, recording):
    for variant in ("2", "3-hard"):
        write.write_skelsplat(tmp_path / f"human36m-occ-{variant}", recording)
    dataset = datasets.read("human36m-occ", tmp_path / "human36m-occ-3-hard")
    assert dataset.name == "human36m-occ"
    assert "Human3.6M-Occ, human36m-occ-3-hard, skelsplat layout" in dataset.source
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m-occ", tmp_path)
    assert caught.value.field == "format"
