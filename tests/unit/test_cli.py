"""The command line: what it writes and prints, and every way to fail with its status and its one line."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import skelsplat as sk
from command_line import FAST, READ, RESULTS, assert_fails, invoke, succeed
from skelsplat.io import PoseData, read_npz, read_run, write_npz, write_pose
from skelsplat.run import engine
from skelsplat.run import folder as run_folder

T = 5


def test_refine_writes_all_results_and_prints_a_table_of_80_columns(recording, arguments):
    folder, rig, pose = recording
    result = succeed(*arguments, *READ, *FAST)
    assert {path.name for path in (folder / "out").iterdir()} == RESULTS
    written = read_npz(folder / "out" / "pose.npz")
    assert written.unit == "mm"
    assert written.camera_names == rig.names
    # 2 px at a focal length of 1145 px and 5.4 m are 9.4 mm; on three axes √3 of that; four views do better
    assert np.linalg.norm(written.pose - pose, axis=-1).mean() < 16.3
    lines = result.stdout.splitlines()
    # a line may end in the path of the results, which has no place to break
    assert all(len(line) <= 80 for line in lines if "Wrote to" not in line and not line.startswith("/"))
    last_camera = next(line.split() for line in lines if line.split()[:1] == ["cam4"])
    # camera, median "a → b", 90th percentile "a → b", used, missing, rejected, weight
    assert last_camera[7:9] == [str(16 * T), str(T)]
    assert len(last_camera) == 11
    assert 0.25 < float(last_camera[10]) <= 1.0
    assert "Estimated noise of the detections: " in result.stdout
    assert "Error bars, one standard deviation per axis: median " in result.stdout
    assert "5 frames of 17 joints, " in result.stdout
    assert "\x1b[" not in result.stdout


def test_paper_runs_the_papers_preset(folder, arguments):
    result = succeed(*arguments, *READ, *FAST, "--paper", "--fps", 50)
    assert "Solved frame by frame, as always with the method paper." in result.stdout
    assert {path.name for path in (folder / "out").iterdir()} == RESULTS
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["settings"] == sk.RefineConfig.paper(max_steps=30).to_dict()
    assert "Error bars" in result.stdout


def test_an_initial_pose_is_read_in_its_own_unit(recording, arguments):
    folder, rig, pose = recording
    start = PoseData(pose / 1000.0, tuple(sk.layouts.H36M17.joints), np.arange(T), "m")
    write_npz(folder / "start.npz", start)
    alone = ["--fps", 50, "--frame-by-frame", "--max-steps", 0]
    succeed(*arguments, *READ, *alone, "--init", folder / "start.npz")
    written = read_npz(folder / "out" / "pose.npz")
    np.testing.assert_allclose(written.init_pose, pose, rtol=1e-12)  # one division and one product
    assert rig.unit == written.unit


@pytest.mark.parametrize(
    ("option", "extra"),
    [
        ("--layout", ["--unit", "mm"]),
        ("--unit", ["--unit", "inch"]),
        ("--people", [*READ, "--people", "0"]),
        ("--sigma-mm", [*READ, "--sigma-mm", "-1"]),
        ("--fps", [*READ, "--fps", "nan"]),
        ("--init-sigma-mm", [*READ, "--init-sigma-mm", "40"]),
        ("--max-steps", [*READ, "--max-steps", "many"]),
        ("--write", [*READ, "--write", "csv,xls"]),
        ("No such option … --sigmas", [*READ, "--sigmas", "3"]),
    ],
)
def test_bad_usage_is_status_2_and_names_the_option(folder, arguments, option, extra):
    assert_fails(invoke(*arguments, *extra), 2, *f"error: {option}".split(" … "), "see", "--help")
    assert not (folder / "out").exists()


@pytest.mark.parametrize("name", ["Calib.toml", "openpose"])
def test_a_missing_file_is_status_1_and_named(folder, arguments, name):
    (folder / name).rename(folder / "elsewhere")
    assert_fails(invoke(*arguments, *READ), 1, str(folder / name))


@pytest.mark.parametrize("given", [["-o", ""], ["--output", ""], ["--output="]])
def test_an_empty_output_is_not_the_current_folder(folder, monkeypatch, given):
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    files = [folder / "Calib.toml", folder / "openpose"]
    assert_fails(invoke("refine", *files, *READ, *given), 2, "expected a value, got an empty text")
    (folder / "run.toml").write_text('output = ""')
    assert_fails(invoke("refine", *files, *READ, "--config", "run.toml"), 2, "output: expected a path")
    assert sorted(folder.iterdir()) == sorted([*before, folder / "run.toml"])


@pytest.mark.parametrize("command", ["refine", "demo"])
def test_an_output_folder_below_a_file_is_status_1_before_the_work(folder, arguments, monkeypatch, command):
    (folder / "file").write_text("")
    monkeypatch.setattr(engine, "open_files", lambda *_: pytest.fail("the input was read"))
    bad = folder / "file" / "out"
    args = [*arguments, *READ, "-o", bad] if command == "refine" else ["demo", "-o", bad]
    assert_fails(invoke(*args), 1, str(bad), "output", "expected a folder that can be written")


def test_a_result_that_cannot_be_written_is_status_1(folder, arguments, monkeypatch):

    def write(path, data, **options):
        if path.suffix == ".csv":
            raise OSError(28, "No space left on device", str(path))
        write_pose(path, data, **options)

    monkeypatch.setattr(run_folder, "write_pose", write)
    assert_fails(invoke(*arguments, *READ, *FAST), 1, "pose.csv: no space left")
    assert read_npz(folder / "out" / "pose.npz").pose.shape == (T, 17, 3)


@pytest.mark.parametrize("people", [[], ["--people", "all"]])
def test_ctrl_c_while_files_are_written_says_that_the_folder_is_unfinished(
    folder, arguments, monkeypatch, people
):

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("skelsplat.run.folder.write_pose", interrupted)
    result = invoke(*arguments, *READ, *FAST, *people)
    assert result.exit_code == 130
    assert result.stderr.splitlines()[-1] == f"interrupted; {folder / 'out'} is unfinished: run it again"
    with pytest.raises(sk.DatasetError, match="unfinished"):
        read_run(folder / "out")


def test_a_defect_keeps_its_traceback(arguments, monkeypatch):
    monkeypatch.setattr(engine, "open_files", lambda *_: 1 / 0)
    assert isinstance(invoke(*arguments, *READ).exception, ZeroDivisionError)


def test_version_and_python_m():
    assert invoke("--version").stdout == f"skelsplat {sk.__version__}\n"
    run = subprocess.run(
        [sys.executable, "-m", "skelsplat", "nope"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 2
    assert run.stderr.startswith("error: No such command 'nope'")
    assert run.stderr.count("\n") == 1


def test_the_demo_with_the_cameras_as_calibrated_doubts_the_one_that_was_turned(tmp_path):
    invoke("demo", "--no-adjust", "-o", tmp_path, "--quiet")
    report = json.loads((tmp_path / "report.json").read_text())
    assert "cameras_adjusted" not in report
    assert ["cam_03"] in [one["subject"].get("cameras") for one in report["findings"]]


def test_a_failure_leaves_an_output_folder_as_it_was(recording, arguments):
    folder, rig, _ = recording
    (folder / "openpose" / rig.names[0] / "000001_keypoints.json").write_text("[")
    nested = folder / "results" / "walk"
    assert invoke(*arguments, *READ, "-o", nested).exit_code == 1
    assert not (folder / "results").exists()
    (folder / "results").mkdir()
    (folder / "results" / "notes.txt").write_text("mine")
    assert invoke(*arguments, *READ, "-o", nested).exit_code == 1
    assert [path.name for path in (folder / "results").iterdir()] == ["notes.txt"]
