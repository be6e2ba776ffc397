"""The folder of a run is read back whole, and a folder that is none is refused."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, invoke, read_report
from skelsplat.io import read_npz, read_run, write_npz


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


def test_the_stored_input_can_be_refined_again(run_folder, tmp_path):
    stored = [run_folder / "cameras.json", run_folder / "detections.npz"]
    assert invoke("refine", *stored, *READ, "--fps", 50, "-o", tmp_path / "again").exit_code == 0
    np.testing.assert_array_equal(read_run(tmp_path / "again").poses.pose, read_run(run_folder).poses.pose)


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


def test_a_run_that_stops_half_way_leaves_no_mixture_of_two(run_folder, arguments, monkeypatch):
    def stop(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("skelsplat.run.folder.write_run_inputs", stop)
    assert invoke(*arguments, *READ, "--fps", 50, "--sigma-mm", 20).exit_code == 1
    with pytest.raises(sk.DatasetError, match=r"report\.json: unfinished: expected .* run it again"):
        read_run(run_folder)
