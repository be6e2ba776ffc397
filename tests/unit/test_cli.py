"""The command line: what it writes and prints, and every way to fail with its status and its one line."""

from __future__ import annotations

import html
import json
import os
import subprocess
import sys

import numpy as np
import pytest

import skelsplat as sk
from command_line import FAST, READ, RESULTS, assert_fails, invoke, read_report, texts
from skelsplat import synthetic
from skelsplat.association import take_people
from skelsplat.io import PoseData, read_npz, read_run, read_trc, write_npz, write_pose
from skelsplat.run import engine, solve
from skelsplat.run import folder as run_folder
from skelsplat.run.person import pick_places

T = 5
NOISE_PX = 2.0


def test_refine_writes_all_results(recording, arguments):
    folder, rig, pose = recording
    result = invoke(*arguments, *READ, *FAST)
    assert result.exit_code == 0, result.output
    assert {path.name for path in (folder / "out").iterdir()} == RESULTS
    written = read_npz(folder / "out" / "pose.npz")
    assert written.unit == "mm"
    assert written.camera_names == rig.names
    # 2 px at a focal length of 1145 px and 5.4 m are 9.4 mm; on three axes √3 of that; four views do better
    assert np.linalg.norm(written.pose - pose, axis=-1).mean() < 16.3


def test_the_printed_table_fits_80_columns_and_counts_missing_detections(arguments):
    result = invoke(*arguments, *READ, *FAST)
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


@pytest.mark.painted
def test_paper_runs_the_papers_preset_and_draws_heat_maps(recording, arguments):
    folder, _, _ = recording
    assert invoke(*arguments, *READ, *FAST, "-q").exit_code == 0
    robust = read_npz(folder / "out" / "pose.npz")
    settings = json.loads((folder / "out" / "report.json").read_text())["settings"]
    assert settings["method"] == "annealed"
    result = invoke(*arguments, *READ, *FAST, "--paper", "--fps", 50)
    assert result.exit_code == 0, result.output
    assert "Solved frame by frame, as always with the method paper." in result.stdout
    assert {path.name for path in (folder / "out").iterdir()} == RESULTS | {"heatmaps.png"}
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["settings"]["method"] == "paper"
    assert report["settings"] == sk.RefineConfig.paper(max_steps=30).to_dict()
    paper = read_npz(folder / "out" / "pose.npz")
    assert not np.array_equal(paper.pose, robust.pose)
    assert paper.uncertainty.shape == robust.uncertainty.shape
    assert "Error bars" in result.stdout


def test_an_independent_start_counts_as_an_observation(recording, arguments):
    folder, _, pose = recording
    write_npz(folder / "s.npz", PoseData(pose + 500.0, tuple(sk.layouts.H36M17.joints), np.arange(T), "mm"))
    run = [*arguments, *READ, *FAST, "-q", "--init", folder / "s.npz"]
    assert invoke(*run).exit_code == 0
    without = read_npz(folder / "out" / "pose.npz").pose
    assert invoke(*run, "--init-sigma-mm", "0.001").exit_code == 0
    # a start that is certain to a micrometre stays where it is
    np.testing.assert_allclose(read_npz(folder / "out" / "pose.npz").pose, pose + 500.0, atol=0.1)
    assert np.linalg.norm(without - pose, axis=-1).max() < 100.0


def test_no_swaps_switches_the_search_off(recording, arguments):
    folder, _, _ = recording
    assert invoke(*arguments, *READ, *FAST, "--no-swaps").exit_code == 0
    assert json.loads((folder / "out" / "report.json").read_text())["settings"]["find_swaps"] is False


def test_json_goes_to_stdout_and_quiet_prints_nothing(recording, arguments):
    folder, _, _ = recording
    result = invoke(*arguments, *READ, *FAST, "--json")
    assert json.loads(result.stdout) == json.loads((folder / "out" / "report.json").read_text())
    assert result.stderr == ""
    quiet = invoke(*arguments, *READ, *FAST, "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")


def test_an_unknown_frame_rate_is_a_warning(arguments):
    result = invoke(*arguments, *READ, "--max-steps", 1, "-q")
    assert result.exit_code == 0
    assert result.stderr.startswith("warning: The frame rate is unknown: ")


def test_an_initial_pose_is_read_in_its_own_unit(recording, arguments):
    folder, rig, pose = recording
    start = PoseData(pose / 1000.0, tuple(sk.layouts.H36M17.joints), np.arange(T), "m")
    write_npz(folder / "start.npz", start)
    alone = ["--fps", 50, "--frame-by-frame", "--max-steps", 0]
    result = invoke(*arguments, *READ, *alone, "--init", folder / "start.npz")
    assert result.exit_code == 0, result.output
    written = read_npz(folder / "out" / "pose.npz")
    np.testing.assert_allclose(written.init_pose, pose, rtol=1e-12)  # one division and one product
    assert rig.unit == written.unit


