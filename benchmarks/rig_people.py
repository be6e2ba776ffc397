"""Cameras set right by everybody in a recording, compared with one person: what is left of a fault.

    python benchmarks/rig_people.py [--people 3] [--views 4] [--takes 20]

Simulated: people who cross, circle and pass each other for 200 frames at 30 Hz (`simulate_scene`), in a room
with cameras at several heights, one of them turned or moved in a random direction, or late. Nothing tells the
method who is who, nor which camera. `one` is ``--person consistent`` of `skelsplat adjust-cameras`, `all` its
default.

set right: the faulty camera alone is adjusted (or late), and at most a tenth of the fault or twice the error
bar is left. beyond: more is. doubt: it is doubtful, or not judged. within: nothing is found, and the fault is
at most twice the error bar. missed: it is more. refused: another fault is reported. wrong: a sound camera was
changed. left, error bar: medians, degrees, mm or frames.
"""

from __future__ import annotations

from typing import Any

import lab
import numpy as np
from lab import Table
from rig import Case, Verdict, left_of, spoilt, summary, within

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.association import choose_person
from skelsplat.findings import Finding
from skelsplat.rig_check import ReadAs
from skelsplat.run.adjust import adjusted
from skelsplat.run.by_everybody import Scene
from skelsplat.synthetic.people_sets import mixed_heights

FAULTS = ("sound", "turn 0.5", "turn 1", "turn 3", "turn 10", "move 20", "move 100", "move 500", "clock 3")
OUTCOMES = ("set right", "beyond", "doubt", "within", "missed", "refused", "wrong")
FRAMES, FPS, FIRST = 200, 30.0, 1000


def verdict(one: Case, unit: str, layout: sk.Layout) -> Verdict:
    """Return what became of a rig."""
    people = one.detections
    rig = sk.CameraRig(one.given, unit)
    found = adjusted(Scene(rig, people, np.arange(len(people)), layout, ReadAs()))
    if isinstance(found, Finding):
        return "refused", np.nan, np.nan
    changed = {i for i, camera in enumerate(found.report) if camera.status in ("adjusted", "late")}
    outcome = None
    if changed - one.faulty:
        outcome = "wrong"
    elif not one.faulty:
        quiet = all(camera.status == "sound" for camera in found.report)
        outcome = "set right" if quiet else "doubt"
    elif not changed:
        (faulty,) = one.faulty
        quiet = "within" if within(one, found) else "missed"
        outcome = quiet if found.report[faulty].status == "sound" else "doubt"
    elif found.of("doubtful"):
        outcome = "doubt"
    if outcome is not None:
        return outcome, np.nan, np.nan
    (faulty,) = one.faulty
    return left_of(one, found, faulty)


def measured(fault: str, people: int, views: int, takes: int) -> dict[str, dict[str, Any]]:
    """Measure one fault, by one person and by everybody."""
    kind, size = ("sound", 0.0) if fault == "sound" else (fault.split()[0], float(fault.split()[1]))
    found: dict[str, list[Verdict]] = {"one": [], "all": []}
    for seed in range(FIRST, FIRST + takes):
        rng = np.random.default_rng(seed)
        meetings = ["cross", "circle", "apart"]
        scene = synthetic.simulate_scene(
            people, mixed_heights(views), n_frames=FRAMES, fps=FPS, meetings=meetings, seed=seed
        )
        faulty = -1 if kind == "sound" else int(rng.integers(views))
        true, seen = list(scene.cameras), scene.people.copy()
        given = [
            spoilt(one, kind, size, rng) if i == faulty and kind in ("turn", "move") else one
            for i, one in enumerate(true)
        ]
        late = np.zeros(views)
        if kind == "clock":
            seen[int(size) :, faulty] = scene.people[: -int(size), faulty]
            late[faulty] = size
        unit, faults = scene.cameras.unit, {faulty} - {-1}
        one = choose_person(seen, sk.CameraRig(given, unit), layout=scene.layout)[0][:, :, None]
        for name, who in (("one", one), ("all", seen)):
            found[name].append(verdict(Case(true, given, late, faults, who), unit, scene.layout))
    return {f"{fault}, by {name}": summary(verdicts, OUTCOMES) for name, verdicts in found.items()}


def rig_people(
    *, people: int = 3, views: int = 4, faults: tuple[str, ...] = FAULTS, takes: int = 20
) -> Table:
    """Measure faults."""
    rows = {k: row for fault in faults for k, row in measured(fault, people, views, takes).items()}
    return Table.of(f"{people} people, {views} views, {takes} takes, simulated", "fault", rows)


if __name__ == "__main__":
    lab.main(__doc__, rig_people)
