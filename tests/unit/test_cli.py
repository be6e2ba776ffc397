"""The command line: what it writes and prints, and every way to fail with its status and its one line."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cli import _pipeline, _run, app
from skelsplat.cli._figures import most_moved_frame, world_up
from skelsplat.cli._person import pick_person
from skelsplat.io import PoseData, read_npz, read_trc, write_calibration, write_npz

T = 5
NOISE_PX = 2.0
RESULTS = {"pose.npz", "pose.csv", "pose.trc", "report.json", "overview.png", "heatmaps.png"}


def write_detections(root, rig, detections):
    """Write (T, M, N, 2) as OpenPose folders; NaN becomes the zeros of OpenPose."""
    for i, name in enumerate(rig.names):
        (root / name).mkdir(parents=True)
        for t in range(len(detections)):
            seen = np.isfinite(detections[t, i]).all(axis=1, keepdims=True)
            joints = np.where(
                seen, np.hstack([np.nan_to_num(detections[t, i]), np.full(seen.shape, 0.9)]), 0.0
            )
            people = [{"pose_keypoints_2d": joints.ravel().tolist()}]
            (root / name / f"{t:06d}_keypoints.json").write_text(json.dumps({"people": people}))


@pytest.fixture
def recording(tmp_path):
    """Write a walk of five frames in four cameras, in mm; the last camera never sees joint 3."""
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", T, seed=3)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    detections += np.random.default_rng(1).normal(0.0, NOISE_PX, detections.shape)
    detections[:, -1, 3] = np.nan
    write_calibration(tmp_path / "Calib.toml", rig)
    write_detections(tmp_path / "openpose", rig, detections)
    return tmp_path, rig, pose


@pytest.fixture
def arguments(recording):
    folder, _, _ = recording
    return ["refine", str(folder / "Calib.toml"), str(folder / "openpose"), "-o", str(folder / "out")]


READ = ["--unit", "mm", "--layout", "h36m17"]
FAST = ["--max-steps", "30", "--fps", "50"]


def invoke(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args], env={"COLUMNS": "80"})


def assert_fails(result, status, *parts):
    """One line on stderr that starts with ``error:`` and holds ``parts``; nothing on stdout."""
    assert result.exit_code == status, result.output
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    for part in parts:
        assert part in lines[0]


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
    # camera, median "a → b", 90th percentile "a → b", used, missing, poor
    assert last_camera[7:9] == [str(16 * T), str(T)]
    assert "ms per frame" in result.stdout
    assert "\x1b[" not in result.stdout


def test_the_report_holds_statistics_settings_and_timing(recording, arguments):
    folder, rig, _ = recording
    assert invoke(*arguments, *READ, *FAST, "--sigma", 25, "--min-confidence", 0.1).exit_code == 0
    report = json.loads((folder / "out" / "report.json").read_text())
    errors = report["reprojection_error"]
    assert report["versions"]["skelsplat"] == sk.__version__
    assert report["settings"]["sigma"] == 25.0
    assert report["settings"]["max_steps"] == 30
    assert report["settings"]["min_confidence"] == 0.1
    assert report["ground_truth"] is None
    assert [camera["name"] for camera in errors["cameras"]] == list(rig.names)
    assert len(errors["joints"]) == 17
    assert errors["all"]["used"] == T * (4 * 17 - 1)
    assert errors["all"]["missing"] == errors["joints"][3]["missing"] == T
    assert errors["cameras"][0]["poor_above_px"] == pytest.approx(0.01 * np.hypot(*rig[0].size))
    # the median distance of a 2 px deviation per axis is 2.4 px, and a fit lies closer than the truth
    assert 0.0 < errors["all"]["after_px"] < 2 * NOISE_PX
    assert sum(report["stop_reasons"].values()) == T
    assert report["timing"]["ms_per_frame"] == pytest.approx(1000 * report["timing"]["refine_s"] / T)


def test_a_poor_detection_is_counted(recording, arguments):
    folder, rig, _ = recording
    path = folder / "openpose" / rig.names[0] / "000002_keypoints.json"
    document = json.loads(path.read_text())
    document["people"][0]["pose_keypoints_2d"][3 * 16] += 200.0
    path.write_text(json.dumps(document))
    assert invoke(*arguments, *READ, *FAST).exit_code == 0
    errors = json.loads((folder / "out" / "report.json").read_text())["reprojection_error"]
    assert errors["joints"][16]["poor"] >= 1
    assert errors["joints"][3]["poor"] == 0


def test_json_goes_to_stdout_and_quiet_prints_nothing(recording, arguments):
    folder, _, _ = recording
    result = invoke(*arguments, *READ, *FAST, "--json")
    assert json.loads(result.stdout) == json.loads((folder / "out" / "report.json").read_text())
    assert result.stderr == ""
    quiet = invoke(*arguments, *READ, *FAST, "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")


def test_an_unknown_frame_rate_is_a_warning(recording, arguments):
    folder, _, _ = recording
    result = invoke(*arguments, *READ, "--max-steps", 1, "-q")
    assert result.exit_code == 0
    assert result.stderr.startswith("warning: --fps: not given")
    assert "--fps" in json.loads((folder / "out" / "report.json").read_text())["warnings"][0]


def test_an_initial_pose_is_read_in_its_own_unit(recording, arguments):
    folder, rig, pose = recording
    start = PoseData(pose / 1000.0, tuple(sk.layouts.H36M17.joints), np.arange(T), "m")
    write_npz(folder / "start.npz", start)
    result = invoke(*arguments, *READ, "--fps", 50, "--max-steps", 0, "--init", folder / "start.npz")
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
        ([], ["--unit", "expected one of mm, cm, m", "nothing"]),
        (["--unit", "mm"], ["--layout", "expected one of", "body25b", "nothing"]),
        (["--unit", "inch"], ["--unit", "'inch'"]),
        (["--unit", "mm", "--layout", "body26"], ["--layout", "h36m17", "'body26'"]),
        ([*READ, "--person", "left"], ["--person", "'left'"]),
        ([*READ, "--frames", "some"], ["--frames", "strict", "'some'"]),
        ([*READ, "--sigma", "-1"], ["--sigma", "positive", "-1"]),
        ([*READ, "--occlusion-sigma", "0"], ["--occlusion-sigma", "positive", "0"]),
        ([*READ, "--fps", "nan"], ["--fps", "positive", "nan"]),
        ([*READ, "--symmetry-tier", "4"], ["--symmetry-tier", "3"]),
        ([*READ, "--max-steps", "many"], ["--max-steps"]),
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


def test_a_missing_folder_of_detections_is_status_1(recording, arguments):
    folder, _, _ = recording
    (folder / "openpose").rename(folder / "elsewhere")
    assert_fails(invoke(*arguments, *READ), 1, str(folder / "openpose"), "expected", "got")


def test_json_cut_in_half_is_status_1(recording, arguments):
    folder, rig, _ = recording
    path = folder / "openpose" / rig.names[1] / "000003_keypoints.json"
    path.write_text(path.read_text()[:100])
    assert_fails(invoke(*arguments, *READ), 1, str(path), "JSON", "expected", "got")
    assert not list((folder / "out").iterdir())


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


def test_a_person_that_is_not_there_is_status_1(arguments):
    assert_fails(invoke(*arguments, *READ, "--person", 7), 1, "--person", "less than 1", "7")


@pytest.mark.parametrize("command", ["refine", "demo"])
def test_an_output_folder_below_a_file_is_status_1_before_the_work(
    recording, arguments, monkeypatch, command
):
    folder, _, _ = recording
    (folder / "file").write_text("")
    monkeypatch.setattr(_run, "read_inputs", lambda _: pytest.fail("the input was read"))
    bad = folder / "file" / "out"
    args = [*arguments, *READ, "-o", bad] if command == "refine" else ["demo", "-o", bad]
    assert_fails(invoke(*args), 1, str(bad), "--output", "expected a folder that can be written")


def test_a_result_that_cannot_be_written_is_status_1(recording, arguments):
    folder, _, _ = recording
    (folder / "out" / "pose.csv").mkdir(parents=True)
    assert_fails(invoke(*arguments, *READ, *FAST), 1, "pose.csv")
    assert read_npz(folder / "out" / "pose.npz").pose.shape == (T, 17, 3)


def test_ctrl_c_is_status_130_and_keeps_finished_work(recording, arguments, monkeypatch):
    folder, _, _ = recording
    assert invoke(*arguments, *READ, *FAST).exit_code == 0
    before = (folder / "out" / "pose.npz").read_bytes()

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(_pipeline.sk, "refine", interrupted)
    result = invoke(*arguments, *READ, *FAST)
    assert result.exit_code == 130
    assert result.stderr.splitlines()[-1] == "interrupted; files already written are complete"
    assert (folder / "out" / "pose.npz").read_bytes() == before


def test_a_defect_keeps_its_traceback(arguments, monkeypatch):
    monkeypatch.setattr(_run, "read_inputs", lambda _: 1 / 0)
    assert isinstance(invoke(*arguments, *READ).exception, ZeroDivisionError)


def test_a_warning_of_the_package_is_told_and_reported(recording, arguments):
    folder, _, _ = recording
    # At a thousandth of the true size the cameras stand millimetres apart; σ is scaled as well
    arguments = [*arguments, "--unit", "mm", "--layout", "h36m17", "--fps", "50", "--sigma", "0.02"]
    lines = (folder / "Calib.toml").read_text().splitlines()
    for i, line in enumerate(lines):
        if line.startswith("translation"):
            lines[i] = f"translation = {(np.array(json.loads(line.split('=')[1])) / 1000).tolist()}"
    (folder / "Calib.toml").write_text("\n".join(lines))
    result = invoke(*arguments, "--max-steps", 1, "-q")
    assert result.exit_code == 0, result.output
    warnings = json.loads((folder / "out" / "report.json").read_text())["warnings"]
    assert any("unit" in warning and '"m" is likely' in warning for warning in warnings)
    assert result.stderr.splitlines() == [f"warning: {warning}" for warning in warnings]


@pytest.mark.parametrize("args", [["--help"], ["refine", "--help"], ["demo", "--help"], []])
def test_help_fits_80_columns(args):
    result = invoke(*args)
    assert result.exit_code == 0
    assert "skelsplat" in result.stdout
    assert max(len(line.rstrip()) for line in result.stdout.splitlines()) <= 80


def test_help_of_each_command_has_an_example():
    for command in ("demo", "refine"):
        assert f"skelsplat {command} " in invoke(command, "--help").stdout.split("Examples")[1]


def test_version_and_python_m():
    assert invoke("--version").stdout == f"skelsplat {sk.__version__}\n"
    run = subprocess.run(
        [sys.executable, "-m", "skelsplat", "nope"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 2
    assert run.stderr.startswith("error: No such command 'nope'")
    assert run.stderr.count("\n") == 1


def test_demo_refines_the_sample(tmp_path, monkeypatch):
    # All frames, few steps: the command passes its settings on as they are in the job
    whole = _pipeline.sk.RefineConfig
    monkeypatch.setattr(_pipeline.sk, "RefineConfig", lambda **given: whole(max_steps=5, **given))
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


def test_pick_person_by_place_and_by_size():
    rig = synthetic.human36m_like()
    people = np.full((2, 4, 2, 3, 3), np.nan)
    people[:, :, 0, :, :2] = [[10.0, 10.0], [20.0, 20.0], [30.0, 30.0]]
    people[:, :, 1, :, :2] = [[10.0, 10.0], [20.0, 20.0], [60.0, 60.0]]
    people[0, 0, 1] = np.nan
    largest = pick_person(people, rig, "largest")
    assert largest[1, 2, 2, 0] == 60.0
    assert largest[0, 0, 2, 0] == 30.0
    np.testing.assert_array_equal(pick_person(people, rig, "0"), people[:, :, 0])


def test_the_frame_shown_is_complete_and_not_chosen_by_one_stray_joint():
    moved = np.array([[1.0, 1.0, 900.0], [5.0, 5.0, 5.0], [9.0, 9.0, 9.0], [np.nan] * 3])
    status = np.full((4, 3), "ok", dtype="<U10")
    status[2, 0] = "weak"
    status[3] = "unobserved"
    assert most_moved_frame(moved, status) == 1
    status[:, 1] = "weak"
    assert most_moved_frame(moved, status) == 2
    assert most_moved_frame(np.full((2, 3), np.nan), status[:2]) == 0


def test_world_up_is_the_axis_that_the_cameras_agree_on():
    rig = synthetic.human36m_like()
    np.testing.assert_array_equal(world_up(rig), [0.0, 0.0, 1.0])
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z up to y down
    turned = [sk.Camera(c.K, c.R @ turn, c.t, size=c.size) for c in rig]
    np.testing.assert_array_equal(world_up(sk.CameraRig(turned)), turn.T @ [0.0, 0.0, 1.0])


def test_what_to_distrust_is_said_in_words(recording, arguments):
    """One camera lies 28 px off on either axis: too far for the splats, near enough to be the same person."""
    folder, _, _ = recording
    shifted = [path for path in (folder / "openpose").rglob("*.json") if "cam3" in path.parent.name]
    assert len(shifted) == T
    for path in shifted:
        frame = json.loads(path.read_text())
        for person in frame["people"]:
            points = np.array(person["pose_keypoints_2d"]).reshape(-1, 3)
            points[points[:, 2] > 0, :2] += 28.0
            person["pose_keypoints_2d"] = points.ravel().tolist()
        path.write_text(json.dumps(frame))
    result = invoke(*arguments, *READ)
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "! cam3: the pose follows the other cameras and not this one" in text
    doubts = json.loads((folder / "out" / "report.json").read_text())["doubts"]
    assert [doubt.split(":")[0] for doubt in doubts] == ["cam3"]


def test_detections_that_are_no_pixels_are_doubted(recording, arguments):
    folder, _, _ = recording
    for path in (folder / "openpose").rglob("*.json"):
        frame = json.loads(path.read_text())
        for person in frame["people"]:
            person["pose_keypoints_2d"] = [0.0] * len(person["pose_keypoints_2d"])
        path.write_text(json.dumps(frame))
    result = invoke(*arguments, *READ, *FAST)
    assert "! No detection could be used" in " ".join(result.stdout.split())
