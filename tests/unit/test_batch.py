"""Many recordings: one table, found again if nothing has changed, and none that fails stops the others."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

import skelsplat as sk
from command_line import assert_fails, invoke
from skelsplat._lock import locked
from skelsplat.io import read_npz
from skelsplat.run import Job, batch, run_batch
from skelsplat.run.batch import trials
from skelsplat.run.folder import output_folder

GIVEN = {"unit": "mm", "layout": "h36m17", "fps": 50, "write": (), "html": False}
OPTIONS = ["--unit", "mm", "--layout", "h36m17", "--no-html", "--write", "csv", "--jobs", 1]


@pytest.fixture
def jobs(folder):
    """Two recordings: the same files, solved in two ways."""
    one = Job(folder / "Calib.toml", folder / "openpose", **GIVEN)
    return {"one": one, "two": replace(one, frame_by_frame=True)}


@pytest.fixture
def runs(monkeypatch):
    """Count the recordings that are refined."""
    made, run = [], batch.run

    def counted(job):
        made.append(Path(job.output).name)
        return run(job)

    monkeypatch.setattr(batch, "run", counted)
    return made


def statuses(found):
    return [one.status for one in found.recordings]


def test_a_recording_is_refined_again_only_if_something_has_changed(jobs, runs, tmp_path):
    out = tmp_path / "results"
    calls = []
    found = run_batch(jobs, out, progress=lambda *call: calls.append(call))
    assert (runs, calls, statuses(found)) == (["one", "two"], [(0, 2), (1, 2), (2, 2)], ["done"] * 2)
    rows = found.rows()
    assert [row["frames"] for row in rows] == [5, 5]
    assert rows[0]["median_error_px"] != rows[1]["median_error_px"]
    assert statuses(run_batch(jobs, out)) == ["unchanged"] * 2
    assert run_batch(jobs, out).rows() == [{**row, "status": "unchanged"} for row in rows]
    assert len(runs) == 2

    def refined(given=jobs, **options):
        runs.clear()
        run_batch(given, out, **options)
        return list(runs)

    assert refined({**jobs, "two": replace(jobs["two"], fps=25)}) == ["two"]
    assert refined() == ["two"]
    assert refined({**jobs, "two": replace(jobs["two"], config=sk.RefineConfig(n_threads=1))}) == []
    (out / "one" / "weights.png").unlink()
    assert refined() == ["one"]
    (out / "two" / "report.json").write_text((out / "one" / "report.json").read_text())
    assert refined() == ["two"]
    (out / "one" / "pose.npz").write_bytes((out / "two" / "pose.npz").read_bytes())
    assert refined() == ["one"]
    (out / "batch.json").write_text('{"recordings": [1]}')
    assert refined() == ["one", "two"]
    assert refined(overwrite=True) == ["one", "two"]
    path = next(jobs["one"].detections.rglob("*.json"))
    path.write_text(path.read_text().replace("0.9", "0.8"))
    assert refined() == ["one", "two"]


def test_one_that_fails_stops_no_other_and_is_tried_again(jobs, tmp_path):
    jobs = {"bad": replace(jobs["one"], detections=tmp_path / "none"), **jobs}
    found = run_batch(jobs, tmp_path / "results")
    assert statuses(found) == ["failed", "done", "done"]
    (failed,) = found.failed
    assert "none: folder: expected" in failed.error
    with (tmp_path / "results" / "batch.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["status"] for row in rows] == ["failed", "done", "done"]
    assert (rows[0]["error"], rows[0]["frames"], rows[1]["error"]) == (failed.error, "", "")
    document = json.loads((tmp_path / "results" / "batch.json").read_text())
    assert [entry["name"] for entry in document["recordings"]] == ["bad", "one", "two"]
    assert [entry.get("key") is None for entry in document["recordings"]] == [True, False, False]
    assert statuses(run_batch(jobs, tmp_path / "results")) == ["failed", "unchanged", "unchanged"]


def test_a_second_batch_in_the_same_folder_is_refused_and_a_recording_in_use_fails(jobs, tmp_path):
    out = tmp_path / "results"
    with output_folder(out), locked(out, ".skelsplat-batch.lock"):
        with pytest.raises(sk.DatasetError, match="output: expected a folder into which no other run writes"):
            run_batch(jobs, out)
        assert [path.name for path in out.iterdir()] == [".skelsplat-batch.lock"]
    with output_folder(out / "two"), locked(out / "two"):
        found = run_batch(jobs, out)
    assert statuses(found) == ["done", "failed"]
    assert f"one in use by process {os.getpid()} on" in found.failed[0].error


def test_a_batch_that_was_stopped_goes_on(jobs, runs, tmp_path):
    def stop(_done, _total):
        if runs:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="1 of 2 recordings are done: run it again for the others"):
        run_batch(jobs, tmp_path / "results", progress=stop)
    assert runs == ["one"]
    assert statuses(run_batch(jobs, tmp_path / "results")) == ["unchanged", "done"]
    assert runs == ["one", "two"]
    runs.clear()
    # stopped again, while all was to be refined for another reason: what is there is kept
    with pytest.raises(KeyboardInterrupt):
        run_batch({**jobs, "one": replace(jobs["one"], fps=25)}, tmp_path / "results", progress=stop)
    assert statuses(run_batch(jobs, tmp_path / "results")) == ["done", "unchanged"]


def test_processes_give_the_same_results(jobs, tmp_path, monkeypatch):
    undrawn = "from skelsplat.run import figures; figures.write_figures = lambda *_: []"
    monkeypatch.setattr(batch, "_PROGRAM", f"{undrawn}\n{batch._PROGRAM}")
    jobs = {"one": jobs["one"], "bad": replace(jobs["one"], detections=tmp_path / "none")}
    one, two = (run_batch(jobs, tmp_path / str(n), processes=n) for n in (1, 2))
    assert statuses(one) == statuses(two) == ["done", "failed"]
    assert one.failed[0].error == two.failed[0].error
    for name in ("pose", "error_bar"):
        found = (getattr(read_npz(tmp_path / n / "one" / "pose.npz"), name) for n in "12")
        assert next(found).tobytes() == next(found).tobytes()
    left, right = ((tmp_path / n / "batch.csv").read_text().replace(str(tmp_path / n), "") for n in "12")
    assert left == right


def test_a_process_that_dies_fails_its_recording_alone(jobs, tmp_path, monkeypatch):
    monkeypatch.setattr(batch, "_PROGRAM", "import sys; sys.exit('no memory')")
    found = run_batch(jobs, tmp_path / "results", processes=2)
    assert [one.error for one in found.failed] == ["its process ended with status 1: no memory"] * 2


def test_a_folder_that_holds_detections_is_refused(jobs, runs, folder, tmp_path):
    before = sorted(folder.rglob("*"))
    of_one = tmp_path / "apart" / "batch.csv"
    given = {
        jobs["one"].detections: jobs,
        jobs["one"].detections / "cam1": jobs,
        jobs["one"].detections / "results": jobs,
        of_one.parent: {"csv": replace(jobs["one"], detections=of_one)},
    }
    for out, wanted in given.items():
        with pytest.raises(sk.InvalidInputError, match="output: expected a folder in which no input is over"):
            run_batch(wanted, out)
    assert runs == []
    assert sorted(folder.rglob("*")) == before


# The command line


@pytest.fixture
def listed(folder):
    """Write a file of two sessions; return its folder."""
    (folder / "sessions.toml").write_text(
        '[defaults]\ncalibration = "Calib.toml"\nfps = 50\n'
        '[[session]]\ndetections = "openpose"\n'
        '[[session]]\nname = "day 2/walk"\ndetections = "none"\nlayout = "coco17"\n'
        'frame_by_frame = true\noutput = "own"\n'
    )
    return folder


def test_a_table_says_what_was_found_and_what_failed_and_why(listed):
    result = invoke("batch", listed / "sessions.toml", "-o", listed / "out", *OPTIONS)
    assert result.exit_code == 1, result.output
    (line,) = result.stderr.splitlines()  # once, where errors are found
    assert line.startswith(f"error: day 2/walk: {listed / 'none'}: ")
    words = " ".join(result.stdout.split())
    assert "openpose 5 " in words
    assert "day 2/walk – – – failed 2 recordings: " in words
    assert "2 recordings: 1 refined, 1 failed." in words
    assert words.endswith(
        f"Wrote to {listed / 'out'}/: batch.csv, batch.json, and a folder per refined recording"
    )
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert (listed / "out" / "openpose" / "pose.csv").is_file()
    again = invoke("batch", listed / "sessions.toml", "-o", listed / "out", *OPTIONS, "--json")
    document = json.loads(again.stdout)
    assert [entry["status"] for entry in document["recordings"]] == ["unchanged", "failed"]
    assert again.stderr.startswith("error: day 2/walk: ")
    quiet = invoke("batch", listed / "sessions.toml", "-o", listed / "out", *OPTIONS, "-q")
    assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (1, "", f"{line}\n")


def test_a_recording_without_a_usable_detection_ends_with_an_error_as_in_refine(listed):
    words = ["batch", listed / "sessions.toml", "-o", listed / "out", *OPTIONS, "--min-confidence", 1]
    (listed / "sessions.toml").write_text(
        '[[session]]\ncalibration = "Calib.toml"\ndetections = "openpose"\nfps = 50\n'
    )
    for _ in range(2):  # the second time unchanged
        result = invoke(*words)
        assert result.exit_code == 1
        assert result.stderr.startswith("error: openpose: No detection could be used")
        assert "openpose 5 – – no detections" in " ".join(result.stdout.split())


@pytest.fixture
def asked(monkeypatch):
    """Keep the jobs that a command would do."""
    kept = {}

    def keep(jobs, folder, **options):
        kept.update(jobs=jobs, folder=folder, **options)
        return batch.Batch(())

    monkeypatch.setattr("skelsplat.cli.batch.run_batch", keep)
    return kept


def test_the_command_line_wins_over_the_session_over_the_defaults_over_the_configuration(listed, asked):
    (listed / "run.toml").write_text('layout = "body25"\nunit = "mm"\nfps = 10\nmax_steps = 7\n')
    given = ["--config", listed / "run.toml", "-o", listed / "out", "--y-up", "-q"]
    assert invoke("batch", listed / "sessions.toml", *given).exit_code == 0
    first, second = asked["jobs"].values()
    assert list(asked["jobs"]) == ["openpose", "day 2/walk"]
    assert (first.layout, second.layout, first.unit, first.fps) == ("body25", "coco17", "mm", 50)
    assert (first.settings.max_steps, first.y_up, first.output) == (7, True, None)
    assert (first.frame_by_frame, second.frame_by_frame) == (False, True)
    assert second.output == listed / "own"
    assert first.calibration == listed / "Calib.toml"
    assert (asked["folder"], asked["overwrite"]) == (listed / "out", False)
    given = ["--layout", "h36m17", "--fps", 25, "--jobs", 3, "--overwrite"]
    assert invoke("batch", listed / "sessions.toml", "-o", listed / "out", *given, "-q").exit_code == 0
    assert {(job.layout, job.fps) for job in asked["jobs"].values()} == {("h36m17", 25)}
    assert (asked["processes"], asked["overwrite"]) == (3, True)


SESSION = '[[session]]\ncalibration = "Calib.toml"\ndetections = "openpose"\n'


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("", "session: "),
        ("[[sessions]]", "sessions: "),
        (f"[defaults]\nlayuot = 'x'\n{SESSION}", "defaults.layuot: "),
        (f"{SESSION}fsp = 3", "session 1.fsp: "),
        ("[[session]]\ndetections = 'x'", "session 1.calibration: "),
        (f"{SESSION}name = '../x'", "session 1.name: "),
        (f"{SESSION}unit = 'ft'", "openpose: --unit: "),
    ],
)
def test_a_file_that_is_wrong_is_named_with_its_key_before_any_work(tmp_path, asked, text, key):
    (tmp_path / "sessions.toml").write_text(text)
    result = invoke("batch", tmp_path / "sessions.toml", "-o", tmp_path / "out")
    assert_fails(result, 2, f"SESSIONS: {tmp_path / 'sessions.toml'}: {key}")
    assert asked == {}


def project(root, *files):
    for name in files:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("")
    return root


def test_the_trials_of_a_project_are_found_with_the_nearest_calibration(tmp_path, asked):
    root = project(
        tmp_path / "Project",
        *("calibration/Calib.toml", "calibration/intrinsics/a.png", "Config.toml"),
        *("Trial_1/pose/cam1_json/0.json", "Trial_1/pose-sync/cam1_json/0.json", "Trial_1/pose-3d/a.trc"),
        *("P02/Calib_2/Calib_qualisys.toml", "P02/T01/pose/cam1_json/0.json", "P02/T01/videos/a.mp4"),
        ".git/pose/a",
    )
    (root / "Trial_3" / "pose").mkdir(parents=True)  # empty: nothing was detected yet
    shared, own = root / "calibration" / "Calib.toml", root / "P02" / "Calib_2" / "Calib_qualisys.toml"
    assert trials(root) == {
        "P02/T01": (own, root / "P02" / "T01" / "pose"),
        "Trial_1": (shared, root / "Trial_1" / "pose-sync"),
    }
    assert trials(project(tmp_path / "Single", "calib/c.toml", "pose/cam1_json/0.json")) == {
        "Single": (tmp_path / "Single" / "calib" / "c.toml", tmp_path / "Single" / "pose")
    }
    assert invoke("batch", root, "-o", tmp_path / "out", "--unit", "m", "-q").exit_code == 0
    assert [job.unit for job in asked["jobs"].values()] == ["m", "m"]


@pytest.mark.parametrize(
    ("files", "field"),
    [
        (["calibration/a.toml"], "folder"),
        (["T/pose/a.json"], "calibration"),
        (["calibration/a.toml", "calibration/b.toml", "T/pose/a.json"], "calibration"),
    ],
)
def test_a_project_that_is_not_complete_is_an_error(tmp_path, files, field):
    with pytest.raises(sk.DatasetError) as caught:
        trials(project(tmp_path / "Project", *files))
    assert caught.value.field == field