def test_y_up_turns_the_marker_file_only(recording, arguments):
    folder, _, _ = recording
    assert invoke(*arguments, *READ, *FAST, "--y-up").exit_code == 0
    pose = read_npz(folder / "out" / "pose.npz").pose / 1000.0
    markers = read_trc(folder / "out" / "pose.trc").pose
    np.testing.assert_allclose(markers, pose[..., [1, 2, 0]], atol=1e-6)  # the file holds micrometres


@pytest.mark.parametrize(
    ("extra", "parts"),
    [
        (["--unit", "mm"], ["--layout", "has 17 joints per person: ", "h36m17"]),
        (["--unit", "inch"], ["--unit", "'inch'"]),
        (["--unit", "mm", "--layout", "body26"], ["--layout", "h36m17", "'body26'"]),
        ([*READ, "--person", "left"], ["--person", "'left'"]),
        ([*READ, "--frames", "some"], ["--frames", "strict", "'some'"]),
        ([*READ, "--sigma-mm", "-1"], ["--sigma-mm", "positive", "-1"]),
        ([*READ, "--occlusion-sigma-mm", "0"], ["--occlusion-sigma-mm", "positive", "0"]),
        ([*READ, "--fps", "nan"], ["--fps", "positive", "nan"]),
        ([*READ, "--init-sigma-mm", "40"], ["--init-sigma-mm", "requires --init "]),
        ([*READ, "--init", "a.npz", "--init-sigma-mm", "-4"], ["--init-sigma-mm", "positive", "-4"]),
        (
            [*READ, "--paper", "--init", "a.npz", "--init-sigma-mm", "40"],
            ["--init-sigma-mm", "method paper", "got 40"],
        ),
        ([*READ, "--symmetry-tier", "4"], ["--symmetry-tier: expected ", "3", "'4'"]),
        ([*READ, "--max-steps", "many"], ["--max-steps: expected ", "'many'"]),
        ([*READ, "--sigmas", "3"], ["--sigmas"]),
    ],
)
def test_bad_usage_is_status_2(recording, arguments, extra, parts):
    folder, _, _ = recording
    assert_fails(invoke(*arguments, *extra), 2, *parts, "see", "--help")
    assert not (folder / "out").exists()


def test_a_missing_argument_and_an_unknown_command_are_status_2(tmp_path):
    assert_fails(invoke("refine", "-o", tmp_path), 2, "CALIBRATION")
    assert_fails(invoke("refin"), 2, "refin")


def test_a_missing_calibration_is_status_1(recording, arguments):
    folder, _, _ = recording
    (folder / "Calib.toml").unlink()
    assert_fails(invoke(*arguments, *READ), 1, str(folder / "Calib.toml"), "expected", "got")


def test_whether_a_file_is_readable_its_reader_finds_out(arguments, monkeypatch):
    """Not the command line beforehand, whose fault would be one of usage; root may read anything."""
    monkeypatch.setattr(os, "access", lambda *_, **__: False)
    assert invoke(*arguments, *READ, *FAST, "--no-html").exit_code == 0


def test_a_missing_folder_of_detections_is_status_1(recording, arguments):
    folder, _, _ = recording
    (folder / "openpose").rename(folder / "elsewhere")
    assert_fails(invoke(*arguments, *READ), 1, str(folder / "openpose"), "expected", "got")


def test_json_cut_in_half_is_status_1(recording, arguments):
    folder, rig, _ = recording
    path = folder / "openpose" / rig.names[1] / "000003_keypoints.json"
    path.write_text(path.read_text()[:100])
    assert_fails(invoke(*arguments, *READ), 1, str(path), "JSON", "expected", "got")
    assert not (folder / "out").exists()


def test_different_frame_counts_are_status_1_unless_allowed(recording, arguments):
    folder, rig, _ = recording
    (folder / "openpose" / rig.names[2] / "000004_keypoints.json").unlink()
    assert_fails(invoke(*arguments, *READ), 1, "frames", rig.names[2])
    assert invoke(*arguments, *READ, *FAST, "--frames", "intersection").exit_code == 0
    assert len(read_npz(folder / "out" / "pose.npz").frames) == T - 1


def test_a_layout_of_another_number_of_joints_is_status_1(arguments):
    assert_fails(invoke(*arguments, "--unit", "mm", "--layout", "body25"), 1, "expected", "25", "17")


