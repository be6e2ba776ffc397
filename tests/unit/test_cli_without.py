"""``--without``: a camera is left out of the rig and of every kind of detections."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, assert_fails, invoke
from detection_cases import CASES
from detection_files import Take
from skelsplat.io import read_detections, read_npz, read_run

OUT = "cam3"
KEPT = ("cam1", "cam2", "cam4")
LEFT_OUT = ["--without", OUT, "--fps", "50", "--frame-by-frame", "-q"]


def refine(folder, detections, *options):
    args = ["refine", folder / "Calib.toml", detections, "-o", folder / "out", *READ, *LEFT_OUT]
    return invoke(*args, "--no-html", *options)


def pose(folder):
    return read_npz(folder / "out" / "pose.npz").pose


@pytest.fixture
def expected(recording):
    """Return the pose of the other three cameras, which OpenPose folders give."""
    folder, rig, _ = recording
    detections = read_detections(folder / "openpose", rig, layout="h36m17").people[:, :, 0]
    kept = [rig.names.index(name) for name in KEPT]
    three = sk.CameraRig([rig[i] for i in kept], unit=rig.unit)
    return sk.refine(None, detections[:, kept], three, layout="h36m17").pose


@pytest.mark.parametrize("there", [True, False])
def test_its_folder_may_be_there_or_not(recording, expected, there):
    folder, _, _ = recording
    if there:  # frames of its own would be refused by --frames strict
        next((folder / "openpose" / OUT).iterdir()).unlink()
    else:
        shutil.rmtree(folder / "openpose" / OUT)
    result = refine(folder, folder / "openpose", "--offset", f"{OUT}=3")
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(pose(folder), expected, rtol=1e-9)
    assert read_run(folder / "out").rig.names == KEPT
    stated = json.loads((folder / "out" / "report.json").read_text())["input"]
    assert stated["without"] == [OUT]


@pytest.mark.parametrize("count", [3, 4])
@pytest.mark.parametrize("name", ["coco", "mmpose", "deeplabcut_csv", "npz", "csv"])
def test_every_kind_of_detections_with_all_views_or_without_the_one(recording, expected, name, count):
    folder, rig, _ = recording
    people = read_detections(folder / "openpose", rig, layout="h36m17").people
    kept = range(4) if count == 4 else [rig.names.index(camera) for camera in KEPT]
    (folder / name).mkdir()
    take = Take(people[:, list(kept)], [rig.names[i] for i in kept], list(sk.layouts.H36M17.joints))
    result = refine(folder, CASES[name].write(folder / name, take))
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(pose(folder), expected, rtol=1e-9)


def test_names_that_are_none_and_too_few_cameras_are_bad_usage(recording):
    folder, _, _ = recording
    result = refine(folder, folder / "openpose", "--without", "cam9")
    assert_fails(result, 2, "--without: ", "cam1, cam2, cam3, cam4", "'cam9'")
    result = refine(folder, folder / "openpose", "--without", "cam1", "--without", "cam2")
    assert_fails(result, 2, "--without: ", "two cameras or more", "got 1")
    shutil.rmtree(folder / "openpose" / "cam1")
    said = ["none for cam1", "without="]
    assert_fails(refine(folder, folder / "openpose"), 1, *said)


def test_check_cameras_leaves_out_a_camera_that_was_not_recorded(recording):
    folder, _, _ = recording
    shutil.rmtree(folder / "openpose" / OUT)
    check = ["check-cameras", folder / "Calib.toml", folder / "openpose", "--layout", "h36m17"]
    assert_fails(invoke(*check), 1, f"none for {OUT}", "without=")
    assert_fails(invoke(*check, "--without", "door"), 2, "--without: expected a camera, one of cam1")
    result = invoke(*check, "--without", "cam_03", "--json")
    assert result.exit_code == 0, result.output
    assert [row["name"] for row in json.loads(result.stdout)["cameras"]] == list(KEPT)
