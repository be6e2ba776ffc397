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

import argparse
from collections import Counter

import _one_core  # noqa: F401  before numpy
import common
import numpy as np
from rig import NOTHING, Case, error_bars, errors, spoilt, within
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.association import choose_person
from skelsplat.findings import Finding
from skelsplat.rig_check import ReadAs
from skelsplat.run.adjust import Scene, adjusted
from skelsplat.synthetic.people_sets import mixed_heights

FAULTS = ("sound", "turn 0.5", "turn 1", "turn 3", "turn 10", "move 20", "move 100", "move 500", "clock 3")
OUTCOMES = ("set right", "beyond", "doubt", "within", "missed", "refused", "wrong")
COLUMNS = ["", "by", *(f"{one} %" for one in OUTCOMES), "left", "error bar"]
FRAMES, FPS, FIRST = 200, 30.0, 1000


def outcome(
    given: sk.CameraRig, people: FloatArray, layout: sk.Layout, true: sk.CameraRig, faulty: int, late: float
) -> tuple[str, float, float]:
    """Return what became of a rig, what is left of its fault, and the error bar; NaN if not set right."""
    found = adjusted(Scene(given, people, np.arange(len(people)), layout, ReadAs()))
    if isinstance(found, Finding):
        return "refused", np.nan, np.nan
    changed = {i for i, one in enumerate(found.report) if one.status in ("adjusted", "late")}
    if changed - {faulty}:
        return "wrong", np.nan, np.nan
    if faulty < 0:
        quiet = all(one.status == "sound" for one in found.report)
        return "set right" if quiet else "doubt", np.nan, np.nan
    if not changed:
        clocks = np.where(np.arange(len(true)) == faulty, late, 0.0)
        case = Case(list(true), list(given), clocks, {faulty}, people)
        quiet = "within" if within(case, found) else "missed"
        return quiet if found.report[faulty].status == "sound" else "doubt", np.nan, np.nan
    if found.of("doubtful"):
        return "doubt", np.nan, np.nan
    report = found.report[faulty]
    before = errors(true[faulty], given[faulty], late)
    after, bars = errors(true[faulty], found.cameras[faulty], late - report.clock), error_bars(report)
    part = int(np.argmax(before > NOTHING))
    beyond = (after > np.maximum(before / 10, 2 * bars) + NOTHING).any()
    return "beyond" if beyond else "set right", float(after[part]), float(bars[part])


def rows(fault: str, people: int, views: int, takes: int) -> list[list[str]]:
    """Measure one fault, by one person and by everybody."""
    kind, size = ("sound", 0.0) if fault == "sound" else (fault.split()[0], float(fault.split()[1]))
    found: dict[str, list[tuple[str, float, float]]] = {"one": [], "all": []}
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
        if kind == "clock":
            seen[int(size) :, faulty] = scene.people[: -int(size), faulty]
        late = size if kind == "clock" else 0.0
        cameras = sk.CameraRig(given, scene.cameras.unit)
        one = choose_person(seen, cameras, layout=scene.layout)[0][:, :, None]
        for name, who in (("one", one), ("all", seen)):
            found[name].append(outcome(cameras, who, scene.layout, scene.cameras, faulty, late))
    out = []
    for name, all_of in found.items():
        counts = Counter(one[0] for one in all_of)
        middle = [np.array([one[k] for one in all_of]) for k in (1, 2)]
        cells = [f"{np.nanmedian(x):.2g}" if np.isfinite(x).any() else "–" for x in middle]
        out.append([fault, name, *(f"{100 * counts[key] / takes:.0f}" for key in OUTCOMES), *cells])
    return out


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--people", type=int, default=3)
    parser.add_argument("--views", type=int, default=4)
    parser.add_argument("--faults", nargs="+", default=list(FAULTS))
    parser.add_argument("--takes", type=int, default=20)
    parser.add_argument("--markdown", action="store_true")
    given = parser.parse_args()
    table = [row for fault in given.faults for row in rows(fault, given.people, given.views, given.takes)]
    title = f"{given.people} people, {given.views} views, {given.takes} takes, simulated"
    common.show(title, COLUMNS, table, markdown=given.markdown)
    print(common.circumstances())


if __name__ == "__main__":
    main()
