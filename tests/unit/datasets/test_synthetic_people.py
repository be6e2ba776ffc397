"""``skelsplat synth people`` and its reader: scenes of several people come back as they were made."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from command_line import assert_fails, invoke
from skelsplat import DatasetError, InvalidInputError, datasets, io, synthetic
from skelsplat.cli import app
from skelsplat.datasets._people import nearest_slots
from skelsplat.datasets.synthetic import write_simulated


@pytest.fixture(scope="module")
def made():
    return synthetic.simulate_people_set(3, 4, 2, frames=40, seed=3)


@pytest.fixture
def root(tmp_path, made):
    write_simulated(tmp_path / "data", made)
    return tmp_path / "data"


@pytest.mark.parametrize("detector", ["good", "noisy"])
def test_what_is_written_comes_back(root, made, detector):
    data = datasets.read("synthetic", root, detector=detector)
    assert (data.name, data.detector) == ("people", f"simulated-{detector}")
    assert [scene.key for scene in data.scenes] == ["scene0", "scene1"]
    for read, key in zip(data.scenes, made.scenes, strict=True):
        scene = made.scenes[key][detector]
        assert (read.rig, read.fps, read.names) == (scene.cameras, 30.0, ("person0", "person1", "person2"))
        np.testing.assert_array_equal(read.people, scene.people)
        np.testing.assert_array_equal(read.truth, scene.truth)
        np.testing.assert_array_equal(read.slots, scene.slots())
        np.testing.assert_array_equal(read.detections(), scene.detections())
        np.testing.assert_array_equal(read.optional(2), scene.optional())
        assert not read.optional().any()


def test_the_scenes_are_those_of_simulate_scene(made):
    cameras = made.first.cameras
    meetings = made.parameters["meetings"]
    alone = synthetic.simulate_scene(3, cameras, n_frames=40, meetings=meetings, seed=3001)
    np.testing.assert_array_equal(alone.people, made.scenes["scene1"]["good"].people)


def test_the_people_are_takes_by_oracle_association(root):
    data = datasets.read("synthetic", root)
    assert [take.key for take in data][:3] == [f"scene0/person{q}" for q in range(3)]
    assert datasets.check("synthetic", root).ok
    scene = data.scenes[0]
    for q, take in enumerate(data.takes[:3]):
        there = np.isfinite(scene.truth[q]).any(axis=(1, 2))
        np.testing.assert_array_equal(take.truth, scene.truth[q][there])
        np.testing.assert_array_equal(take.detections[..., :2], scene.detections()[q][there][..., :2])


def test_the_nearest_detection_is_the_own_one_unless_two_are_one(root):
    scene = datasets.read("synthetic", root).scenes[0]
    found = nearest_slots(scene.truth, scene.rig, scene.people)
    assert (found == scene.slots).mean() > 0.99


def test_views_and_frames_can_be_chosen(root):
    scene = datasets.read("synthetic", root, views=["cam2", "cam0"]).scenes[0]
    whole = datasets.read("synthetic", root).scenes[0]
    np.testing.assert_array_equal(scene.people, whole.people[:, [2, 0]])
    np.testing.assert_array_equal(scene.slots, whole.slots[..., [2, 0]])
    few = whole.select(slice(5, 9))
    assert few.frames.tolist() == [5, 6, 7, 8]
    np.testing.assert_array_equal(few.detections(), whole.detections()[:, 5:9])


def test_openpose_files_hold_the_people_of_each_view(tmp_path, made):
    write_simulated(tmp_path / "data", made, openpose=True)
    folder = tmp_path / "data" / "takes" / "scene0" / "openpose_simulated_good"
    scene = made.scenes["scene0"]["good"]
    read = io.read_openpose(folder, scene.cameras, layout="h36m17")
    there = np.isfinite(scene.people[..., 0]).any(axis=-1)
    np.testing.assert_array_equal(np.isfinite(read.people[..., 0]).any(axis=-1).sum(-1), there.sum(-1))


def test_a_file_that_does_not_fit_is_refused(root):
    path = root / "takes" / "scene1" / "people_simulated_good.npz"
    with np.load(path) as archive:
        arrays = dict(archive)
    for changes, message in (
        ({"people": arrays["people"][:, :3]}, r"people: expected shape \(40, 4, P, 17, 3\), got \(40, 3"),
        ({"owner": arrays["owner"][..., :1]}, r"owner: expected shape \(40, 4, "),
        ({"frames": arrays["frames"] + 1}, "frames: expected those of truth.npz"),
    ):
        np.savez(path, **{**arrays, **changes})
        with pytest.raises(DatasetError, match=rf"scene1/people_simulated_good.npz: {message}"):
            datasets.read("synthetic", root)
    path.unlink()
    assert datasets.check("synthetic", root).survey.missing == [(path, "detections")]


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"people": 1}, "people: expected an integer from 2 to 6, got 1"),
        ({"views": 9}, "views: expected an integer from 3 to 8, got 9"),
        ({"scenes": 0}, "scenes: expected an integer from 1 to 1000, got 0"),
        ({"frames": 1}, "frames: expected an integer >= 2, got 1"),
        ({"seed": -1}, "seed: expected an integer >= 0, got -1"),
    ],
)
def test_numbers_out_of_range_are_refused(numbers, message):
    with pytest.raises(InvalidInputError, match=message):
        synthetic.simulate_people_set(**numbers)


def test_the_command(tmp_path):
    def run(*arguments):
        return CliRunner().invoke(app, ["synth", *arguments])

    small = ["people", str(tmp_path / "data"), "--people", "2", "--views", "3", "--scenes", "1", "--frames"]
    result = run(*small, "5")
    assert result.exit_code == 0, result.output
    assert "2 people, 3 views, 1 scene of 5 frames, detectors good and noisy, seed 0" in result.output
    result = run(*small, "5", "--force", "--json")
    assert json.loads(result.stdout)["parameters"]["people"] == 2
    assert "--people: expected an integer from 2 to 6" in run("people", "x", "--people", "9").output
    for wrong, said in (
        (["dome", "x", "--views", "4"], "--views: does not apply to dome, only to people"),
        (
            ["people", "x", "--poses", "4"],
            "--poses: does not apply to people; the length of its scenes",
        ),
    ):
        assert_fails(invoke("synth", *wrong), 2, said)
