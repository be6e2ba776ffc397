"""The HTML report of made-up arrays, for the tests of its builder and of the page in a browser."""

from __future__ import annotations

import base64
import json
import re

import numpy as np

from skelsplat import viz
from skelsplat.viz import report

JOINTS = ("hip", "left_knee", "right_knee")
SKELETON = viz.Skeleton(limbs=((0, 1), (0, 2)), left_right=((1, 2),))
NASTY = "</script><b onclick=x>\"'&\u2028é"


def data_of(text):
    """Read the data of a page."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])


def text_of(write, folder, data):
    """Write a page into an empty folder, which then has nothing else, and return its text."""
    path = write(folder / "report.html", data)
    assert [entry.name for entry in folder.iterdir()] == ["report.html"]
    return path.read_text(encoding="utf-8")


def numbers(text, kind="<i2"):
    """Read an array of the data."""
    return np.frombuffer(base64.b64decode(text), kind)


def sequence(frames=40, joints=3, **changes):
    """Build a person who walks 3 m along x; error bars of 20 mm; the first frame has the number 100."""
    along = np.linspace(0.0, 3000.0, frames)[:, None, None] * [1.0, 0.0, 0.0]
    body = np.array([[0.0, 0.0, 900.0], [0.0, 150.0, 450.0], [0.0, -150.0, 450.0]])
    pose = along + np.resize(body, (joints, 3))
    names = (*JOINTS, *(f"j{j}" for j in range(3, joints)))[:joints]
    content = {
        "start": pose + 40.0,
        "refined": pose,
        "error_bar": np.broadcast_to(400.0 * np.eye(3), (frames, joints, 3, 3)),
        "status": np.full((frames, joints), "ok"),
        "frames": np.arange(100, 100 + frames),
        "frame_rate": 50.0,
        "joint_names": names,
        "skeleton": SKELETON,
        "up": np.array([0.0, 0.0, 1.0]),
        "start_name": "plain triangulation",
    }
    return report.Sequence3D(**{**content, **changes})


def shapes(names):
    """Stand cameras along y = −4 m that look along +y."""
    count = len(names)
    centres = np.stack([np.linspace(0, 3000, count), np.full(count, -4000.0), np.full(count, 1500.0)], axis=1)
    rays = np.array([[-0.5, 1.0, 0.3], [0.5, 1.0, 0.3], [0.5, 1.0, -0.3], [-0.5, 1.0, -0.3]])
    return report.CameraShapes(names, centres, np.broadcast_to(rays, (count, 4, 3)))


def heat(rows, columns, value=2.0):
    """Build a heat map whose cells are all the same."""
    cells = np.full((len(rows), len(columns)), value)
    kinds = [
        report.Heat("error", "px", "%{z:.1f} px", cells),
        report.Heat("rejected", "%", "%{z:.0f}%", cells, 100.0),
    ]
    return report.HeatMap("Cameras and joints", rows, columns, kinds)


def report_data(walk=None, names=("door", "window"), **changes):
    """Build a whole report of a sequence."""
    walk = sequence() if walk is None else walk
    frames = len(walk.frames)
    table = report.Table(
        "Cameras",
        columns=[("name", ""), ("error", "median & so on")],
        rows=[[name, "2.0"] for name in names],
        total=["all", "2.0"],
    )
    curve = np.linspace(1.0, 2.0, frames)
    number = int(walk.frames[frames // 2])
    content = {
        "title": "SkelSplat: walk",
        "facts": [("calibration", "rig.toml")],
        "warnings": [("door disagrees with the other cameras.", ['without = "door"'])],
        "notes": ["Simulated."],
        "numbers": [("error", "2.0 px", "before → refined")],
        "sequence": walk,
        "shapes": shapes(names),
        "tables": [table],
        "heat": heat(names, walk.joint_names),
        "lines": [
            report.TimeLines("Error", "px", [("before", "start", curve + 1.0), ("", "left", curve)]),
            report.TimeLines("Rejected", "", [("", "left", curve)], peaks=True),
        ],
        "problems": [(number, number, "weak: left_knee")],
    }
    return report.ReportData(**{**content, **changes})
