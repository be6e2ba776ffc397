"""Made-up people as arrays, for the tests of their picture, their page and their overlay."""

from __future__ import annotations

import numpy as np

from report_page import shapes
from skelsplat import viz
from skelsplat.run.html import everybody, lines_of_people
from skelsplat.viz import report
from skelsplat.viz.people import all_frames, spread_out, with_gaps

SKELETON = viz.Skeleton(limbs=((0, 1), (0, 2)), left_right=((1, 2),))
BODY = np.array([[0.0, 0.0, 900.0], [0.0, 150.0, 450.0], [0.0, -150.0, 450.0]])
CAMERAS = ("door", "window")


def person(name="person 0", frames=range(100, 140), at=(0.0, 0.0), **changes):
    """Build a person of three joints who walks 1 m along y, seen by both cameras."""
    frames = np.asarray(frames)
    count = len(frames)
    way = np.linspace(0.0, 1000.0, count)[:, None, None] * [0.0, 1.0, 0.0]
    pose = BODY + way + [*at, 0.0]
    content = {
        "name": name,
        "frames": frames,
        "start": pose + 40.0,
        "refined": pose,
        "error_bar": np.broadcast_to(400.0 * np.eye(3), (count, 3, 3, 3)),
        "status": np.full((count, 3), "ok"),
        "seen": np.ones((count, len(CAMERAS)), dtype=bool),
        "error_px": np.full(count, 2.0),
        "rejected": np.full(count, 0.1),
    }
    return viz.PersonTrack(**{**content, **changes})


def crowd(count=3):
    """Build people 800 mm apart along x; the second comes late, the third leaves early."""
    spans = [range(100, 140), range(110, 140), range(100, 120)]
    return [person(f"person {k}", spans[k % 3], (800.0 * k, 0.0)) for k in range(count)]


def people_report(people=None, names=CAMERAS, joints=("hip", "left_knee", "right_knee"), **changes):
    """Build the page of several people."""
    people = crowd() if people is None else people
    rows = [[one.name, "2.0"] for one in people]
    marks = [(report.person_class(place), f"person_{place}/report.html") for place in range(len(people))]
    frames = with_gaps(all_frames(people))
    given = {"frame_rate": 50.0, "start_name": "frame by frame", "up": np.array([0.0, 0.0, 1.0])}
    content = {
        "title": "SkelSplat: three people",
        "facts": [("calibration", "rig.toml")],
        "warnings": [("door disagrees with the other cameras.", ['without = "door"'])],
        "notes": ["Simulated."],
        "numbers": [("people", str(len(people)), "two views agree on them")],
        "problems": [(110, 112, "person 1: weak left_knee")],
        "sequence": everybody(people, frames, joint_names=joints, skeleton=SKELETON, **given),
        "shapes": shapes(names),
        "tables": [report.Table("People", [("person", ""), ("error [px]", "median")], rows, marks=marks)],
        "lines": lines_of_people(people, frames),
        "findings": [[("The left leg varies.", [])] if place == 1 else [] for place in range(len(people))],
        "views": [spread_out(frames, one.frames, one.views, -1) for one in people],
    }
    return report.ReportData(**{**content, **changes})