def test_an_initial_pose_of_another_length_is_status_1(recording, arguments):
    folder, _, pose = recording
    write_npz(folder / "s.npz", PoseData(pose[:2], tuple(sk.layouts.H36M17.joints), np.arange(2), "mm"))
    result = invoke(*arguments, *READ, "--fps", 50, "--init", folder / "s.npz")
    assert_fails(result, 1, str(folder / "s.npz"), "pose", "(5, 17, 3)", "(2, 17, 3)")


def test_a_person_that_is_not_there_is_status_2(arguments):
    assert_fails(
        invoke(*arguments, *READ, "--person", 7), 2, "--person: expected less than 1 (no file has more", "7"
    )


@pytest.mark.parametrize("given", [["-o", ""], ["--output", ""], ["--output="]])
def test_an_empty_output_is_not_the_current_folder(recording, monkeypatch, given):
    folder, _, _ = recording
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    files = [folder / "Calib.toml", folder / "openpose"]
    assert_fails(invoke("refine", *files, *READ, *given), 2, "--output: expected a path, got an empty text")
    (folder / "run.toml").write_text('output = ""')
    assert_fails(
        invoke("refine", *files, *READ, "--config", "run.toml"), 2, "output: expected a path, as text"
    )
    assert sorted(folder.iterdir()) == sorted([*before, folder / "run.toml"])


@pytest.mark.parametrize("command", ["refine", "demo"])
def test_an_output_folder_below_a_file_is_status_1_before_the_work(
    recording, arguments, monkeypatch, command
):
    folder, _, _ = recording
    (folder / "file").write_text("")
    monkeypatch.setattr(engine, "open_files", lambda *_: pytest.fail("the input was read"))
    bad = folder / "file" / "out"
    args = [*arguments, *READ, "-o", bad] if command == "refine" else ["demo", "-o", bad]
    assert_fails(invoke(*args), 1, str(bad), "output", "expected a folder that can be written")


def test_a_result_that_cannot_be_written_is_status_1(recording, arguments, monkeypatch):
    folder, _, _ = recording

    def write(path, data, **options):
        if path.suffix == ".csv":
            raise OSError(28, "No space left on device", str(path))
        write_pose(path, data, **options)

    monkeypatch.setattr(run_folder, "write_pose", write)
    assert_fails(invoke(*arguments, *READ, *FAST), 1, "pose.csv: no space left")
    assert read_npz(folder / "out" / "pose.npz").pose.shape == (T, 17, 3)


def test_ctrl_c_is_status_130_and_keeps_finished_work(recording, arguments, monkeypatch):
    folder, _, _ = recording
    assert invoke(*arguments, *READ, *FAST).exit_code == 0
    before = (folder / "out" / "pose.npz").read_bytes()

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(solve.sk, "refine_sequence", interrupted)
    result = invoke(*arguments, *READ, *FAST)
    assert result.exit_code == 130
    assert result.stderr.splitlines()[-1] == f"interrupted; nothing was written to {folder / 'out'}"
    assert (folder / "out" / "pose.npz").read_bytes() == before


@pytest.mark.parametrize("people", [[], ["--people", "all"]])
def test_ctrl_c_while_files_are_written_says_that_the_folder_is_unfinished(
    recording, arguments, monkeypatch, people
):
    folder, _, _ = recording

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("skelsplat.run.folder.write_pose", interrupted)
    result = invoke(*arguments, *READ, *FAST, *people)
    assert result.exit_code == 130
    assert result.stderr.splitlines()[-1] == f"interrupted; {folder / 'out'} is unfinished: run it again"
    with pytest.raises(sk.DatasetError, match="unfinished"):
        read_run(folder / "out")


def test_ctrl_c_after_the_last_file_says_that_they_are_complete(arguments, monkeypatch):
    write = run_folder.write_folder

    def interrupted(*args, **kwargs):
        write(*args, **kwargs)
        raise KeyboardInterrupt

    monkeypatch.setattr(run_folder, "write_folder", interrupted)
    result = invoke(*arguments, *READ, *FAST)
    assert result.exit_code == 130
    assert result.stderr.splitlines()[-1] == "interrupted; files already written are complete"


def test_a_defect_keeps_its_traceback(arguments, monkeypatch):
    monkeypatch.setattr(engine, "open_files", lambda *_: 1 / 0)
    assert isinstance(invoke(*arguments, *READ).exception, ZeroDivisionError)


