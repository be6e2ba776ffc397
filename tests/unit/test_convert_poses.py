"""Pose files into other formats."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from command_line import assert_fails, invoke
from pose_sample import JOINTS, assert_equal, sample
from skelsplat import synthetic
from skelsplat.findings import collected_warnings
from skelsplat.io import (
    read_csv,
    read_json,
    read_npz,
    read_trc,
    write_calibration,
    write_csv,
    write_json,
    write_npz,
    write_trc,
)
from skelsplat.io.poses import convert_poses, is_pose_file


def test_between_formats_that_hold_everything(tmp_path):
    write_npz(tmp_path / "a.npz", sample())
    assert_equal(convert_poses(tmp_path / "a.npz", tmp_path / "b.json"), sample())
    before = (tmp_path / "b.json").read_bytes()
    result = invoke("convert", tmp_path / "a.npz", tmp_path / "b.json")
    assert_fails(result, 1, "b.json: OUTPUT: expected no file of this name (--force replaces it), got one")
    assert (tmp_path / "b.json").read_bytes() == before
    result = invoke("convert", tmp_path / "a.npz", tmp_path / "b.json", "--force")
    assert result.stdout == f"Wrote 4 frames of 3 joints to {tmp_path / 'b.json'}.\n"
    convert_poses(tmp_path / "b.json", tmp_path / "c.npz")
    assert_equal(read_npz(tmp_path / "c.npz"), sample())


def test_options_reach_the_target(tmp_path):
    write_json(tmp_path / "a.json", sample())
    convert_poses(tmp_path / "a.json", tmp_path / "a.trc", fps=25.0, unit="mm", y_up=True)
    back = read_trc(tmp_path / "a.trc")
    assert (back.frame_rate, back.unit) == (25.0, "mm")
    # half a unit of the third decimal
    np.testing.assert_allclose(back.pose[0], sample().pose[0][:, [1, 2, 0]], atol=5.0001e-4)
    convert_poses(tmp_path / "a.trc", tmp_path / "b.json", fps=20.0)
    assert read_json(tmp_path / "b.json").frame_rate == 20.0


def test_every_length_is_in_the_new_unit(tmp_path):
    write_npz(tmp_path / "a.npz", sample())
    convert_poses(tmp_path / "a.npz", tmp_path / "b.json", unit="cm")
    back, data = read_json(tmp_path / "b.json"), sample()
    assert back.unit == "cm"
    for name, factor in {"pose": 0.1, "init_pose": 0.1, "noise": 0.1, "uncertainty": 0.01}.items():
        np.testing.assert_allclose(getattr(back, name), getattr(data, name) * factor, rtol=1e-15)
    np.testing.assert_array_equal(back.reprojection_error, data.reprojection_error)
    for kind, unit in (("trc", "cm"), ("c3d", "m"), ("npz", "in")):
        with pytest.raises(sk.InvalidInputError, match="unit: expected"):
            convert_poses(tmp_path / "b.json", tmp_path / f"c.{kind}", unit=unit)
        command = ["convert", tmp_path / "b.json", tmp_path / f"c.{kind}", "--to-unit", unit]
        assert_fails(invoke(*command), 2, "--to-unit: expected", "got ")


def test_velocities_are_those_at_the_new_frame_rate(tmp_path):
    velocity = np.arange(4 * len(JOINTS) * 3.0).reshape(4, len(JOINTS), 3)
    squares = np.broadcast_to(np.eye(3), (4, len(JOINTS), 3, 3))
    data = replace(sample(), frame_rate=50.0, velocity=velocity, velocity_uncertainty=squares)
    write_npz(tmp_path / "a.npz", data)
    assert invoke("convert", tmp_path / "a.npz", tmp_path / "b.npz", "--fps", 25).exit_code == 0
    found = read_npz(tmp_path / "b.npz")
    assert found.frame_rate == 25.0
    np.testing.assert_array_equal(found.velocity, velocity / 2)
    np.testing.assert_array_equal(found.velocity_uncertainty, squares / 4)


def test_what_does_not_fit_into_the_target_names_the_source(tmp_path):
    write_npz(tmp_path / "a.npz", replace(sample(), joint_names=("a", "b\tc", "d")))
    result = invoke("convert", tmp_path / "a.npz", tmp_path / "a.trc", "--fps", 50)
    assert_fails(result, 1, "a.npz: joint_names: expected names without tabs and line breaks, got 'b\\tc'")
    assert not (tmp_path / "a.trc").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_names": ("a", "b", "a")}, "joint_names: expected different names, got 'a' twice"),
        ({"joint_names": ("a", "b", "c" * 256)}, "joint_names: expected names of at most 255 bytes"),
        ({"frames": np.array([1, 1, 2, 3])}, "frames: expected whole numbers that ascend"),
        ({"frame_rate": 1e9}, r"frame_rate: expected a number from 1e-3 to 1e6, got 1e\+09"),
    ],
)
def test_an_npz_that_could_not_be_read_is_not_written(tmp_path, change, message):
    with pytest.raises(sk.DatasetError, match=rf"a\.npz: {message}"):
        write_npz(tmp_path / "a.npz", replace(sample(), **change))
    assert not any(tmp_path.iterdir())


def test_a_frame_rate_that_the_source_does_not_state_is_asked_for(tmp_path):
    write_csv(tmp_path / "a.csv", replace(sample(), frame_rate=None))
    with pytest.raises(
        sk.DatasetError, match=r"a\.csv: frame rate: expected one for a \.trc file \(--fps\), got"
    ):
        convert_poses(tmp_path / "a.csv", tmp_path / "b.trc")
    convert_poses(tmp_path / "a.csv", tmp_path / "b.trc", fps=50.0)
    assert read_trc(tmp_path / "b.trc").joint_names == JOINTS


def test_a_wrong_frame_rate_is_that_of_the_option(tmp_path):
    write_npz(tmp_path / "a.npz", sample())
    result = invoke("convert", tmp_path / "a.npz", tmp_path / "b.json", "--fps", -5)
    assert_fails(result, 2, "--fps: expected a positive number, got -5")
    for rate in ("1e308", "1e-9"):
        result = invoke("convert", tmp_path / "a.npz", tmp_path / "b.trc", "--fps", rate)
        assert_fails(result, 2, "--fps: expected a number from 0.001 to 1e+06, got 1e")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_what_cannot_be_converted(tmp_path):
    write_npz(tmp_path / "a.npz", sample())
    with pytest.raises(sk.DatasetError, match="target: expected another file than the source"):
        convert_poses(tmp_path / "a.npz", tmp_path / "." / "a.npz")
    with pytest.raises(sk.InvalidInputError, match="path: expected a name that ends in"):
        convert_poses(tmp_path / "a.npz", tmp_path / "a.bvh")
    with pytest.raises(sk.InvalidInputError, match=r"y_up: expected a \.trc or \.c3d file for it"):
        convert_poses(tmp_path / "a.npz", tmp_path / "a.csv", y_up=True)
    with pytest.raises(sk.DatasetError, match=r"b\.npz: file: expected a readable npz file"):
        convert_poses(tmp_path / "b.npz", tmp_path / "b.json")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_pose_files_are_told_from_others_of_the_same_extension(tmp_path):
    data = replace(sample(), frame_rate=50.0)
    for write, name in (
        (write_npz, "a.npz"),
        (write_csv, "a.csv"),
        (write_json, "a.json"),
        (write_trc, "a.trc"),
    ):
        write(tmp_path / name, data)
        assert is_pose_file(tmp_path / name)
    np.savez(tmp_path / "b.npz", detections=np.zeros(3))
    (tmp_path / "b.json").write_text(json.dumps({"cameras": []}))
    (tmp_path / "b.csv").write_text("camera,frame,x\n")
    (tmp_path / "c.npz").write_text("no archive")
    for name in ("b.npz", "b.json", "b.csv", "c.npz", "none.trc", "."):
        assert not is_pose_file(tmp_path / name)


@pytest.mark.parametrize("kept", [0, 300])
def test_a_damaged_npz_is_named(tmp_path, kept):
    write_npz(tmp_path / "whole.npz", sample())
    (tmp_path / "c.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:kept])
    assert_fails(invoke("convert", tmp_path / "c.npz", tmp_path / "o.json"), 1, "c.npz", "npz")
    assert not (tmp_path / "o.json").exists()


def test_another_kind_of_file_is_no_npz_and_nobody_is_told_to_trust_it(tmp_path):
    write_csv(tmp_path / "a.csv", sample())
    with pytest.raises(sk.DatasetError, match=r"file: expected an npz file, got another kind of file, or"):
        read_npz(tmp_path / "a.csv")


def test_a_calibration_is_not_written_over_itself(tmp_path):
    path = tmp_path / "Calib.toml"
    write_calibration(path, synthetic.human36m_like())
    before = path.read_bytes()
    result = invoke("convert", path, tmp_path / "." / "Calib.toml", "--unit", "mm", "--to-unit", "m")
    assert_fails(result, 1, "Calib.toml: target: expected another file than the source, got the same")
    assert path.read_bytes() == before


@pytest.mark.parametrize("options", [("--y-up",), ("--fps", "60"), ()])
def test_the_folder_of_a_run_stands_for_its_poses(tmp_path, options):
    run = tmp_path / "out"
    run.mkdir()
    write_npz(run / "pose.npz", replace(sample(), frame_rate=50.0))
    result = invoke("convert", run, tmp_path / "walk.trc", *options)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    write_npz(tmp_path / "a.npz", replace(sample(), frame_rate=50.0))
    assert invoke("convert", tmp_path / "a.npz", tmp_path / "a.trc", *options).exit_code == 0
    np.testing.assert_array_equal(read_trc(tmp_path / "walk.trc").pose, read_trc(tmp_path / "a.trc").pose)


@pytest.mark.parametrize("options", [("--y-up",), ("--fps", "60"), ("--unit", "m"), ()])
def test_an_input_of_no_kind_is_one_line_whatever_the_options(tmp_path, options):
    (tmp_path / "empty").mkdir()
    (tmp_path / "hello.txt").write_text("hello")
    for name in ("empty", "hello.txt"):
        result = invoke("convert", tmp_path / name, tmp_path / "x.trc", *options)
        assert_fails(result, 1, f"{name}: content: expected a calibration", "the folder of a run")


@pytest.mark.parametrize("options", [("--y-up",), ("--marker-names", "pose2sim")])
def test_an_option_without_a_place_in_the_output_is_bad_usage(tmp_path, options):
    write_npz(tmp_path / "a.npz", sample())
    result = invoke("convert", tmp_path / "a.npz", tmp_path / "a.csv", *options)
    assert_fails(result, 2, f"{options[0]}: expected a ", "got .csv", "see skelsplat convert --help")
    assert not (tmp_path / "a.csv").exists()


def test_a_frame_rate_is_in_the_times_of_a_csv(tmp_path):
    write_npz(tmp_path / "a.npz", replace(sample(), frame_rate=None))
    (tmp_path / "run.toml").write_text("fps = 59.94\n")
    run = ["convert", "--config", tmp_path / "run.toml"]
    assert invoke(*run, tmp_path / "a.npz", tmp_path / "a.csv").exit_code == 0
    assert invoke("convert", tmp_path / "a.csv", tmp_path / "b.trc").exit_code == 0
    assert invoke("convert", tmp_path / "b.trc", tmp_path / "b.csv").exit_code == 0
    rates = [read(tmp_path / name).frame_rate for read, name in ((read_csv, "a.csv"), (read_trc, "b.trc"))]
    assert [*rates, read_csv(tmp_path / "b.csv").frame_rate] == [59.94] * 3


def test_axes_that_are_turned_once_more_are_a_warning(tmp_path):
    write_npz(tmp_path / "a.npz", replace(sample(), frame_rate=50.0))
    for kind, words in (("trc", "does not state which axis is up"), ("c3d", "y is up in it already")):
        turned, again = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
        result = invoke("convert", tmp_path / "a.npz", turned, "--y-up")
        assert (result.exit_code, result.stderr) == (0, "")
        said = invoke("convert", turned, again, "--y-up").stderr
        assert said.startswith("warning: ")
        assert words in said
        with collected_warnings() as found:
            convert_poses(turned, again, fps=50.0, y_up=True)
        assert [one.kind for one in found] == ["axes_unknown" if kind == "trc" else "axes_turned"]
        assert invoke("convert", turned, again, "--force").stderr == ""
    invoke("convert", tmp_path / "a.npz", tmp_path / "up.c3d")
    assert invoke("convert", tmp_path / "up.c3d", tmp_path / "c.c3d", "--y-up").stderr == ""
