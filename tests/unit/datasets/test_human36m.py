"""Human3.6M in both layouts: it comes back as it was written."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import DatasetError, datasets
from writers import human36m as write

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
