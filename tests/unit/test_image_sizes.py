"""Detections of images of another size than the calibration's, as ``detect.json`` or other files say."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import detection_files
import skelsplat as sk
from command_line import READ, invoke, read_report, succeed
from skelsplat import synthetic
from skelsplat.io import read_npz
from skelsplat.io.detections import open_detections
from skelsplat.io.detections._record import Record, Video, write_record
from skelsplat.run import Job, run_batch
from skelsplat.run.image_sizes import resizing

KINDS = {"image_sizes_differ"}


@pytest.mark.parametrize(
    ("old", "new", "factors"),
    [
        ((960, 540), (1920, 1080), (2, 2)),
        ((1080, 1920), (1088, 1920), (1, 1)),  # blocks of a codec
        ((1080, 1920), (1920, 1080), None),
        ((540, 960), (1088, 1920), (2, 2)),  # half of 1080×1920, which a codec filled up
        ((1088, 1920), (540, 960), (0.5, 0.5)),
        ((320, 256), (1280, 960), None),  # 64 px of the larger image
    ],
)
def test_what_is_a_copy_in_another_size(old, new, factors):
    found = resizing(old, new)
    assert found is None if factors is None else found.tolist() == list(factors)


@pytest.fixture
def detected(recording):
    """Return what states a size for each camera, and divides the detections of some by a factor."""
    folder, rig, _ = recording
    shutil.copytree(folder / "openpose", folder / "pose")
    whole = {name: list(camera.size) for name, camera in zip(rig.names, rig, strict=True)}

    def write(sizes=None, factors=None):
        videos = {name: Video("a.mp4", size, None) for name, size in {**whole, **(sizes or {})}.items()}
        write_record(folder / "pose", Record({"backend": "own"}, "h36m17", videos=videos))
        for name, factor in (factors or {}).items():
            for path in (folder / "pose" / name).iterdir():
                (person,) = json.loads(path.read_text())["people"]
                joints = np.reshape(person["pose_keypoints_2d"], (-1, 3))
                seen = joints[:, 2] > 0
                joints[seen, :2] = (joints[seen, :2] + 0.5) / factor - 0.5
                path.write_text(json.dumps({"people": [{"pose_keypoints_2d": joints.ravel().tolist()}]}))
        return folder

    return write


def refined(folder, detections="pose", *options):
    """Refine; return the findings on sizes, the poses file, and what was printed."""
    out = folder / f"out_{detections}"
    calibration = folder / "Calib.toml"
    result = succeed("refine", calibration, folder / detections, *READ, "--no-html", *options, "-o", out)
    findings = [one for one in read_report(out)["findings"] if one["kind"] in KINDS]
    return findings, out / "pose.npz", result


def assert_same_bits(one, other):
    """Compare all arrays of two pose files, but for ``run``, which names the files."""
    with np.load(one) as arrays, np.load(other) as expected:
        assert arrays.files == expected.files
        differ = {key for key in arrays.files if arrays[key].tobytes() != expected[key].tobytes()}
    assert differ <= {"run"}


def test_half_the_size_is_resized_and_said(detected):
    folder = detected({"cam2": [500, 500], "cam4": [2000, 2004]}, {"cam2": 2, "cam4": 0.5})
    findings, poses, result = refined(folder)
    expected = read_npz(refined(folder, "openpose")[1]).pose
    np.testing.assert_allclose(read_npz(poses).pose, expected, rtol=1e-9)
    half, double = findings
    assert (half["severity"], half["subject"], half["remedy"]) == ("warning", {"cameras": ["cam2"]}, [])
    numbers = {"size": [500, 500], "size_of_camera": [1000, 1000], "cropped": False, "factor": 2.0}
    assert half["numbers"] == numbers
    assert (double["subject"]["cameras"], double["numbers"]["factor"]) == (["cam4"], 0.5)
    assert f"warning: {half['text']}\n" in result.stderr


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ([1002, 1000], "width and height exchanged (is a phone's video turned?): they are used"),
        ([1280, 720], "for 1000×1002, which has another shape: they are used as they are"),
    ],
)
def test_another_shape_is_said_and_left_as_it_is(detected, size, words):
    folder = detected({"cam1": size})
    (finding,), poses, _ = refined(folder)
    assert (finding["kind"], finding["severity"]) == ("image_sizes_differ", "warning")
    assert words in finding["text"]
    assert_same_bits(poses, refined(folder, "openpose")[1])


def test_check_and_adjust_and_people_and_batches_say_it_too(detected):
    folder = detected({"cam2": [500, 500]}, {"cam2": 2})
    files = [folder / "Calib.toml", folder / "pose", *READ]
    result = invoke("check-cameras", *files, "--json")
    assert (result.exit_code, json.loads(result.stdout)["ok"]) == (1, False)
    assert [one["kind"] for one in json.loads(result.stdout)["findings"]] == ["image_sizes_differ"]
    result = invoke("adjust-cameras", *files, "-o", folder / "fixed.toml", "--json")
    assert "image_sizes_differ" in [one["kind"] for one in json.loads(result.stdout)["findings"]]
    findings, _, _ = refined(folder, "pose", "--fps", 50, "--people", "all")
    assert [one["kind"] for one in findings] == ["image_sizes_differ"]
    job = Job(*files[:2], unit="mm", layout="h36m17", write=(), html=False)
    (row,) = run_batch({"walk": job}, folder / "results").rows()
    assert (row["status"], row["findings"]) == ("done", "image sizes differ (cam2)")


def test_other_formats_that_state_a_size(tmp_path):
    rig = synthetic.ring(2)
    people = np.full((3, 2, 1, 17, 3), 9.0)
    people[..., 2] = 0.5
    take = detection_files.Take(people, list(rig.names), list(sk.layouts.COCO17.joints))
    easymocap = detection_files.easymocap(tmp_path / "easymocap", take)
    assert open_detections(easymocap, rig, layout="coco17").sizes == dict.fromkeys(rig.names, (1000, 1000))
    for path in easymocap.rglob("*.json"):
        path.write_text(json.dumps(json.loads(path.read_text())["annots"]))  # as older ones are
    assert open_detections(easymocap, rig, layout="coco17").sizes == {}
