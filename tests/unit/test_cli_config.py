"""``--config``: options from a TOML file, and what is said of a file that does not fit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from command_line import ROOT, assert_fails, commands, invoke
from skelsplat.cli import refine
from skelsplat.cli.config import entries_of

BASE = """
calibration = "Calib.toml"
detections = "openpose"
layout = "h36m17"
"""


def configured(folder, text, *args, command="refine"):
    (folder / "run.toml").write_text(BASE + text, encoding="utf-8")
    return invoke(*command.split(), "--config", folder / "run.toml", *args)


def report(folder, out="out"):
    return json.loads((folder / out / "report.json").read_text())


REFINE = """
output = "out"
min-confidence = 0.25
max_steps = 7
fps = 50
quiet = true
"""


def test_arguments_and_required_options_may_come_from_the_file(folder):
    result = configured(folder, REFINE + "no-undistort = true\n")
    assert (result.exit_code, result.output) == (0, "")
    said = report(folder)
    assert said["input"]["calibration"] == str(folder / "Calib.toml")
    assert said["input"]["frame_rate_hz"] == 50.0
    settings = said["settings"]
    assert (settings["min_confidence"], settings["max_steps"], settings["undistort"]) == (0.25, 7, False)


def test_the_command_line_counts_more(folder):
    result = configured(
        folder, REFINE + "no-swaps = true\n", "--max-steps", 9, "-o", folder / "there", "--swaps"
    )
    assert result.exit_code == 0, result.output
    settings = report(folder, "there")["settings"]
    assert (settings["min_confidence"], settings["max_steps"], settings["find_swaps"]) == (0.25, 9, True)
    assert not (folder / "out").exists()


def test_relative_paths_begin_at_the_files_folder(folder, monkeypatch):
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    (folder / "run.toml").write_text(BASE + REFINE)
    assert invoke("refine", "--config", Path("..") / "run.toml").exit_code == 0
    assert (folder / "out" / "pose.npz").is_file()
    assert invoke("refine", "--config", Path("..") / "run.toml", "-o", "here").exit_code == 0
    assert (folder / "elsewhere" / "here" / "pose.npz").is_file()
    absolute = f"calibration = {json.dumps(str(folder / 'Calib.toml'))}\n"
    (folder / "elsewhere" / "check.toml").write_text(absolute)
    assert invoke("check-cameras", "--config", "check.toml").exit_code == 0


def test_one_file_for_several_commands(folder):
    text = """
    layout = "h36m17"
    fps = 50
    [refine]
    output = "out"
    calibration = "Calib.toml"
    detections = "openpose"
    [check-cameras]
    calibration = "Calib.toml"
    detections = "openpose"
    frames = "intersection"
    json = true
    [datasets]
    json = true
    """
    (folder / "run.toml").write_text(text)

    def run(*command):
        return invoke(*command, "--config", folder / "run.toml")

    assert run("refine", "-q").exit_code == 0
    assert report(folder)["input"]["frame_rate_hz"] == 50.0
    checked = run("check-cameras")
    assert json.loads(checked.stdout)["detections"] == str(folder / "openpose")
    assert json.loads(run("datasets", "list").stdout)[0]["name"] == "human36m"


@pytest.mark.parametrize(
    "text",
    [
        'offset = ["cam1=2", "cam3=-1"]\nmap = ["pelvis=none"]',
        '[refine]\noffset = {cam1 = 2, cam3 = -1}\n[refine.map]\npelvis = "none"',
    ],
)
def test_repeatable_options_are_lists_or_tables(folder, text, monkeypatch):
    jobs = []
    monkeypatch.setattr(refine, "run_and_print", lambda job, **_: jobs.append(job))
    result = configured(folder, REFINE + text)
    assert result.exit_code == 0, result.output
    assert (jobs[0].offsets, jobs[0].mapping) == ({"cam1": 2, "cam3": -1}, {"pelvis": None})
    assert configured(folder, REFINE + text, "--offset", "cam2=1").exit_code == 0
    assert (jobs[1].offsets, jobs[1].mapping) == ({"cam2": 1}, {"pelvis": None})


def test_a_name_is_a_path_where_a_file_has_it(folder, monkeypatch):
    jobs = []
    monkeypatch.setattr(refine, "run_and_print", lambda job, **_: jobs.append(job))
    (folder / "halpe26").touch()
    for layout in ("halpe26", "body25"):
        text = (BASE + REFINE).replace("h36m17", layout)
        (folder / "run.toml").write_text(text)
        assert invoke("refine", "--config", folder / "run.toml").exit_code == 0
    assert [job.layout for job in jobs] == [str(folder / "halpe26"), "body25"]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("min-confidance = 3", ["min-confidance: ", "did you mean min-confidence?"]),
        ("[refin]\nfps = 3", ["refin: ", "did you mean refine?"]),
        ("refine = 3", ["refine: expected a table"]),
        ("max-steps = true", ["max-steps: expected text or a number"]),
        ('init = ""', ["init: expected a path"]),
        ("quiet = 1", ["quiet: expected true or false"]),
        ("offset = {cam1 = true}", ["offset.cam1: expected text or a number"]),
    ],
)
def test_a_file_that_does_not_fit_is_status_2_and_names_file_and_key(folder, text, parts):
    result = configured(folder, text, "-o", folder / "x")
    assert_fails(result, 2, "--config: ", f"{folder / 'run.toml'}: ", *parts)


def test_the_table_of_a_command_is_judged_when_that_command_runs(folder):
    text = "[ablate]\nfps = 3\n"
    assert configured(folder, text + "[refine]\n" + REFINE).exit_code == 0
    result = configured(folder, text, command="ablate")
    assert_fails(result, 2, "--config: ", "ablate.fps: expected an option or argument of ablate, got")


@pytest.mark.parametrize(
    ("text", "part"), [("max-steps = 3.5", "--max-steps: "), ("offset = 3", "--offset: expected A=B")]
)
def test_a_value_that_the_command_refuses_names_the_option(folder, text, part):
    assert_fails(configured(folder, text, "-o", folder / "x"), 2, part)


@pytest.mark.parametrize("content", [None, b"fps = ", b"fps = 3\nfps = 4\n", b"\xff\xfe"])
def test_a_file_that_cannot_be_read_is_status_1(tmp_path, content):
    path = tmp_path / "run.toml"
    if content is not None:
        path.write_bytes(content)
    assert_fails(invoke("refine", "--config", path), 1, f"{path}: ")


@pytest.mark.parametrize("path", [path for path, _ in commands(ROOT)], ids=" ".join)
def test_every_command_has_it_and_no_option_is_called_like_a_command(path):
    text = " ".join(invoke(*path, "--help").stdout.replace("│", " ").split())
    assert "--config FILE.toml Read options and arguments from a file" in text
    assert "<bool>" not in text
    command = dict(commands(ROOT))[path]
    names = {name for parts, _ in commands(ROOT) for name in parts}
    both = [entry for key, entry in entries_of(command).items() if key in names]
    assert all(entry.kind is bool for entry in both)  # a table is the command's, another value the option's
    parameters = {param.name for param in command.params} - {"config", "help_all"}
    assert {entry.name for entry in entries_of(command).values()} == parameters
