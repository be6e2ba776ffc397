"""Runs over time: when, what is written of them, and what is said where the frames are solved one by one."""

from __future__ import annotations

import csv
import json
from dataclasses import fields, replace

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, invoke, read_report, succeed
from overlay_case import write_video
from skelsplat import synthetic
from skelsplat.io import PoseData, read_detections, read_json, read_npz, write_npz
from skelsplat.io.detections._record import Record, Video, write_record
from skelsplat.run import Job, Run, run, solve
from skelsplat.run.read import open_files
from skelsplat.run.tracked import read_inputs

LAYOUT, FPS = "h36m17", 50.0


def walk(frames=60, views=4, seed=1):
    """Return true poses, noisy detections and the rig of a simulated walk at 50 Hz."""
    rig = sk.CameraRig(list(synthetic.human36m_like())[:views], unit="mm")
    pose = synthetic.motion("walk", frames, seed=seed)
    noise = synthetic.DetectionNoise.good()
    return pose, synthetic.simulate_detections(pose, rig, noise=noise, seed=0), rig


def test_a_known_frame_rate_solves_in_time(job):
    found = run(job())
    expected = sk.refine_sequence(found.detections, found.cameras, fps=FPS, layout=LAYOUT)
    assert found.outcome.sequence is found.result
    for entry in fields(sk.SequenceRefinement):
        actual = getattr(found.result, entry.name)
        np.testing.assert_array_equal(actual, getattr(expected, entry.name), err_msg=entry.name)
    solution = found.report["solution"]
    assert (solution["method"], solution["fps"], solution["inferred"]) == ("over time", FPS, 0)
    bone = solution["bones"][0]
    ends = [found.layout.joints[joint] for joint in expected.bones[0]]
    assert (bone["joints"], bone["length_mm"]) == (ends, expected.bone_lengths[0])
    assert bone["sigma_mm"] == expected.bone_length_sigma[0]


def test_an_independent_start_is_for_single_frames(recording, job):
    folder, _, pose = recording
    write_npz(folder / "start.npz", PoseData(pose, sk.layouts.H36M17.joints, np.arange(len(pose)), "mm"))
    found = run(job(init=folder / "start.npz", init_sigma_mm=20.0))
    assert found.report["solution"] == {"method": "frame by frame", "reason": "prior"}
    assert run(job(init=folder / "start.npz")).outcome.sequence is not None


def test_missing_frames_are_solved_and_left_out_again(job):
    inputs = read_inputs(open_files(job()), job(), solve.silent, lambda _: None)
    inputs = replace(inputs, frames=np.array([0, 1, 4, 5, 6]))
    found = solve.refine_inputs(inputs, job()).sequence
    whole = np.full((7, *inputs.detections.shape[1:]), np.nan)
    whole[[0, 1, 4, 5, 6]] = inputs.detections
    expected = sk.refine_sequence(whole, inputs.rig, fps=FPS, layout=LAYOUT)
    np.testing.assert_array_equal(found.pose, expected.pose[[0, 1, 4, 5, 6]])
    np.testing.assert_array_equal(found.velocity, expected.velocity[[0, 1, 4, 5, 6]])
    np.testing.assert_array_equal(found.bone_lengths, expected.bone_lengths)


def test_the_files_of_a_run_state_their_rate(recording, job, tmp_path):
    folder, rig, _ = recording
    first = run(job(output=tmp_path / "out", html=False))
    stored = tmp_path / "out" / "detections.npz"
    assert read_detections(stored, rig, layout=LAYOUT).frame_rate == FPS
    again = run(Job(folder / "Calib.toml", stored, unit="mm", layout=LAYOUT))
    assert again.report["input"]["frame_rate_hz"] == FPS
    np.testing.assert_array_equal(again.poses.pose, first.poses.pose)
    other = run(Job(folder / "Calib.toml", stored, unit="mm", layout=LAYOUT, fps=25))
    assert other.report["solution"]["fps"] == 25
    init = run(job(fps=None, init=tmp_path / "out" / "pose.npz"))
    assert init.report["solution"]["fps"] == FPS


def test_files_hold_velocities_and_bones_in_their_unit(job, tmp_path):
    found = run(job(output=tmp_path / "out", write=("npz", "json"), html=False))
    result = found.outcome.sequence
    for read, path in ((read_npz, "pose.npz"), (read_json, "pose.json")):
        poses = read(tmp_path / "out" / path)
        for name in ("velocity", "velocity_uncertainty", "bones", "bone_lengths", "bone_length_sigma"):
            np.testing.assert_array_equal(getattr(poses, name), getattr(result, name))
    opened = Run.open(tmp_path / "out")
    np.testing.assert_array_equal(opened.outcome.sequence.bone_lengths, result.bone_lengths)
    assert opened.report["solution"]["method"] == "over time"
    assert opened.statistics.total["after_px"] == pytest.approx(found.statistics.total["after_px"])


