"""``skelsplat synth`` and its reader: what is written comes back; folders are whole or not there."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from command_line import assert_fails, invoke
from skelsplat import DatasetError, datasets, io, synthetic
from skelsplat.datasets._model import nearest_slots
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


def refused(root, file, field):
    with pytest.raises(DatasetError) as caught:
        datasets.read("synthetic", root)
    assert (caught.value.path.name, caught.value.field) == (file, field)


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
    with pytest.raises(DatasetError, match=r"room.json: cameras: "):
        datasets.read("synthetic", root, views=5)
    with pytest.raises(sk.InvalidInputError, match="views: "):
        datasets.read("synthetic", root, views=[1, 1])


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    for name in "ab":
        result = invoke("synth", "human36m-like", str(tmp_path / name), "--seed", "5")
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


def test_an_empty_folder_lacks_the_index(tmp_path):
    report = datasets.check("synthetic", tmp_path)
    assert [path for path, _ in report.survey.missing] == [tmp_path / "dataset.json"]
    refused(tmp_path, "dataset.json", "file")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda index: index.update(format="other"), "format"),
        (lambda index: index.update(format_version=2), "format_version"),
        (lambda index: index.update(layout="h36m18"), "layout"),
        (lambda index: index["joints"].reverse(), "joints"),
        (lambda index: index.pop("takes"), "takes"),
        (lambda index: index["takes"][1].pop("subject"), "takes[1].subject"),
        (lambda index: index["takes"][1].update(cameras="hall"), "takes[1].cameras"),
        (lambda index: index["takes"][1].update(key="../x"), "takes[1].key"),
        (lambda index: index["detectors"].remove("good"), "detectors"),
    ],
)
def test_a_wrong_index_is_refused(root, change, field):
    edit_index(root, change)
    refused(root, "dataset.json", field)


def test_files_that_do_not_fit_are_refused(root):
    path = root / "takes" / TAKE / "detections_simulated_good.npz"
    whole = path.read_bytes()
    with np.load(path) as archive:
        detections, frames = archive["detections"], archive["frames"]
    for changes in ({"detections": detections[:, :3]}, {"frames": frames + 64}):
        edit(path, **changes)
        refused(root, path.name, next(iter(changes)))
        path.write_bytes(whole)
    path.write_bytes(whole[: len(whole) // 2])
    refused(root, path.name, "file")


def test_exchanged_sides_and_cameras_that_do_not_fit_are_refused(root):
    path = root / "takes" / TAKE / "truth.npz"
    whole = path.read_bytes()
    with np.load(path) as archive:
        truth = archive["poses"]
    order = np.arange(17)
    for left, right in sk.layouts.H36M17.left_right:
        order[[left, right]] = right, left
    edit(path, poses=truth[:, order])
    refused(root, "detections_simulated_good.npz", "left and right")
    path.write_bytes(whole)
    path = root / "cameras" / "room.json"
    document = json.loads(path.read_text())
    lost = document["cameras"].pop()
    path.write_text(json.dumps(document))
    refused(root, "room.json", "cameras")  # 4 views of the takes, 3 cameras
    document["cameras"].append({**lost, "R": np.zeros((3, 3)).tolist()})
    path.write_text(json.dumps(document))
    refused(root, "room.json", "cameras[3]")


@pytest.fixture(scope="module")
def met():
    return synthetic.simulate_people_set(3, 4, 2, frames=40, seed=3)


@pytest.fixture
def people(tmp_path, met):
    write_simulated(tmp_path / "people", met, openpose=True)
    return tmp_path / "people"


@pytest.mark.parametrize("detector", ["good", "noisy"])
def test_people_who_are_written_come_back(people, met, detector):
    data = datasets.read("synthetic", people, detector=detector)
    assert (data.name, data.detector) == ("people", f"simulated-{detector}")
    assert [scene.key for scene in data.scenes] == ["scene0", "scene1"]
    assert datasets.check("synthetic", people, detector=detector).ok
    for read, meeting in zip(data.scenes, met.recordings, strict=True):
        scene = meeting.scenes[detector]
        assert (read.rig, read.fps, read.names) == (scene.cameras, 30.0, ("person0", "person1", "person2"))
        np.testing.assert_array_equal(read.people, scene.people)
        np.testing.assert_array_equal(read.truth, scene.truth)
        np.testing.assert_array_equal(read.slots, scene.slots())
        np.testing.assert_array_equal(read.detections(), scene.detections())
        np.testing.assert_array_equal(read.optional(2), scene.optional())
        assert not read.optional().any()
        found = nearest_slots(read.truth, read.rig, read.people)
        assert (found == read.slots).mean() > (0.99 if detector == "good" else 0.8)


def test_the_scenes_are_those_of_simulate_scene(met):
    cameras, meetings = met.rigs["ring"], met.parameters["meetings"]
    alone = synthetic.simulate_scene(3, cameras, n_frames=40, meetings=meetings, seed=3001)
    np.testing.assert_array_equal(alone.people, met.recordings[1].scenes["good"].people)


def test_the_people_are_takes_by_oracle_association(people):
    data = datasets.read("synthetic", people)
    assert [take.key for take in data][:3] == [f"scene0/person{q}" for q in range(3)]
    scene = data.scenes[0]
    for q, take in enumerate(data.takes[:3]):
        there = np.isfinite(scene.truth[q]).any(axis=(1, 2))
        np.testing.assert_array_equal(take.truth, scene.truth[q][there])
        np.testing.assert_array_equal(take.detections[..., :2], scene.detections()[q][there][..., :2])


def test_views_and_frames_of_people_can_be_chosen(people):
    scene = datasets.read("synthetic", people, views=["cam2", "cam0"]).scenes[0]
    whole = datasets.read("synthetic", people).scenes[0]
    np.testing.assert_array_equal(scene.people, whole.people[:, [2, 0]])
    np.testing.assert_array_equal(scene.slots, whole.slots[..., [2, 0]])
    few = whole.select(slice(5, 9))
    assert few.frames.tolist() == [5, 6, 7, 8]
    np.testing.assert_array_equal(few.detections(), whole.detections()[:, 5:9])


def test_openpose_files_hold_the_people_of_each_view(people, met):
    scene = met.recordings[0].scenes["good"]
    folder = people / "takes" / "scene0" / "openpose_simulated_good"
    read = io.read_openpose(folder, scene.cameras, layout="h36m17")
    there = np.isfinite(scene.people[..., 0]).any(axis=-1)
    np.testing.assert_array_equal(np.isfinite(read.people[..., 0]).any(axis=-1).sum(-1), there.sum(-1))


def test_a_file_of_people_that_does_not_fit_is_refused(people):
    path = people / "takes" / "scene1" / "people_simulated_good.npz"
    with np.load(path) as archive:
        arrays = dict(archive)
    for changes in (
        {"people": arrays["people"][:, :3]},
        {"owner": arrays["owner"][..., :1]},
        {"frames": arrays["frames"] + 1},
    ):
        np.savez(path, **{**arrays, **changes})
        refused(people, path.name, next(iter(changes)))
    path.unlink()
    assert datasets.check("synthetic", people).survey.missing == [(path, "detections")]


def test_the_command(tmp_path):
    small = ["people", str(tmp_path / "data"), "--people", "2", "--views", "3", "--scenes", "1", "--frames"]
    result = invoke("synth", *small, "5")
    assert result.exit_code == 0, result.output
    assert "2 people, 3 views, 1 scene of 5 frames, detectors good and noisy, seed 0" in result.output
    result = invoke("synth", *small, "5", "--force", "--json")
    assert json.loads(result.stdout)["parameters"]["people"] == 2
    assert_fails(invoke("synth", "people", "x", "--people", "9"), 2, "--people")
    assert_fails(invoke("synth", "dome", "x", "--views", "4"), 2, "--views")
    assert_fails(invoke("synth", "people", "x", "--poses", "4"), 2, "--poses")
