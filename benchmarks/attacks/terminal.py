"""Names with control characters and markup in calibrations, detections, layouts and folders."""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import skelsplat as sk
from attacks import attack
from skelsplat import synthetic
from skelsplat.cameras import altered
from skelsplat.cli import app
from skelsplat.io import write_calibration

_CAMERAS = ("\x1b]0;x\x07[red]x[/red]", "a\x9b2Jb", "c\nerror: none", "\u202ed")
_JOINTS = ("\x1b[31mhead", "b\x9bc", "[bold]d[/bold]", "left_\u2028e", "right_\u2028e", "f")
_OBEYED = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e]|^error: none", re.MULTILINE)


def _files(top: Path) -> None:
    cameras = [altered(one, name=name) for one, name in zip(synthetic.human36m_like(), _CAMERAS, strict=True)]
    rig = sk.CameraRig(cameras, "mm")
    write_calibration(top / "rig.json", rig)
    sk.layouts.write(top / "own.toml", sk.layouts.from_names("lay\x1bout", _JOINTS, [(0, 1), (2, 3), (2, 4)]))
    seen = sk.project(synthetic.motion("walk", 4, seed=3)[:, :6], rig).swapaxes(0, 1)
    seen[:, 1, :, 0] += 60
    names = {"camera_names": np.array(_CAMERAS), "joint_names": np.array(_JOINTS)}
    np.savez(top / "seen.npz", detections=seen, frames=np.arange(4), **names)
    session = '[[session]]\nname = "a\\u001b[31m"\ncalibration = "rig.json"\ndetections = "none.npz"\n'
    (top / "sessions.toml").write_text(session)


@attack("12b", "commands that print names from files: how many let the terminal obey them", "0 of 12")
def names_on_the_terminal() -> str:
    with tempfile.TemporaryDirectory() as place:
        top = Path(place, "o\x1b[31mt")
        top.mkdir()
        _files(top)
        read = [top / "rig.json", top / "seen.npz", "--layout", top / "own.toml"]
        calls = [
            ["refine", *read, "-o", top / "out", "--fps", 50, "--write", "csv", "--no-html"],
            ["refine", *read, "-o", top / "out", "--fps", 50, "--write", "csv", "--no-html", "--json"],
            ["check-cameras", *read],
            ["adjust-cameras", *read, "-o", top / "new.toml"],
            ["convert", top / "rig.json", top / "new.json"],
            ["layouts", top / "own.toml"],
            ["layouts", top / "own.toml", "--toml"],
            ["live", top / "rig.json", "--layout", top / "own.toml"],
            ["batch", top / "sessions.toml", "-o", top / "batch"],
            ["overlay", top / "out", "--plain", "--png", "--range", "0-0"],
            ["plot", top / "out", "--only", "bones", "--format", "png"],
            ["plot", top / "none\x9b"],
        ]
        line = json.dumps({"detections": {"\x1b[31m\x9bx": []}}) + "\n"
        obeyed = 0
        for call in calls:
            said = CliRunner().invoke(app, [str(word) for word in call], input=line)
            crashed = not isinstance(said.exception, SystemExit | None)
            obeyed += crashed or bool(_OBEYED.search(said.stdout + said.stderr))
    return f"{obeyed} of {len(calls)}"
