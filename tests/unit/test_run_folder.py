"""The folder of a run is read back whole, one that is none is refused, and a second run into it too."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from command_line import FAST, READ, RESULTS, assert_fails, invoke, read_report
from skelsplat._lock import locked
from skelsplat.io import read_npz, read_run, write_npz
from skelsplat.run import PeopleRun, Run
from skelsplat.run import folder as folders
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.overlay import Scene


def test_what_went_in_and_what_came_out_is_read(run_folder, recording):
    _, rig, _ = recording
    read = read_run(run_folder)
    assert read.rig.names == rig.names
    assert read.rig.unit == "mm"
    assert read.layout.name == "h36m17"
    assert read.undistorted
    np.testing.assert_array_equal(read.poses.pose, read_npz(run_folder / "pose.npz").pose)
    assert np.isnan(read.detections[:, -1, 3]).all()  # never seen
    again = sk.refine_sequence(read.detections, read.rig, fps=50, layout=read.layout)
    np.testing.assert_array_equal(again.pose, read.poses.pose)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda r: r.pop("settings"), "settings"),
        (lambda r: r["input"].update(layout="h36m71"), r"input\.layout"),
        (lambda r: r["settings"].update(undistort="yes"), r"settings\.undistort"),
        (lambda r: r["input"].update(offsets=["cam1"]), r"input\.offsets"),
        (lambda r: r["input"].update(offsets={"cam1": "1.5"}), r"input\.offsets\.cam1"),
    ],
)
def test_a_report_of_another_kind_is_refused(run_folder, change, field):
    report = json.loads((run_folder / "report.json").read_text())
    change(report)
    (run_folder / "report.json").write_text(json.dumps(report))
    with pytest.raises(sk.DatasetError, match=rf"report\.json: {field}: expected"):
        read_run(run_folder)


def test_files_of_two_runs_are_told_apart(run_folder, tmp_path):
    poses = read_npz(run_folder / "pose.npz")
    other = shutil.copytree(run_folder, tmp_path / "other")
    write_npz(other / "pose.npz", poses.in_unit("m"), run=read_report(other)["run"])
    with pytest.raises(sk.DatasetError, match=r"pose\.npz: unit: expected .* \(mm\), got m"):
        read_run(other)


# the folder of an earlier run


def test_a_stop_while_writing_leaves_no_file_of_an_earlier_run(folder, arguments, monkeypatch):
    out = folder / "out"
    assert invoke(*arguments, *READ, *FAST).exit_code == 0

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(folders, "write_run_inputs", interrupted)
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


def test_files_that_no_run_wrote_are_left(folder, arguments):
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


def test_the_input_is_never_written_over(folder, arguments):
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
    refine = ["refine", folder / "Calib.toml", folder / "openpose", *READ, *FAST, "--no-html"]
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


HOLD = """
import sys
from pathlib import Path
from skelsplat._lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""


def holding(folder):
    """Start a process that holds the lock of a folder, and wait until it does."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )
    assert process.stdout.readline() == "held\n"
    return process


@pytest.fixture
def runs(finished_run, tmp_path, monkeypatch):
    """Two runs of the same frames and joints, with a layout of their own: (folder, run) each."""
    monkeypatch.setattr(folders, "can_draw", lambda: False)
    first = Run.open(finished_run)
    layout = sk.layouts.from_names("own", first.layout.joints, first.layout.limbs)
    first = replace(first, inputs=replace(first.inputs, layout=layout), report={**first.report, "note": "A"})
    moved = replace(first.poses, pose=first.poses.pose + 1)
    found = {"A": first, "B": replace(first, poses=moved, report={**first.report, "note": "B"})}
    for name, run in found.items():
        run.write(tmp_path / name)
    return {name: (tmp_path / name, run) for name, run in found.items()}


def test_the_lock_of_a_process_that_was_killed_holds_nothing(tmp_path):
    process = holding(tmp_path)
    held = rf"in use by process {process.pid} on .* since 20\d\d-"
    with pytest.raises(sk.DatasetError, match=held), locked(tmp_path):
        pass
    process.kill()
    process.communicate()
    assert [path.name for path in tmp_path.iterdir()] == [".skelsplat.lock"]
    with locked(tmp_path):
        assert f"process {os.getpid()} on" in (tmp_path / ".skelsplat.lock").read_text()
    assert not list(tmp_path.iterdir())


def test_a_run_that_is_refused_leaves_the_folder_as_it_is(runs, tmp_path):
    folder, run = runs["A"]
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    parts = folder / ".skelsplat-long-x"  # of the run that writes, or of one that was killed
    parts.mkdir()
    with (
        locked(folder),
        pytest.raises(sk.DatasetError, match="output: expected a folder into which no other"),
    ):
        run.write(folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    run.write(folder)  # removes what a killed one left
    assert not list(folder.glob(".*"))
    run.write(tmp_path / "again")  # the same run is the same bytes
    assert {path.name: path.read_bytes() for path in (tmp_path / "again").iterdir()} == before


def test_two_people_of_one_run_are_not_mixed(runs, tmp_path):
    (_, one), (_, two) = runs.values()
    people = [{"id": k, "folder": f"person_{k}"} for k in (0, 1)]
    report = {"versions": one.report["versions"], "settings": {}, "findings": [], "people": people}
    report["folders"] = [entry["folder"] for entry in people]
    PeopleRun({0: one, 1: two}, (), report).write(tmp_path, html=False)
    PeopleRun.open(tmp_path)
    mixed = tmp_path / "person_1" / "report.json"
    shutil.rmtree(mixed.parent)
    shutil.copytree(tmp_path / "person_0", mixed.parent)
    expected = rf"1/{mixed.name}: run: expected \w{{16}}_person_1, as in .*, got \w{{16}}_person_0: "
    for read in (PeopleRun.open, lambda folder: Scene.read(folder, FrameRange())):
        with pytest.raises(sk.DatasetError, match=expected):
            read(tmp_path)
