"""`skelsplat refine` into the folder of an earlier run: what goes, what stays, and what is said of it."""

from __future__ import annotations

import json

from command_line import FAST, READ, RESULTS, assert_fails, invoke
from skelsplat.run import folder as run_folder


def test_poses_of_another_run_are_removed_and_other_files_left(recording, arguments):
    folder, _, _ = recording
    assert invoke(*arguments, *READ, *FAST, "--no-html").exit_code == 0
    (folder / "out" / "plots").mkdir()
    (folder / "out" / "pose.txt").write_text("mine")
    assert invoke(*arguments, *READ, *FAST, "--no-html", "--write", "json").exit_code == 0
    left = {path.name for path in (folder / "out").iterdir()}
    kept = RESULTS - {"pose.csv", "pose.trc", "report.html"}
    assert left == kept | {"pose.json", "pose.txt", "plots"}


def test_a_stop_while_writing_leaves_no_file_of_an_earlier_run(recording, arguments, monkeypatch):
    folder, _, _ = recording
    out = folder / "out"
    assert invoke(*arguments, *READ, *FAST).exit_code == 0

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(run_folder, "write_run_inputs", interrupted)
        assert invoke(*arguments, *READ, *FAST).exit_code == 130
    assert {path.name for path in out.iterdir()} == {"pose.npz", "pose.csv", "pose.trc", "report.json"}
    unfinished = ("report.json: unfinished: expected the report of a run", "run it again")
    assert_fails(invoke("plot", out), 1, *unfinished)
    assert_fails(invoke("convert", out, folder / "poses.csv"), 1, *unfinished)
    (out / "pose.npz").unlink()
    assert_fails(invoke("convert", out, folder / "poses.csv"), 1, *unfinished)
    # what the stopped run left is known by its report
    assert invoke(*arguments, *READ, *FAST, "--no-html", "--write", "json").exit_code == 0
    kept = RESULTS - {"pose.csv", "pose.trc", "report.html"}
    assert {path.name for path in out.iterdir()} == kept | {"pose.json"}


def test_files_that_no_run_wrote_are_left(recording, arguments):
    folder, _, _ = recording
    out = folder / "out"
    out.mkdir()
    for name in ("pose.trc", "pose.c3d"):
        (out / name).write_text("mine")
    (out / "report.json").write_text('{"files": ["pose.c3d"]}')  # of another program
    for _ in range(2):  # nor are they taken for the first run's by the second
        assert invoke(*arguments, *READ, *FAST, "--write", "csv").exit_code == 0
        assert {(out / name).read_text() for name in ("pose.trc", "pose.c3d")} == {"mine"}
    listed = json.loads((out / "report.json").read_text())["files"]
    assert sorted(listed) == sorted(RESULTS - {"pose.trc", "report.json"})


def test_the_input_is_never_written_over(recording, arguments):
    folder, _, _ = recording
    out = folder / "out"
    assert invoke(*arguments, *READ, *FAST).exit_code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    always = ["--layout", "h36m17", *FAST]
    expected = ["--output: ", "expected a folder in which no input is overwritten"]
    calibration, detections, init = out / "cameras.json", out / "detections.npz", out / "pose.npz"
    given = (calibration, folder / "openpose")
    assert_fails(invoke("refine", *given, "-o", out, *always), 2, *expected, "cameras.json")
    given = (folder / "Calib.toml", detections)
    assert_fails(invoke("refine", *given, "-o", out / ".." / "out", *always), 2, *expected, "detections.npz")
    given = (folder / "Calib.toml", folder / "openpose", "--init", init, "--unit", "mm")
    assert_fails(invoke("refine", *given, "-o", out, *always), 2, *expected, "pose.npz")
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert invoke("refine", calibration, detections, "-o", folder / "again", *always).exit_code == 0


def test_results_do_not_get_in_the_way_of_the_detections(recording):
    folder, rig, _ = recording
    refine = ["refine", folder / "Calib.toml", folder / "openpose", *READ, *FAST]
    assert_fails(
        invoke(*refine, "-o", folder / "openpose"), 2, "--output: ", "mixed with results", "openpose"
    )
    for place in (rig.names[0], f"{rig.names[1]}/out"):
        before = sorted((folder / "openpose" / rig.names[0]).iterdir())
        assert_fails(
            invoke(*refine, "-o", folder / "openpose" / place), 2, "--output: ", "mixed with results"
        )
        assert sorted((folder / "openpose" / rig.names[0]).iterdir()) == before
        assert not (folder / "openpose" / rig.names[1] / "out").exists()
    for _ in range(2):  # a folder of results beneath is none of a camera
        assert invoke(*refine, "-o", folder / "openpose" / "out", "--order", "sorted").exit_code == 0
