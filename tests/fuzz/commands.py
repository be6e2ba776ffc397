"""Odd options of every command on small inputs: status 0, 1 or 2, one line for an error, files that read."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import numpy as np
import typer
from matplotlib.figure import Figure
from typer.testing import CliRunner

from fuzz import mutate, readers
from fuzz.readers import RIG, SEEN, T
from skelsplat import layouts, synthetic
from skelsplat.cli import app
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.io import write_calibration
from skelsplat.run import Run

START: dict[str, list[str]] = {
    "refine": ["rig.json", "people.npz", "-o", "out", "--layout", "h36m17"],
    "check-cameras": ["rig.json", "people.npz", "--layout", "h36m17"],
    "adjust-cameras": ["rig.json", "people.npz", "-o", "rig2.json", "--layout", "h36m17"],
    "convert": ["run/pose.npz", "pose.trc"],
    "batch": ["sessions.csv", "-o", "out"],
    "live": ["rig.json", "--layout", "h36m17"],
    "plot": ["run", "-o", "plots"],
    "overlay": ["run", "--plain"],
    "layouts": ["coco17"],
    "synth": ["human36m-like", "data2", "--poses", "60"],
    "datasets check": ["synthetic", "data"],
    "evaluate": ["synthetic", "data", "-m", "dlt,annealed"],
}
WEIGHTS = [6, 3, 2, 4, 1, 3, 1, 1, 2, 1, 2, 2]
PATHS = (
    "rig.json",
    "people.npz",
    "run",
    "run/pose.npz",
    "data",
    "options.toml",
    "own.toml",
    "x",
    ".",
    "/dev/null",
    "out.c3d",
)
# Values that options take, sometimes.
USUAL = {
    "layout": ("h36m17", "coco17", "own.toml", "file"),
    "person": ("consistent", "0", "largest", "moves-most", "cam1:640,360"),
    "people": ("all", "1", "2"),
    "frames": ("strict", "union", "intersection"),
    "offset": ("cam1=3", "cam_02=-1", "CAM3=1"),
    "order": ("sorted", "cam4,cam3,cam2,cam1"),
    "without": ("cam1", "cam_02", "CAM3"),
    "move": ("cam1", "cam_02"),
    "joint_map": ("head=0", "nose=1", "head=", "head=9"),
    "init": ("run/pose.npz",),
    "unit": ("mm", "cm", "m"),
    "to_unit": ("mm", "cm", "m"),
    "size": ("1000x1000", "cam1=1000x1000"),
    "symmetry_tier": ("0", "1", "2", "3"),
    "filter": ("butterworth:6", "kalman", "one-euro:1", "butterworth:0.5", "kalman:100"),
    "write": ("csv,trc,json,nc,c3d", "npz", "c3d", "nc"),
    "pose_formats": ("csv,trc,json,nc,c3d", "npz", "c3d", "nc"),
    "marker_names": ("pose2sim", "skelsplat"),
    "format": ("npz", "openpose", "csv", "json", "easymocap", "trc"),
    "only": ("bones", "trajectories", "errors"),
    "joints": ("nose", "head,nose", "right_wrist"),
    "range": ("0-2", "1-1", "2-0", "-1"),
    "methods": ("dlt", "ransac,robust", "annealed", "over-time", "all"),
    "detections": ("good", "noisy"),
    "detector": ("good", "noisy"),
    "sets": ("views=2", "detector=noisy"),
    "lag": ("0", "1", "5"),
}
NUMBERS = ("0.5", "1", "2", "3", "25", "50", "1e-3", "1e6")
# What they count is work: large numbers are valid, and take long.
COUNTS = ("--poses", "--scenes", "--frames", "--people", "--views", "--max-steps", "--jobs")
FEW = ("-1", "0", "1", "3", "x", "5.5", "nan", "9" * 400, "-")


def _write_inputs(folder: Path) -> None:
    import skelsplat as sk

    write_calibration(folder / "rig.json", RIG)
    people = np.stack([SEEN, SEEN[::-1]], axis=2)
    names = np.array(RIG.names)
    np.savez(folder / "people.npz", detections=people, frames=np.arange(T), camera_names=names)
    run = Run.from_arrays(sk.refine(None, SEEN, RIG, layout="h36m17"), RIG, SEEN, "h36m17", fps=25.0)
    with mock.patch("skelsplat.run.figures.write_figures", return_value=[]):
        run.write(folder / "run", ("npz", "csv", "trc", "json"), html=False)
    layouts.write(folder / "own.toml", layouts.H36M17)
    write_simulated(folder / "data", synthetic.simulate_people_set(2, 3, 1, frames=3))
    (folder / "sessions.csv").write_text("name,calibration,detections,layout\na,rig.json,people.npz,h36m17\n")
    (folder / "options.toml").write_text(
        'layout = "h36m17"\nquiet = true\n[refine]\nfps = 25.0\nfill-gaps = 2\n'
    )
    (folder / "lines").write_text(
        "".join(json.dumps({"detections": frame.tolist()}) + "\n" for frame in SEEN)
    )


@cache
def _inputs() -> Path:
    folder = Path(tempfile.mkdtemp())
    _write_inputs(folder)
    return folder


@cache
def _options(name: str) -> list[Any]:
    found: Any = typer.main.get_command(app)
    for part in name.split():
        found = found.get_command(None, part)
    return [
        param for param in found.params if param.opts[0].startswith("-") and "config" not in param.opts[0]
    ]


def case(rng: Random, folder: Path) -> tuple[str, Callable[[], str]]:
    """Return a command with some odd options or arguments, in a folder of its own with its inputs."""
    shutil.copytree(_inputs(), folder, dirs_exist_ok=True)
    (name,) = rng.choices(list(START), WEIGHTS)
    arguments = list(START[name])
    options = [["--config", "options.toml"]] if rng.random() < 0.15 else []
    options += [
        _option(rng, param) for param in rng.sample(_options(name), min(rng.choice((0, 1, 1, 2, 3, 5)), 3))
    ]
    arguments += [word for option in options for word in option]
    if rng.random() < 0.1:
        arguments[rng.randrange(len(arguments))] = _word(rng)
    if rng.random() < 0.3:
        for path in rng.sample([p for p in folder.rglob("*") if p.is_file()], rng.choice((1, 2))):
            path.write_bytes(mutate.file(rng, path.read_bytes(), path.name))
    lines = (folder / "lines").read_text(encoding="utf-8", errors="surrogateescape") if name == "live" else ""
    return f"skelsplat {name} {arguments}", lambda: tried(folder, [*name.split(), *arguments], lines)


def _option(rng: Random, param: Any) -> list[str]:
    option = rng.choice(param.opts)
    if getattr(param, "is_flag", False):
        return [option]
    if option in COUNTS:
        return [option, rng.choice(FEW)]
    if rng.random() < 0.75:
        spelt = str(param.metavar).split("|")
        return [option, rng.choice(USUAL.get(param.name) or (spelt if len(spelt) > 1 else NUMBERS))]
    return [option, _word(rng)]


def _word(rng: Random) -> str:
    word = rng.choice(rng.choice((PATHS, mutate.WORDS)))
    return word.replace("\0", "0").replace("../../etc/passwd", "../outside")


def tried(folder: Path, arguments: list[str], lines: str) -> str:
    """Run a command; raise for a traceback, another status, and for output that is not as it should be."""
    drawing = (
        mock.patch("skelsplat.run.figures.write_figures", return_value=[]),
        mock.patch.object(Figure, "savefig"),
    )
    given = lines.encode("utf-8", "surrogateescape")
    before = Path.cwd()
    os.chdir(folder)
    try:
        with drawing[0], drawing[1]:
            result = CliRunner().invoke(app, arguments, input=given, env={"COLUMNS": "80"})
    finally:
        os.chdir(before)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    said = result.stdout + result.stderr
    assert result.exit_code in (0, 1, 2), f"status {result.exit_code}"
    judging = arguments[0] == "check-cameras" or arguments[:2] == [
        "datasets",
        "check",
    ]  # status 1: faults found
    assert len(errors) == (result.exit_code != 0) or (judging and result.exit_code == 1), (
        f"status {result.exit_code} with {len(errors)} errors"
    )
    assert not errors or result.stderr.splitlines()[-1] == errors[0], "lines after the error"
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", said), (
        "control characters in the output"
    )
    if result.exit_code == 0 and "--json" in arguments and "--help-all" not in arguments:
        json.loads(result.stdout, parse_constant=lambda name: readers._fail(f"{name} in the output"))
    if result.exit_code == 0:
        for report in sorted((folder / "out").glob("**/report.json")):
            if "folders" not in json.loads(report.read_text()):  # of several people
                Run.open(report.parent)
    return f"status {result.exit_code}"
