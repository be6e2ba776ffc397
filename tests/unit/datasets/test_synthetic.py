"""``skelsplat synth`` and its reader: what is written comes back; folders are whole or not there."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from command_line import assert_fails, invoke, succeed
from skelsplat import DatasetError, datasets, io, synthetic
from skelsplat.datasets.shelf_campus import nearest_slots
from skelsplat.datasets.synthetic import write_simulated
from sweeps import swept

TAKE = "S9/Directions"


@pytest.fixture(scope="module")
def made():
    return synthetic.simulate_set("human36m-like-occ-2", poses=120, seed=7)


@pytest.fixture
def root(tmp_path, made):
    write_simulated(tmp_path / "data", made)
    return tmp_path / "data"


@pytest.fixture(scope="module")
def met():
    return synthetic.simulate_people_set(3, 4, 2, frames=40, seed=3)


@pytest.fixture
def people(tmp_path, met):
    write_simulated(tmp_path / "people", met, openpose=True)
    return tmp_path / "people"


def refused(root, file, field):
    with pytest.raises(DatasetError) as caught:
        datasets.read("synthetic", root)
    assert (caught.value.path.name, caught.value.field) == (file, field)


def edit(path, **changes):
    with np.load(path) as archive:
        arrays = dict(archive) | changes
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("name", "detector"),
    [("dome", "good"), ("human36m-like", "noisy"), *(swept(name, "good") for name in synthetic.set_names)],
)
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
        truth, arrays = recording.arrays["truth"], recording.arrays
        np.testing.assert_array_equal(take.frames, recording.frames)
        np.testing.assert_array_equal(take.truth, truth["poses"])
        np.testing.assert_array_equal(take.boxes, truth["boxes"])
        np.testing.assert_array_equal(take.monocular, arrays["monocular_simulated"]["poses"])
        np.testing.assert_array_equal(
            take.detections, arrays[f"detections_simulated_{detector}"]["detections"]
        )


def test_views_can_be_chosen(root):
    take = datasets.read("synthetic", root, views=["cam3", "cam1"]).takes[0]
    whole = datasets.read("synthetic", root).takes[0]
    assert take.rig.names == ("cam3", "cam1")
    for part in ("detections", "monocular", "boxes"):
        np.testing.assert_array_equal(getattr(take, part), getattr(whole, part)[:, [2, 0]])
    assert datasets.read("synthetic", root, views=2).takes[0].rig.names == ("cam1", "cam2")
    for views in (5, ["cam1", "cam1"], ["cam9"]):
        with pytest.raises(sk.InvalidInputError, match="views: "):
            datasets.read("synthetic", root, views=views)


def test_files_are_not_touched(tmp_path, made):
    root = tmp_path / "data"
    root.mkdir()
    (root / "thesis.tex").write_text("mine")
    for target in (root, root / "thesis.tex"):
        with pytest.raises(DatasetError) as caught:
            write_simulated(target, made)
        assert caught.value.field == "output"
    assert [path.name for path in tmp_path.rglob("*")] == ["data", "thesis.tex"]


def test_openpose_files_are_what_our_reader_reads(tmp_path, made):
    write_simulated(tmp_path / "data", made, openpose=True)
    recording, rig = made.recordings[0], made.rigs["room"]
    folder = tmp_path / "data" / "takes" / recording.key / "openpose_simulated_noisy"
    read = io.read_detections(folder, rig, layout="h36m17")
    np.testing.assert_array_equal(read.frames, recording.frames)
    written = recording.arrays["detections_simulated_noisy"]["detections"]
    np.testing.assert_allclose(read.people[:, :, 0, :, :2], written[..., :2], atol=5e-4)


def test_an_empty_folder_lacks_the_index(tmp_path):
    report = datasets.check("synthetic", tmp_path)
    assert [path for path, _ in report.survey.missing] == [tmp_path / "dataset.json"]
    refused(tmp_path, "dataset.json", "file")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda index: index.update(format="other"), "format"),
        (lambda index: index.pop("takes"), "takes"),
        (lambda index: index["takes"][1].pop("subject"), "takes[1].subject"),
        (lambda index: index["takes"][1].update(cameras="hall"), "takes[1].cameras"),
        (lambda index: index["detectors"].remove("good"), "detectors"),
    ],
)
def test_a_wrong_index_is_refused(root, change, field):
    index = json.loads((root / "dataset.json").read_text())
    change(index)
    (root / "dataset.json").write_text(json.dumps(index))
    refused(root, "dataset.json", field)


def test_files_that_do_not_fit_are_refused(root):
    path = root / "takes" / TAKE / "detections_simulated_good.npz"
    whole = path.read_bytes()
    with np.load(path) as archive:
        detections, frames = archive["detections"], archive["frames"]
    for changes in ({"detections": detections[:, :3]}, {"frames": frames + 64}):
        edit(path, **changes)
        refused(root, path.name, next(iter(changes)))
    path.write_bytes(whole[: len(whole) // 2])
    refused(root, path.name, "file")


@pytest.mark.parametrize("detector", ["good", "noisy"])
def test_people_who_are_written_come_back(people, met, detector):
    data = datasets.read("synthetic", people, detector=detector)
    assert (data.name, data.detector) == ("people", f"simulated-{detector}")
    assert [scene.key for scene in data.scenes] == ["scene0", "scene1"]
    assert datasets.check("synthetic", people, detector=detector).ok
    cameras, meetings = met.rigs["ring"], met.parameters["meetings"]
    crowding = synthetic.Crowding() if detector == "good" else synthetic.Crowding.heavy()
    for k, read in enumerate(data.scenes):
        options = {"n_frames": 40, "meetings": meetings, "crowding": crowding, "seed": 3000 + k}
        scene = synthetic.simulate_scene(3, cameras, **options)
        assert (read.rig, read.fps, read.names) == (cameras, 30.0, ("person0", "person1", "person2"))
        np.testing.assert_array_equal(read.people, scene.people)
        np.testing.assert_array_equal(read.truth, scene.truth)
        np.testing.assert_array_equal(read.slots, scene.slots())
        np.testing.assert_array_equal(read.detections(), scene.detections())
        np.testing.assert_array_equal(read.optional(2), scene.optional())
        found = nearest_slots(read.truth, read.rig, read.people)
        assert (found == read.slots).mean() > (0.99 if detector == "good" else 0.8)
    scene = data.scenes[0]
    for q, take in enumerate(data.takes[:3]):
        assert take.key == f"scene0/person{q}"
        there = np.isfinite(scene.truth[q]).any(axis=(1, 2))
        np.testing.assert_array_equal(take.truth, scene.truth[q][there])
        np.testing.assert_array_equal(take.detections[..., :2], scene.detections()[q][there][..., :2])


def test_a_missing_file_of_people_is_listed(people):
    path = people / "takes" / "scene1" / "people_simulated_good.npz"
    path.unlink()
    assert datasets.check("synthetic", people).survey.missing == [(path, "detections")]


def test_the_command(tmp_path):
    small = ["people", str(tmp_path / "data"), "--people", "2", "--views", "3", "--scenes", "1", "--frames"]
    result = succeed("synth", *small, "5")
    assert "people 2, views 3, scenes 1, frames 5, detectors good and noisy, seed 0" in result.output
    small[1] += "2"
    result = invoke("synth", *small, "5", "--json")
    assert json.loads(result.stdout)["parameters"]["people"] == 2
    assert_fails(invoke("synth", "people", "x", "--people", "9"), 2, "--people")
    assert_fails(invoke("synth", "dome", "x", "--views", "4"), 2, "--views")
    assert_fails(invoke("synth", "people", "x", "--poses", "4"), 2, "--poses")
