"""What all commands share: --json, --quiet, examples in --help, and no colour where there is no terminal."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from io import StringIO

import pytest
from rich.console import Console
from rich.table import Column, Table

from command_line import ROOT, commands, invoke, succeed
from skelsplat import synthetic
from skelsplat.cli.output import quieter, tell
from skelsplat.cli.table import print_table
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.findings import Finding
from sweeps import swept

COMMANDS = {path: {opt for own in command.params for opt in own.opts} for path, command in commands(ROOT)}


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_every_command_has_examples_json_and_quiet(path):
    text = invoke(*path, "--help").stdout
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 80
    examples = text.split("Examples")[1]
    assert f"skelsplat {' '.join(path)}" in examples
    assert {"--quiet", "-q", "--config"} <= COMMANDS[path]
    if path == ("live",):
        assert "there is no --json" in " ".join(text.split())
    else:
        assert "--json" in COMMANDS[path]


def test_help_lists_every_command_with_the_first_line_of_its_own():
    assert {name: command.help.split("\n")[0] for name, command in ROOT.commands.items()} == ROOT.texts
    listed = invoke("--help").stdout.partition("Commands")[2]
    assert [name for name in ROOT.texts if f"│ {name} " not in listed] == []


def test_help_of_refine_is_one_screen_and_help_all_the_rest():
    short, every = (invoke("refine", option).stdout for option in ("--help", "--help-all"))
    assert len(short.split("Results in FOLDER")[0].rstrip().splitlines()) <= 40
    assert {"CALIBRATION", "DETECTIONS", "--output", "--help-all", "--config"} <= set(short.split())
    assert "--symmetry-tier" not in short
    shown = {word for word in every.split() if word.startswith("--")}
    assert {opt for opt in COMMANDS["refine",] if opt.startswith("--")} <= shown
    assert max(len(line.rstrip()) for line in every.splitlines()) <= 80
    assert "[default: consistent]" in every
    assert invoke("refine", "--help").stdout == short


@pytest.fixture(scope="module")
def dome(tmp_path_factory):
    root = tmp_path_factory.mktemp("data") / "dome"
    write_simulated(root, synthetic.simulate_set("dome", poses=12))
    return root


@pytest.fixture
def cases(folder, dome):
    """Every command that prints a result, with arguments and the keys of its document."""
    calibration, out = folder / "Calib.toml", folder / "out"
    return {
        "demo": (["-o", out], {"input", "findings"}),
        "refine": (
            [calibration, folder / "openpose", "--layout", "h36m17", "-o", out, "--fps", 50],
            {"input", "findings"},
        ),
        "convert": (
            [calibration, folder / "rig.json"],
            {"kind", "input", "output", "format", "cameras", "unit"},
        ),
        "adjust-cameras": (
            [calibration, folder / "openpose", "--layout", "h36m17", "-o", folder / "fixed.toml"],
            {"calibration", "output", "frames", "findings", "cameras"},
        ),
        "check-cameras": ([calibration], {"calibration", "ok", "findings", "cameras"}),
        "synth": (["dome", folder / "set", "--poses", 12], {"folder", "name", "takes", "parameters"}),
        "datasets check": (["synthetic", dome], {"name", "ok", "findings", "dataset"}),
        "evaluate": (["synthetic", dome, "-m", "dlt", "-o", out], {"dataset", "protocol"}),
        "ablate": (["accumulation", "--poses", 1], {"ablation", "tables", "command"}),
    }


@pytest.mark.usefixtures("short_sample")
@pytest.mark.parametrize(
    "name",
    [
        *("demo", "refine", "convert", "adjust-cameras", "check-cameras"),
        *("synth", "datasets check", "evaluate", swept("ablate")),
    ],
)
def test_json_is_a_document_and_quiet_is_silence(cases, name):
    arguments, keys = cases[name]
    result = succeed(*name.split(), *arguments, "--json")
    document = json.loads(result.stdout, parse_constant=pytest.fail)
    assert keys <= document.keys()
    force = ["--force"] if name == "convert" else []
    if name == "synth":
        shutil.rmtree(arguments[1])
    quiet = invoke(*name.split(), *arguments, *force, "-q")
    assert (quiet.exit_code, quiet.stdout) == (0, "")
    assert all(line.startswith("warning: ") for line in quiet.stderr.splitlines())


COLOURED = ["datasets", "list"]


def through_a_pipe(*args, **variables):
    environment = {k: v for k, v in os.environ.items() if k not in ("FORCE_COLOR", "GITHUB_ACTIONS")}
    command = [sys.executable, "-m", "skelsplat", *map(str, args)]
    return subprocess.run(command, env={**environment, **variables}, capture_output=True, check=True)


@pytest.mark.parametrize("args", [COLOURED, *map(swept, (["refine", "--help"], ["--help"]))])
def test_no_colour_without_a_terminal(args):
    assert b"\x1b" not in through_a_pipe(*args, TERM="xterm-256color", COLORTERM="truecolor").stdout


@pytest.mark.parametrize("width", [40, 80])
def test_a_table_keeps_names_and_words_whole_on_a_narrow_console(width):
    names = ["camera_of_the_laboratory_north_wall_0123456789", "cam 2"]
    table = Table("camera", Column("90th percentile", justify="right"), *["rejected"] * 6, box=None)
    for name in names:
        table.add_row(name, "14.8 → 14.4", *["12345"] * 6)
    console = Console(file=StringIO(), width=width)
    print_table(console, table)
    said = console.file.getvalue()
    for words in (*names, "14.8 →", "percentile", *["rejected"] * 6):
        assert words in said
        said = said.replace(words, "", 1)
    assert "…" not in said
    assert console.width == width


def test_a_finding_begins_with_its_severity(capsys):
    for severity in ("error", "warning", "note"):
        finding = Finding("remark", severity, sentence="words")
        tell(finding)
        with quieter(True):
            tell(finding)
    tell(finding, "person 1: ")
    said = ["error: words"] * 2 + ["warning: words"] * 2 + ["note: words", "note: person 1: words"]
    assert capsys.readouterr().err.splitlines() == said
