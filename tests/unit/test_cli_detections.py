"""Any tool's detections on the command line: the same poses as from OpenPose folders."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

import skelsplat as sk
from command_line import READ, assert_fails, invoke, read_report, succeed, texts
from detection_cases import CASES
from detection_files import Take
from skelsplat.cli import app
from skelsplat.io import read_detections, read_npz, read_run

OPTIONS = ["--unit", "mm", "--layout", "h36m17", "--fps", "50", "-q"]
JOINTS = sk.layouts.H36M17.joints


def refine(folder, detections, *options):
    args = ["refine", folder / "Calib.toml", detections, "-o", folder / "out", *OPTIONS, *options]
    return CliRunner().invoke(app, [str(arg) for arg in args], env={"COLUMNS": "80"})


@pytest.fixture
def take(recording):
    folder, rig, _ = recording
    people = read_detections(folder / "openpose", rig, layout="h36m17").people
    return Take(people, list(rig.names), list(JOINTS))


def pose(folder):
    return read_npz(folder / "out" / "pose.npz").pose


@pytest.fixture
def expected(folder):
    assert refine(folder, folder / "openpose").exit_code == 0
    return pose(folder)


def written(folder, name, take):
    (folder / name).mkdir()
    return CASES[name].write(folder / name, take)


def report(folder):
    return json.loads((folder / "out" / "report.json").read_text())["input"]


def test_format_order_and_map(folder, take, expected):
    names = ["d", "c", "b", "a"]
    joints = ["root" if joint == "pelvis" else joint for joint in JOINTS]
    path = written(folder, "deeplabcut_csv", Take(take.people, names, joints))
    files = [next(path.glob(f"{name}DLC*.csv")).name for name in names]
    options = ["--format", "DeepLabCut_csv", "--order", ", ".join(files), "--map", "pelvis=root"]
    assert "; --map pelvis=NAME assigns it, --map pelvis=none " in " ".join(
        refine(folder, path, *options[:4]).output.split()
    )
    assert refine(folder, path, *options).exit_code == 0
    np.testing.assert_array_equal(pose(folder), expected)
    assert report(folder)["order"] == files
    assert report(folder)["mapping"] == {"pelvis": "root"}


def test_a_joint_that_the_files_lack(folder, take):
    path = written(folder, "csv", take)
    assert refine(folder, path, "--map", "pelvis=none", "--map", "nose=nose").exit_code == 0
    assert np.isnan(read_npz(folder / "out" / "pose.npz").reprojection_error[:, :, 0]).all()
    assert texts(read_report(folder / "out")) == []


def test_offset_sets_a_clock(recording, expected):
    folder, rig, _ = recording
    path = folder / "openpose" / rig.names[2]
    for file in sorted(path.iterdir()):
        file.rename(file.with_name(f"{int(file.name[:6]) + 20:06d}_keypoints.json"))
    assert refine(folder, folder / "openpose").exit_code == 1
    options = ["--offset", f"{rig.names[2]}=-20", "--offset", f"{rig.names[0]}=0", "--frames", "intersection"]
    assert refine(folder, folder / "openpose", *options).exit_code == 0
    np.testing.assert_array_equal(pose(folder), expected)
    assert report(folder)["offsets"] == {rig.names[2]: -20, rig.names[0]: 0}


@pytest.mark.parametrize(
    "given",
    [
        ("--format", "yolo"),
        ("--offset", "cam1=0.5s"),
        ("--offset", "cam1=1", "--offset", "cam1=2"),
        ("--offset", "cam9=1"),
        ("--map", "nose"),
        ("--map", "tail=x"),
        ("--order", "a,b"),
    ],
)
def test_options_that_do_not_fit_the_files(folder, given):
    result = invoke("check-cameras", folder / "Calib.toml", folder / "openpose", *OPTIONS[:4], *given)
    assert_fails(result, 2, f"error: {given[0]}: ")


@pytest.mark.parametrize("frames", ["strict", "union"])
def test_detections_without_frames_are_named(recording, frames):
    folder, rig, _ = recording
    path = folder / "empty.npz"
    np.savez(path, detections=np.empty((0, len(rig), len(JOINTS), 3)), camera_names=np.array(rig.names))
    result = refine(folder, path, "--frames", frames)
    assert_fails(result, 1, f"error: {path}: frames: expected at least one frame, got none")
    assert not (folder / "out").exists()


# Without a camera.

OUT = "cam3"
KEPT = ("cam1", "cam2", "cam4")


def refine_without(folder, detections, *options):
    args = ["refine", folder / "Calib.toml", detections, "-o", folder / "out", *READ, "--without", OUT]
    return invoke(*args, "--fps", "50", "--frame-by-frame", "-q", "--no-html", *options)


@pytest.fixture
def expected_without(recording):
    """Return the pose of the other three cameras, which OpenPose folders give."""
    folder, rig, _ = recording
    detections = read_detections(folder / "openpose", rig, layout="h36m17").people[:, :, 0]
    kept = [rig.names.index(name) for name in KEPT]
    three = sk.CameraRig([rig[i] for i in kept], unit=rig.unit)
    return sk.refine(None, detections[:, kept], three, layout="h36m17").pose


def test_its_folder_may_have_other_frames(folder, expected_without):
    next((folder / "openpose" / OUT).iterdir()).unlink()
    assert refine_without(folder, folder / "openpose", "--offset", f"{OUT}=3").exit_code == 0
    np.testing.assert_allclose(pose(folder), expected_without, rtol=1e-9)
    assert read_run(folder / "out").rig.names == KEPT
    assert report(folder)["without"] == [OUT]


def test_it_need_not_be_readable_in_the_calibration(folder, expected_without):
    text = (folder / "Calib.toml").read_text()
    before, after = text.split(f'"{OUT}"')
    (folder / "Calib.toml").write_text(f'{before}"{OUT}"{after.replace("rotation", "turned", 1)}')
    assert_fails(invoke("check-cameras", folder / "Calib.toml", *READ[:2]), 1, "rotation")
    assert invoke("check-cameras", folder / "Calib.toml", *READ[:2], "--without", OUT).exit_code == 0
    assert refine_without(folder, folder / "openpose").exit_code == 0
    np.testing.assert_allclose(pose(folder), expected_without, rtol=1e-9)
    assert report(folder)["without"] == [OUT]
    assert_fails(refine_without(folder, folder / "openpose", "--without", "cam9"), 2, "--without")


def test_names_that_are_none_and_too_few_cameras_are_bad_usage(folder):
    result = refine_without(folder, folder / "openpose", "--without", "cam9")
    assert_fails(result, 2, "--without: ", "cam1, cam2, cam3, cam4", "'cam9'")
    result = refine_without(folder, folder / "openpose", "--without", "cam1", "--without", "cam2")
    assert_fails(result, 2, "--without: ", "two cameras or more", "got 1")


def test_check_cameras_leaves_out_a_camera_that_was_not_recorded(folder):
    shutil.rmtree(folder / "openpose" / OUT)
    check = ["check-cameras", folder / "Calib.toml", folder / "openpose", "--layout", "h36m17"]
    assert_fails(invoke(*check), 1, f"none for {OUT}", "--without")
    result = succeed(*check, "--without", "cam_03", "--json")
    assert [row["name"] for row in json.loads(result.stdout)["cameras"]] == list(KEPT)