def test_a_warning_of_the_package_is_told_and_reported(recording, arguments):
    folder, _, _ = recording
    # At a thousandth of the true size the cameras stand millimetres apart; σ is scaled as well
    arguments = [*arguments, "--unit", "mm", "--layout", "h36m17", "--fps", "50", "--sigma-mm", "0.02"]
    lines = (folder / "Calib.toml").read_text().splitlines()
    for i, line in enumerate(lines):
        if line.startswith("translation"):
            lines[i] = f"translation = {(np.array(json.loads(line.split('=')[1])) / 1000).tolist()}"
    (folder / "Calib.toml").write_text("\n".join(lines))
    result = invoke(*arguments, "--max-steps", 1, "-q")
    assert result.exit_code == 0, result.output
    warnings = texts(read_report(folder / "out"), "error", "warning", "note")
    assert any(' in "cm" or 11 m in "m"' in warning for warning in warnings)  # both are usual
    assert result.stderr.splitlines() == [f"warning: {warning}" for warning in warnings]
    below = "".join(invoke(*arguments, "--max-steps", 1).stdout.split())  # a long path is broken anywhere
    of_size = [warning for warning in warnings if "unit" in warning]
    assert len(of_size) == 2
    assert below.index("".join("".join(f"!{warning}".split()) for warning in of_size)) == below.index("!")


@pytest.mark.parametrize(
    "args", [["--help"], ["refine", "--help"], ["demo", "--help"], ["live", "--help"], []]
)
def test_help_fits_80_columns(args):
    result = invoke(*args)
    assert result.exit_code == 0
    assert "skelsplat" in result.stdout
    assert max(len(line.rstrip()) for line in result.stdout.splitlines()) <= 80


def test_help_of_each_command_has_an_example():
    for command in ("demo", "refine", "live", "detect"):
        text = invoke(command, "--help").stdout
        assert f"skelsplat {command} " in text.split("Examples")[1]
        assert "list[" not in text


def test_version_and_python_m():
    assert invoke("--version").stdout == f"skelsplat {sk.__version__}\n"
    run = subprocess.run(
        [sys.executable, "-m", "skelsplat", "nope"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 2
    assert run.stderr.startswith("error: No such command 'nope'")
    assert run.stderr.count("\n") == 1


@pytest.mark.painted
def test_demo_refines_the_sample(tmp_path):
    result = invoke("demo", "-o", tmp_path / "demo")
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "demo").iterdir()} == RESULTS | {"input"}
    assert (tmp_path / "demo" / "input" / "Calib.toml").is_file()
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert report["input"]["frames"] == 100
    assert "no ground truth" in report["note"]
    assert "no ground truth" in " ".join(result.stdout.split())
    assert [camera["name"] for camera in report["reprojection_error"]["cameras"]] == [
        f"cam_0{i}" for i in (1, 2, 3, 4)
    ]
    assert report["settings"]["method"] == "annealed"
    assert not any("no person detected" in doubt for doubt in texts(report))
    for words in (
        "people",
        "Limb lengths",
        "of all detections are rejected",
    ):  # the bystander is in two views
        assert not any(words in doubt for doubt in texts(report))
    # one camera is turned by less than the noise: hardly rejected, but all of its detections lie to one side
    (doubt,) = (doubt for doubt in texts(report) if "calibration" in doubt)
    assert doubt.startswith(
        "cam_03's calibration or timing looks wrong: its detections are shifted by 18 px "
    )
    assert f"! {doubt}" in " ".join(result.stdout.split())
    page = (tmp_path / "demo" / "report.html").read_text(encoding="utf-8")
    assert html.escape(doubt) in page
    lines = result.stdout.splitlines()
    assert all(len(line) <= 80 for line in lines if not line.startswith(("Wrote to", "/")))


def test_demo_of_the_paper(tmp_path, monkeypatch):
    # All frames, few steps: the command passes its settings on as they are in the job
    preset = sk.RefineConfig.paper

    class Hurried:
        @staticmethod
        def paper(**given):
            return preset(max_steps=2, **given)

    monkeypatch.setattr(solve.sk, "RefineConfig", Hurried)
    result = invoke("demo", "--paper", "-o", tmp_path)
    assert result.exit_code == 0, result.output
    assert {path.name for path in tmp_path.iterdir()} == RESULTS | {"heatmaps.png", "input"}
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["settings"]["method"] == "paper"
    assert report["settings"]["method"] == "paper"


def test_pick_person_by_place_and_by_size():
    rig = synthetic.human36m_like()
    people = np.full((2, 4, 2, 3, 3), np.nan)
    people[:, :, 0, :, :2] = [[10.0, 10.0], [20.0, 20.0], [30.0, 30.0]]
    people[:, :, 1, :, :2] = [[10.0, 10.0], [20.0, 20.0], [60.0, 60.0]]
    people[0, 0, 1] = np.nan
    index, unmatched = pick_places(people, rig, "largest")
    largest = take_people(people, index)
    assert largest[1, 2, 2, 0] == 60.0
    assert largest[0, 0, 2, 0] == 30.0
    assert not unmatched.any()
    index, unmatched = pick_places(people, rig, "0")
    np.testing.assert_array_equal(take_people(people, index), people[:, :, 0])
    assert not unmatched.any()


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
