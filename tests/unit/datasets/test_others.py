"""CMU Panoptic, Occlusion-Person, Shelf and Campus come back as they were written."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import datasets
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
