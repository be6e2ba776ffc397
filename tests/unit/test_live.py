"""``skelsplat live``: lines in, lines out, all that a pipe can do to it; and `Refiner(fps=…)` itself."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import skelsplat as sk
from command_line import assert_fails, invoke
from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.io import read_calibration, write_calibration
from skelsplat.synthetic import DetectionNoise

T = 6
OPTIONS = ["--unit", "mm", "--layout", "h36m17"]


@pytest.fixture
def rig(tmp_path):
    write_calibration(tmp_path / "Calib.toml", synthetic.human36m_like())
    return read_calibration(tmp_path / "Calib.toml", unit="mm")


@pytest.fixture
def detections(rig):
    """Simulate a walk with noise, (T, M, N, 3); one joint is missing everywhere in frame 3."""
    pose = synthetic.motion("walk", T, seed=3)
    noise = np.random.default_rng(1).normal(0.0, 2.0, (T, len(rig), 17, 2))
    points = sk.project(pose, rig).swapaxes(0, 1) + noise
    found = np.concatenate([points, np.full((T, len(rig), 17, 1), 0.9)], axis=-1)
    found[3, :, 5] = [np.nan, np.nan, 0.0]
    return found


def plain(array):
    return np.where(np.isfinite(array), array, None).tolist()


def line(frame, array):
    return json.dumps({"frame": frame, "detections": plain(array)})


def run(tmp_path, *lines, options=("-q",)):
    arguments = ["live", str(tmp_path / "Calib.toml"), *OPTIONS, *options]
    return CliRunner().invoke(app, arguments, input="\n".join(lines) + "\n")


def records(result):
    return [json.loads(text, parse_constant=pytest.fail) for text in result.stdout.splitlines()]


def unmeasured(answer):
    return {key: value for key, value in answer.items() if key != "latency_ms"}


def test_the_answers_are_those_of_a_refiner(tmp_path, rig, detections):
    result = run(tmp_path, *(line(t, found) for t, found in enumerate(detections)))
    assert result.exit_code == 0, result.output
    refiner = sk.Refiner(rig, layout="h36m17")
    for t, record in enumerate(records(result)):
        expected = refiner.step(detections[t])
        assert record["frame"] == t
        pose = [[np.nan] * 3 if joint is None else joint for joint in record["pose"]]
        np.testing.assert_array_equal(pose, expected.pose)
        for name, covariance in (("error_bar", expected.error_bar), ("scatter", expected.uncertainty)):
            sigma = [[np.nan] * 3 if joint is None else joint for joint in record[name]]
            np.testing.assert_array_equal(sigma, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))
        assert record["joint_status"] == expected.joint_status.tolist()
        assert record["latency_ms"] > 0.0
    assert t == T - 1


def test_what_is_missing_may_be_null_or_nan_or_of_no_confidence(tmp_path, detections):
    found = detections[0]
    found[1] = np.nan
    whole = plain(found)
    whole[1] = None
    joints = plain(found)
    joints[1] = [None] * 17
    zero = found.copy()
    zero[1] = [0.0, 0.0, 0.0]
    nan = json.dumps({"detections": found.tolist()})
    assert "NaN" in nan
    forms = [line(0, found), json.dumps({"detections": whole}), json.dumps({"detections": joints}), nan]
    forms.append(json.dumps({"detections": zero.tolist()}))
    poses = [records(run(tmp_path, form))[0]["pose"] for form in forms]
    assert all(pose == poses[0] for pose in poses)


def test_reset_forgets_the_pose_before(tmp_path, detections):
    nothing = np.full_like(detections[0], np.nan)
    kept = records(run(tmp_path, line(0, detections[0]), line(1, nothing)))[1]
    assert kept["joint_status"] == ["unobserved"] * 17
    assert None not in kept["pose"]
    again = json.dumps({"frame": 1, "reset": True, "detections": plain(nothing)})
    forgotten = records(run(tmp_path, line(0, detections[0]), again))[1]
    assert forgotten["pose"] == [None] * 17


def test_clocks_of_a_calibration_are_for_recordings(tmp_path, rig, detections):
    write_calibration(tmp_path / "Calib.toml", sk.CameraRig(rig, clocks={rig.names[1]: 3.0}))
    result = run(tmp_path, line(0, detections[0]), options=())
    assert "The clocks of Calib.toml are not applied" in " ".join(result.stderr.split())
    assert np.isfinite(records(result)[0]["pose"]).all()


def test_cameras_by_name(tmp_path, rig, detections):
    found = detections[0]
    found[1] = np.nan
    views = dict(zip(rig.names, plain(found), strict=True))
    del views[rig.names[1]]
    backwards = dict(reversed(views.items()))
    forms = [line(0, found), *(json.dumps({"detections": each}) for each in (views, backwards))]
    poses = [records(run(tmp_path, form))[0]["pose"] for form in forms]
    assert poses[0] == poses[1] == poses[2]
    (nothing,) = records(run(tmp_path, '{"detections": {}}'))
    assert nothing["joint_status"] == ["unobserved"] * 17


def test_malformed_lines_are_named_and_skipped(tmp_path, detections):
    """One line of each kind; the error begins with the place of what is wrong."""
    good = plain(detections[0])

    def point(value):
        return json.dumps({"detections": [[value, *good[0][1:]], *good[1:]]})

    lines = {
        "{bad": "expected JSON",
        "[" * 100_000: "expected JSON",
        "[1]": 'expected an object with "detections"',
        "": "expected JSON",
        '{"frame": 3}': 'expected an object with "detections"',
        '{"detections": {"cam9": null}}': "detections: ",
        '{"detections": {"cam2": []}}': 'detections["cam2"]: ',
        '{"detections": [null, null, null]}': "detections: ",
        '{"detections": [[], null, null, null]}': "detections[0]: ",
        '{"detections": [], "reset": 1}': "reset: ",
        point(["1", 2, 3]): "detections[0][0]: ",
        point([1, 2, 300]): "detections[0][0][2]: ",
        point([1e200, 2, 0.5]): "detections[0][0][0]: ",
        json.dumps({"detections": [[good[0]], *good[1:]]}): "detections[0]: expected a list of 17 joints",
        point([1, 2, 0.5]).replace("0.5", "1e999", 1): "detections: expected numbers, got infinity",
        point([10**400, 2, 0.5]): "detections: expected numbers, got one beyond",
        line(0, detections[0]).replace(": 0", ": NaN", 1): "frame: ",
    }
    result = run(tmp_path, *lines, line("last", detections[0]), options=())
    assert result.exit_code == 0
    *errors, last = records(result)
    assert (last["frame"], len(last["pose"])) == ("last", 17)
    ready, *said, end = result.stderr.splitlines()
    assert ready == "ready: 4 cameras (cam1, cam2, cam3, cam4), 17 joints (h36m17), in mm"
    told = zip(errors, said, lines.values(), strict=True)
    for number, (error, text, expected) in enumerate(told, start=1):
        assert error.keys() == {"frame", "line", "error"}
        assert error["line"] == number
        assert error["error"].startswith(expected)
        assert text == f"line {number}: skipped: {error['error']}"
    assert end.startswith(f"lines solved 1, malformed {len(lines)}; ")


def test_a_malformed_line_changes_nothing(tmp_path, detections):
    """Also where it would have reset the session: no frame that waits loses its answer."""
    wrong = plain(detections[1])
    wrong[0][0][2] = 300
    malformed = json.dumps({"frame": "wrong", "reset": True, "detections": wrong})
    lines = [line(t, found) for t, found in enumerate(detections)]
    lines.insert(3, malformed)
    for options in (("-q",), ("-q", "--fps", "25", "--lag", "2")):
        answers = records(run(tmp_path, *lines, options=options))
        (error,) = [answer for answer in answers if "error" in answer]
        assert (error["frame"], error["line"]) == ("wrong", 4)
        without = records(run(tmp_path, *lines[:3], *lines[4:], options=options))
        answers = [unmeasured(answer) for answer in answers if "error" not in answer]
        assert answers == [unmeasured(answer) for answer in without]


@pytest.mark.parametrize(
    ("extra", "option"),
    [
        (["--unit", "inch", "--layout", "h36m17"], "--unit"),
        ([*OPTIONS, "--fps", "-3"], "--fps"),
        ([*OPTIONS, "--lag", "3"], "--lag"),
        ([*OPTIONS, "--people", "all"], "--people"),
        ([*OPTIONS, "--people", "0", "--fps", "30"], "--people"),
        ([*OPTIONS, "--people", "2", "--fps", "30", "--lag", "3"], "--lag"),
    ],
)
def test_bad_options(tmp_path, rig, extra, option):  # noqa: ARG001  the file is written
    assert_fails(invoke("live", tmp_path / "Calib.toml", *extra), 2, f"error: {option}: ")


def test_with_a_lag_frames_are_answered_once_and_lines_that_come_too_early_with_what_waits(
    tmp_path, detections
):
    lines = [line(t, found) for t, found in enumerate(detections)]
    again = json.dumps({"frame": "again", "reset": True, "detections": plain(detections[0])})
    result = run(tmp_path, *lines, again, options=("--fps", "25", "--lag", "2"))
    answers = records(result)
    waiting = [answer.get("waiting") for answer in answers]
    assert waiting == [1, 2, *[None] * T, 1, None]
    frames = [answer for answer in answers if "waiting" not in answer]
    assert [answer["frame"] for answer in frames] == [*range(T), "again"]
    assert all(None not in answer["pose"] for answer in frames)
    assert "each line is answered with the frame 2 before" in result.stderr
    assert f"lines solved {T + 1}, malformed 0" in result.stderr


# as a process


def start(tmp_path, *options):
    command = [sys.executable, "-m", "skelsplat", "live", str(tmp_path / "Calib.toml"), *OPTIONS, *options]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize("lag", [0, 1])
def test_every_line_is_answered_at_once_and_ctrl_c_is_status_130(tmp_path, detections, lag):
    with start(tmp_path, "--fps", "25", "--lag", str(lag)) as process:
        for t in range(2 + lag):
            process.stdin.write(line(t, detections[t]) + "\n")
            process.stdin.flush()
            answer = json.loads(process.stdout.readline())
            assert answer["frame"] == t - lag if t >= lag else answer == {"waiting": t + 1}
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
        said = process.stderr.read().splitlines()
    assert said[-1].startswith("lines solved 2, malformed 0; ")
    assert len(said) == 2


def test_a_reader_that_goes_away_is_status_1(tmp_path, detections):
    with start(tmp_path) as process:
        process.stdin.write(line(0, detections[0]) + "\n")
        process.stdin.flush()
        process.stdout.readline()
        process.stdout.close()
        process.stdin.write(line(1, detections[1]) + "\n")
        process.stdin.flush()
        assert process.wait() == 1
        said = process.stderr.read().splitlines()
    assert said[1] == "error: stdin or stdout: broken pipe"
    assert len(said) == 3


FPS = 30
RIG = synthetic.human36m_like()
ONE_CORE = sk.RefineConfig(n_threads=1)


@pytest.fixture(scope="module")
def walk():
    return synthetic.motion("walk", 90, fps=FPS, seed=0)


@pytest.fixture(scope="module")
def seen(walk):
    noise = DetectionNoise.recording(frame_rate=FPS)
    return synthetic.simulate_detections(walk, RIG, noise=noise, layout="h36m17", seed=0)


def refiner(**options):
    return sk.Refiner(RIG, layout="h36m17", **{"fps": FPS, "config": ONE_CORE, **options})


def far(pose, truth):
    return np.linalg.norm(pose - truth, axis=-1)


@pytest.mark.parametrize("views", [2, 4])
def test_a_jump_is_followed_by_two_views_that_agree(walk, seen, views):
    live = refiner()
    for frame in seen[:40]:
        live.step(frame)
    jumped = walk[40:45] + np.array([600.0, -500.0, 100.0])
    noise = DetectionNoise.recording(frame_rate=FPS)
    shown = synthetic.simulate_detections(jumped, RIG, noise=noise, layout="h36m17", seed=1)
    shown[:, views:] = [np.nan, np.nan, 0.0]
    for frame, truth in zip(shown, jumped, strict=True):
        alone = sk.refine(None, frame, RIG, layout="h36m17", config=ONE_CORE)
        judged = alone.joint_status == "ok"
        assert far(live.step(frame).pose, truth)[judged].mean() < 1.1 * far(alone.pose, truth)[judged].mean()


def test_the_lag_says_which_frame_is_answered(walk, seen):
    live = refiner(lag=4)
    results = [live.step(frame) for frame in [*seen[:20], *np.full_like(seen[:4], np.nan)]]
    assert all((result.joint_status == "unobserved").all() for result in results[:4])
    assert far([result.pose for result in results[4:]], walk[:20]).mean() < 20.0
    errors = np.array([result.reprojection_error for result in results[4:]])
    assert np.array_equal(np.isfinite(errors), np.isfinite(seen[:20, ..., 0]) & (seen[:20, ..., 2] > 0))


@pytest.mark.parametrize("view", range(4))
def test_the_joints_of_one_view_do_not_confirm_each_other(walk, seen, view):
    live, alone, wrong = refiner(), seen.copy(), []
    alone[30:, np.arange(4) != view] = [np.nan, np.nan, 0.0]
    for frame, truth in zip(alone, walk, strict=True):
        found = live.step(frame)
        inside = sk.metrics.sigma_coverage(found.pose, found.uncertainty, truth, reduce="none")[2]
        wrong.append((found.joint_status != "weak") & (inside == 0.0))
    assert np.mean(wrong[30:]) < 0.03
