"""`skelsplat refine` into the folder of an earlier run: what goes, what stays, and what is said of it."""

from __future__ import annotations

import numpy as np

from command_line import FAST, READ, RESULTS, invoke
from skelsplat.cli import _run
from skelsplat.io import read_npz


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
    assert invoke(*arguments, *READ, *FAST).exit_code == 0

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(_run, "write_run_inputs", interrupted)
    assert invoke(*arguments, *READ, *FAST).exit_code == 130
    left = {path.name for path in (folder / "out").iterdir()}
    assert left == {"pose.npz", "pose.csv", "pose.trc"}


def test_a_run_reads_from_the_folder_that_it_writes(recording, arguments):
    folder, _, _ = recording
    out = folder / "out"
    assert invoke(*arguments, *READ, *FAST).exit_code == 0
    before = read_npz(out / "pose.npz").pose
    again = ["refine", out / "cameras.json", out / "detections.npz", "-o", out, "--layout", "h36m17"]
    assert invoke(*again, *FAST, "--init", out / "pose.npz").exit_code == 0
    assert {path.name for path in out.iterdir()} == RESULTS
    np.testing.assert_allclose(read_npz(out / "pose.npz").pose, before, atol=1.0)


def test_pictures_of_an_earlier_run_are_said_to_be_that(recording, arguments):
    folder, _, _ = recording
    out = folder / "out"
    assert "earlier run" not in invoke(*arguments, *READ, *FAST).stdout
    for name in ("plots", "overlay"):
        (out / name).mkdir()
    assert "earlier run" not in invoke(*arguments, *READ, *FAST).stdout  # they are empty
    (out / "overlay" / "cam1.mp4").write_text("")
    assert invoke(*arguments, *READ, *FAST).stdout.endswith("\n! overlay/ is of an earlier run\n")
    (out / "plots" / "bones.png").write_text("")
    said = invoke(*arguments, *READ, *FAST).stdout
    assert said.endswith("\n! plots/ and overlay/ are of an earlier run\n")
    assert "earlier run" not in invoke(*arguments, *READ, *FAST, "--json").output
    assert invoke(*arguments, *READ, *FAST, "--quiet").output == ""
