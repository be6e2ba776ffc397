"""``skelsplat synth`` and its reader: what is written comes back; folders are whole or not there."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import skelsplat as sk
from skelsplat import DatasetError, datasets, io, synthetic
from skelsplat.cli import app
from skelsplat.datasets import synthetic as on_disk
from skelsplat.datasets.synthetic import write_simulated
from sweeps import diagonal

NAME = "human36m-like-occ-2"
TAKE = "S9/Directions"


@pytest.fixture(scope="module")
def made():
    return synthetic.simulate_set(NAME, poses=120, seed=7)


@pytest.fixture
def root(tmp_path, made):
    write_simulated(tmp_path / "data", made)
    return tmp_path / "data"


def edit(path, **changes):
    with np.load(path) as archive:
        arrays = dict(archive) | changes
    np.savez(path, **arrays)


def edit_index(root, change):
    index = json.loads((root / "dataset.json").read_text())
    change(index)
    (root / "dataset.json").write_text(json.dumps(index))


@pytest.mark.parametrize(("name", "detector"), diagonal(synthetic.set_names, ["good", "noisy"]))
def test_what_is_written_comes_back(tmp_path, name, detector):
    made = synthetic.simulate_set(name, poses=70)
    write_simulated(tmp_path / "data", made)
    data = datasets.read("synthetic", tmp_path / "data", detector=detector)
    assert (data.name, data.layout, len(data)) == (name, made.layout, len(made.recordings))
    assert "simulated" in data.source
    assert data.detector == f"simulated-{detector}"
    for take, recording in zip(data, made.recordings, strict=True):
        assert (take.key, take.subject, take.action) == (recording.key, recording.subject, recording.action)
        assert take.rig == made.rigs[recording.rig_name]
        for part in ("frames", "truth", "boxes", "monocular"):
            np.testing.assert_array_equal(getattr(take, part), getattr(recording, part))
        np.testing.assert_array_equal(take.detections, recording.detections[detector])
        assert (take.visible is None) == (recording.visible is None)
        if take.visible is not None:
            np.testing.assert_array_equal(take.visible, recording.visible)


def test_views_can_be_chosen(root):
    take = datasets.read("synthetic", root, views=["cam3", "cam1"]).takes[0]
    whole = datasets.read("synthetic", root).takes[0]
    assert take.rig.names == ("cam3", "cam1")
    for part in ("detections", "monocular", "boxes", "visible"):
        np.testing.assert_array_equal(getattr(take, part), getattr(whole, part)[:, [2, 0]])
    assert datasets.read("synthetic", root, views=2).takes[0].rig.names == ("cam1", "cam2")
    with pytest.raises(DatasetError, match=r"room.json: cameras: expected at least 5 cameras, got 4"):
        datasets.read("synthetic", root, views=5)
    with pytest.raises(sk.InvalidInputError, match="views: expected at least one camera and none twice"):
        datasets.read("synthetic", root, views=[1, 1])


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    runner = CliRunner()
    for name in "ab":
        result = runner.invoke(app, ["synth", "human36m-like", str(tmp_path / name), "--seed", "5"])
        assert result.exit_code == 0, result.output
    assert "human36m-like (simulated), 2181 poses in 60 takes" in result.output
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert len(files) == 1 + 2 + 60 * 4
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_calibration_and_openpose_are_readable_as_such(tmp_path, made):
    write_simulated(tmp_path / "data", made, openpose=True)
    rig = io.read_calibration(tmp_path / "data" / "cameras" / "room.toml", unit="mm")
    for camera, given in zip(rig, made.rigs["room"], strict=True):
        np.testing.assert_allclose(camera.R, given.R, atol=1e-12)
        np.testing.assert_array_equal(camera.distortion, given.distortion)
    recording = made.recordings[0]
    folder = tmp_path / "data" / "takes" / recording.key / "openpose_simulated_noisy"
    read = io.read_openpose(folder, rig, layout="h36m17")
    np.testing.assert_array_equal(read.frames, recording.frames)
    np.testing.assert_allclose(read.people[:, :, 0, :, :2], recording.detections["noisy"][..., :2], atol=5e-4)


def test_a_folder_with_files_is_not_touched(tmp_path, made):
    root = tmp_path / "data"
    root.mkdir()
    (root / "thesis.tex").write_text("mine")
    for force, expected in ((False, "no folder or an empty one"), (True, "a simulated data set to replace")):
        with pytest.raises(DatasetError, match=rf"data: output: expected {expected}"):
            write_simulated(root, made, force=force)
    assert [path.name for path in tmp_path.rglob("*")] == ["data", "thesis.tex"]


def test_a_simulated_set_is_replaced_only_when_asked(root):
    other = synthetic.simulate_set("dome", poses=12)
    with pytest.raises(DatasetError, match="--force replaces"):
        write_simulated(root, other)
    write_simulated(root, other, force=True)
    assert datasets.read("synthetic", root).name == "dome"
    assert [path.name for path in root.parent.iterdir()] == ["data"]


def test_a_write_that_is_interrupted_leaves_nothing(tmp_path, made, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(on_disk, "_index_of", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_simulated(tmp_path / "data", made)
    assert list(tmp_path.iterdir()) == []


def test_all_is_well(root):
    report = datasets.check("synthetic", root)
    assert report.ok
    assert report.findings == ()
    assert len(report.survey.there) == 2 + 60 * 3


def test_an_empty_folder_lacks_the_index(tmp_path):
    report = datasets.check("synthetic", tmp_path)
    assert report.survey.missing == [(tmp_path / "dataset.json", "index of a simulated data set")]
    with pytest.raises(DatasetError, match=r"dataset.json: file: expected a readable file, got no such file"):
        datasets.read("synthetic", tmp_path)


def test_an_unknown_detector_is_refused(root):
    with pytest.raises(DatasetError, match=r"dataset.json: detectors: expected the detector 'cpn', got good"):
        datasets.read("synthetic", root, detector="cpn")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda index: index.update(format="other"), "format: expected skelsplat-simulated, got 'other'"),
        (lambda index: index.update(format_version=2), "format_version: expected 1, got 2"),
        (lambda index: index.update(layout="h36m18"), "layout: expected one of .* got 'h36m18'"),
        (lambda index: index["joints"].reverse(), "joints: expected those of h36m17"),
        (lambda index: index.pop("takes"), "takes: expected a list of takes, got nothing"),
        (lambda index: index["takes"][1].pop("subject"), r"takes\[1\].subject: expected a text, got nothing"),
        (
            lambda index: index["takes"][1].update(cameras="hall"),
            r"takes\[1\].cameras: expected one of room",
        ),
        (
            lambda index: index["takes"][1].update(key="../x"),
            r"takes\[1\].key: expected a folder beneath takes",
        ),
    ],
)
def test_a_wrong_index_is_refused(root, change, message):
    edit_index(root, change)
    with pytest.raises(DatasetError, match=f"dataset.json: {message}"):
        datasets.read("synthetic", root)


def test_files_that_do_not_fit_are_refused(root):
    take = root / "takes" / TAKE
    path = take / "detections_simulated_good.npz"
    whole = path.read_bytes()
    with np.load(path) as archive:
        detections, frames = archive["detections"], archive["frames"]
    for changes, message in (
        ({"detections": detections[:, :, :16]}, r"detections: expected shape \(2, 4, 17, 3\)"),
        ({"detections": detections[:, :3]}, r"detections: expected shape \(2, 4, 17, 3\)"),
        ({"frames": frames + 64}, r"frames: expected those of truth.npz"),
    ):
        edit(path, **changes)
        with pytest.raises(DatasetError, match=rf"Directions/detections_simulated_good.npz: {message}"):
            datasets.read("synthetic", root)
        path.write_bytes(whole)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match=r"good.npz: file: expected a complete npz file"):
        datasets.read("synthetic", root)


def test_metres_and_exchanged_sides_are_refused(root):
    path = root / "takes" / TAKE / "truth.npz"
    with np.load(path) as archive:
        truth = archive["poses"]
    edit(path, poses=truth / 1000.0)
    with pytest.raises(DatasetError, match=r"Directions/truth.npz: truth: expected joints in mm"):
        datasets.read("synthetic", root)
    order = np.arange(17)
    for left, right in sk.layouts.H36M17.left_right:
        order[[left, right]] = right, left
    edit(path, poses=truth[:, order])
    with pytest.raises(DatasetError, match="left and right: expected the same sides"):
        datasets.read("synthetic", root)


def test_a_missing_camera_value_is_refused(root):
    path = root / "cameras" / "room.json"
    document = json.loads(path.read_text())
    document["cameras"][2]["R"][0] = [0.0, 0.0, 0.0]
    path.write_text(json.dumps(document))
    with pytest.raises(DatasetError, match=r"room.json: cameras\[2\]: expected a camera"):
        datasets.read("synthetic", root)
    del document["cameras"][2]["K"]
    path.write_text(json.dumps(document))
    with pytest.raises(DatasetError, match=r"room.json: cameras\[2\].K: expected 3×3 numbers, got nothing"):
        datasets.read("synthetic", root)


def test_a_camera_that_lacks_is_a_fault_of_the_file_of_cameras(root):
    (path,) = (root / "cameras").glob("*.json")
    document = json.loads(path.read_text())
    document["cameras"].pop()
    path.write_text(json.dumps(document))
    with pytest.raises(DatasetError, match="expected 4 cameras, one per view of the takes, got 3") as error:
        datasets.read("synthetic", root)
    assert error.value.path == path