def test_an_inferred_joint_is_marked_everywhere(gap, arguments):
    result = succeed(*arguments, *READ, "--fps", 50)
    assert "1 joint position is inferred from bones and neighbouring frames." in result.stdout
    assert "Weak" not in result.stdout
    with (gap / "out" / "pose.csv").open(newline="") as stream:
        rows = {(row["frame"], row["joint"]): row for row in csv.DictReader(stream)}
    row = rows["2", "right_wrist"]
    assert (row["status"], row["n_views"], bool(row["x"])) == ("inferred", "0", True)
    neighbour = rows["1", "right_wrist"]
    assert float(row["scatter_x"]) > float(neighbour["scatter_x"])
    assert float(row["error_bar_x"]) > float(row["scatter_x"])
    report = read_report(gap / "out")
    assert report["solution"]["inferred"] == report["joint_statuses"]["inferred"] == 1
    (finding,) = report["frame_findings"]
    assert (finding["kind"], finding["text"]) == ("frame_inferred", "inferred: right_wrist")
    page = (gap / "out" / "report.html").read_text(encoding="utf-8")
    assert '<span class="hollow">inferred</span>' in page
    assert "right_wrist</td>" not in page  # inferred joints alone make no problem of a frame
    assert f"<dd>0 of {len({frame for frame, _ in rows})}</dd>" in page


def test_poses_in_time_that_leave_the_detections_are_a_finding():
    _, detections, rig = walk()
    result = sk.refine_sequence(detections, rig, fps=FPS, layout=LAYOUT)
    away = replace(result, reprojection_error=3 * result.reprojection_error)
    (finding,) = Run.from_arrays(away, rig, detections, LAYOUT, fps=FPS).findings
    assert (finding.kind, finding.severity) == ("pose_far_off", "warning")
    assert "check that the frames are in order" in finding.text
    assert [remedy.setting for remedy in finding.remedy] == ["frame_by_frame"]


@pytest.mark.parametrize("place", ["openpose", "videos"])
def test_videos_state_the_rate(recording, job, arguments, place):
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed: pip install 'skelsplat[dev]'")
    folder, rig, _ = recording
    (folder / place).mkdir(exist_ok=True)
    for name in rig.names:
        write_video(folder / place / f"{name}.mp4", count=5, rate=25.0)
    found = run(job(fps=None))
    assert (found.report["solution"]["fps"], found.report["solution"]["fps_from"]) == (25.0, "videos")
    printed = invoke(*arguments, *READ, "--no-html").stdout
    assert "Solved over time at 25 frames per second, as the videos state." in printed
    assert run(job()).report["solution"]["fps_from"] is None  # the option wins
    short = folder / place / f"{rig.names[1]}.mp4"
    write_video(short, count=3, rate=25.0)
    assert run(job(fps=None)).outcome.sequence is None
    write_video(short, count=5, rate=24.0)
    found = run(job(fps=None))
    assert (found.report["solution"]["fps"], found.report["solution"]["fps_from"]) == (24.0, "videos")
    (told,) = (one for one in found.findings if one.kind == "frame_rates_differ")
    assert told.numbers["each"] == "cam1 25, cam2 24, cam3 25, cam4 25"
    short.unlink()
    assert run(job(fps=None)).outcome.sequence is None


def state_rates(folder, rates):
    videos = {name: Video("a.mp4", (1000, 1002), rate) for name, rate in rates.items()}
    write_record(folder / "openpose", Record({"backend": "own"}, LAYOUT, videos=videos))


def test_rates_of_files_that_differ_are_said_and_no_videos_next_to_them_count(recording, job, arguments):
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed: pip install 'skelsplat[dev]'")
    folder, rig, _ = recording
    (folder / "videos").mkdir()
    for name in rig.names:
        write_video(folder / "videos" / f"{name}.mp4", count=5, rate=25.0)
    state_rates(folder, {"cam1": 60, "cam2": 30, "cam3": 60, "cam4": 60.01})
    found = run(job(fps=None))
    assert (found.inputs.fps, found.inputs.frames.tolist()) == (30, [0, 1, 2])
    (told,) = (one for one in found.findings if one.kind == "frame_rates_differ")
    assert (told.severity, told.numbers["each"]) == ("note", "cam1 60, cam2 30, cam3 60, cam4 60.01")
    given = run(job())  # one rate for all, which the files contradict
    (told,) = (one for one in given.findings if one.kind == "frame_rates_differ")
    assert (told.severity, len(given.inputs.frames)) == ("warning", 5)
    checked = invoke("check-cameras", *arguments[1:3], *READ, "--json")
    assert "frame_rates_differ" in [one["kind"] for one in json.loads(checked.stdout)["findings"]]
    state_rates(folder, {"cam1": 60, "cam2": None, "cam3": 60, "cam4": 60.01})
    found = run(job(fps=None))
    assert (found.report["solution"]["fps"], found.report["solution"]["fps_from"]) == (60, "files")
    assert "frame_rates_differ" not in [one.kind for one in found.findings]


def test_given_lengths_that_contradict_the_recording_are_named(job):
    layout = sk.layouts.get(LAYOUT)
    plain = run(job())
    lengths = np.array(plain.result.bone_lengths)
    bone = layout.limbs.index(next(limb for limb in layout.limbs if layout.joints[limb[1]] == "left_knee"))
    lengths[bone] += 150.0

    def told(sigma):
        config = sk.RefineConfig(bone_lengths_mm=lengths, bone_sigmas_mm=np.full(len(lengths), sigma))
        findings = run(job(config=config)).findings
        return [finding for finding in findings if finding.kind == "given_lengths_differ"]

    (finding,) = told(10.0)
    assert finding.numbers["limbs"] == [[layout.joints[j] for j in layout.limbs[bone]]]
    assert abs(finding.numbers["measured_mm"][0] - lengths[bone] + 150.0) < 20.0
    assert not told(1e4)
