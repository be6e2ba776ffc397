"""Cameras set right: what `skelsplat.adjust_cameras` leaves of a fault, and what it does to sound cameras.

    python benchmarks/rig.py [--views 3 --views 4] [--faults "turn 1"] [--takes 20]
    python benchmarks/rig.py --people 3                  judged by one person, and by everybody
    python benchmarks/rig.py --sample                    clocks in the recording of the demo
    python benchmarks/rig.py --real FOLDER               20 s of Human3.6M, of tools/h36m_hourglass.py

Simulated: CMU motions of ten seconds at 30 Hz (without the data: the package's synthetic motions), detections
with memory (`recordings.noise`), and one camera, in half of the takes two of five or more, that was turned or
moved in a random direction, zoomed, or is late; or one that was turned and another that is late; or all count
frames differently, by up to so many either way. `focal=True` and `clock=True` are given for these faults
alone. docs/measurements.md has units and outcomes; refused: another fault is reported.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import lab
import numpy as np
import recordings
from lab import ONE_THREAD, Table
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.association import choose_person
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.findings import Finding
from skelsplat.io import sample as demo
from skelsplat.rig_check import ReadAs
from skelsplat.run.by_everybody import Scene, adjusted
from skelsplat.run.cameras import adjust_cameras as adjust_files
from skelsplat.synthetic.rigs import mixed_heights

FPS, FRAMES, LONGEST = 30.0, 300, 40
# Takes below this one were looked at when the thresholds of the method were chosen.
FIRST = 1000
FAULTS = (
    *("sound", "turn 0.2", "turn 1", "move 20", "move 100", "focal 0.02", "clock 0.3", "clocks 10"),
    "turn 3, another late 3",
)
REAL_FAULTS = ("sound", "turn 0.5", "turn 1", "turn 3", "move 100")
BY_PEOPLE = ("sound", "turn 1", "turn 10", "move 100")
OUTCOMES = ("set right", "beyond", "doubt", "within", "missed", "refused", "wrong")
# What rounding leaves: degrees, mm, share, frames.
NOTHING = np.array([1e-4, 1e-3, 1e-9, 1e-9])
Verdict = tuple[str, float, float]
"""What became of a case, what is left of its fault, and the error bar; NaN if it is not set right."""


@dataclass(frozen=True)
class Case:
    """A rig with faults, and the recording that should reveal them."""

    true: list[sk.Camera]
    given: list[sk.Camera]
    late: FloatArray
    faulty: set[int]
    detections: FloatArray


def spoilt(camera: sk.Camera, kind: str, size: float, rng: np.random.Generator) -> sk.Camera:
    """Return a camera as its calibration wrongly says."""
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    R, centre = np.asarray(camera.R), np.asarray(camera.centre)
    if kind == "focal":
        return altered(camera, K=np.asarray(camera.K) * [[1 + size, 1, 1], [1, 1 + size, 1], [1, 1, 1]])
    if kind == "turn":
        R = matrix_from_vector(np.radians(size) * direction) @ R
    elif kind == "move":
        centre = centre + size * direction
    return altered(camera, R=R, t=-R @ centre)


def case(views: int, kind: str, size: float, seed: int, another: float = 0.0) -> Case:
    """Draw a motion, the faults and the detections; `another` camera may be late by so many frames."""
    rng = np.random.default_rng(seed)
    motions = recordings.motions()
    longest = sorted(motions, key=lambda name: -len(motions[name]))[:LONGEST]
    motion = motions[longest[rng.integers(len(longest))]]
    start = rng.integers(max(1, len(motion) - FRAMES))
    poses = motion[start : start + FRAMES]
    poses = poses - np.append(np.nanmean(poses[..., :2], axis=(0, 1)), 0.0)
    true = list(synthetic.human36m_like() if views == 4 else synthetic.ring(views, radius_mm=4500.0))
    number = 0 if kind == "sound" else 2 if views >= 5 and rng.random() < 0.5 else 1
    faulty = {int(i) for i in rng.permutation(views)[:number]}
    late = np.array(
        [size * rng.choice([-1, 1]) if kind == "clock" and i in faulty else 0.0 for i in range(views)]
    )
    given = [spoilt(c, kind, size, rng) if i in faulty else c for i, c in enumerate(true)]
    if kind == "clocks":
        late, faulty = rng.integers(-size, size, views, endpoint=True).astype(float), set(range(views))
    if another:
        i = int(rng.choice(sorted(set(range(views)) - faulty)))
        late[i] = another * rng.choice([-1, 1])
        faulty.add(i)
    noise = recordings.noise("good", views, FPS)
    if late.any():  # each camera sees the motion at its own time
        seen = [
            synthetic.simulate_detections(at(poses, -late[i]), [true[i]], noise=noise, seed=1000 * seed + i)
            for i in range(views)
        ]
        return Case(true, given, late, faulty, np.concatenate(seen, axis=1))
    detections = synthetic.simulate_detections(poses, true, noise=noise, seed=seed)
    return Case(true, given, late, faulty, detections)


def at(poses: FloatArray, shift: float, pace: float = 1.0) -> FloatArray:
    """Return the motion `shift` frames later, `pace` frames a step, between two frames along a line."""
    when = np.clip(np.arange(0, len(poses), pace) + shift, 0, len(poses) - 1)
    k = np.floor(when).astype(int).clip(max=len(poses) - 2)
    part = (when - k)[:, None, None]
    return poses[k] * (1 - part) + poses[k + 1] * part


def errors(true: sk.Camera, camera: sk.Camera, late: float) -> FloatArray:
    """Return what is wrong with a camera: degrees, mm, share of the focal length, frames."""
    turn = np.asarray(camera.R) @ np.asarray(true.R).T
    degrees = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    mm = np.linalg.norm(np.asarray(camera.centre) - np.asarray(true.centre))
    focal = abs(np.asarray(camera.K)[0, 0] / np.asarray(true.K)[0, 0] - 1)
    return np.array([degrees, mm, focal, abs(late)])


def error_bars(one: sk.CameraAdjustment) -> FloatArray:
    """Return the error bars in the order of `errors`; 0 for what was not looked at."""
    return np.nan_to_num([one.turn_sigma, one.shift_sigma, one.focal_sigma, one.clock_sigma], nan=0.0)


def verdict(one: Case, found: sk.RigAdjustment | Finding) -> Verdict:
    """Return what became of a case."""
    if isinstance(found, Finding):
        return "refused", np.nan, np.nan
    changed = {i for i, camera in enumerate(found.report) if camera.status in ("adjusted", "late")}
    unsure = {i for i, camera in enumerate(found.report) if camera.status != "sound"} - changed
    if len(one.faulty) == len(one.true):
        return verdict_of_clocks(one, found)
    left = one.faulty - changed
    if changed - one.faulty or (left and unsure and not unsure & one.faulty):
        return "wrong", np.nan, np.nan
    if unsure:
        return "doubt", np.nan, np.nan
    if left:
        bars = {i: 2 * error_bars(found.report[i]) + NOTHING for i in left}
        near = all((errors(one.true[i], one.given[i], one.late[i]) <= bars[i]).all() for i in left)
        return "within" if near else "missed", np.nan, np.nan
    each = [left_of(one, found, i) for i in one.faulty] or [("set right", np.nan, np.nan)]
    worst = "beyond" if "beyond" in {name for name, *_ in each} else "set right"
    return worst, max(left for _, left, _ in each), max(bar for *_, bar in each)


def left_of(one: Case, found: sk.RigAdjustment, i: int) -> Verdict:
    """Return what became of a faulty camera that is adjusted."""
    before = errors(one.true[i], one.given[i], one.late[i])
    after = errors(one.true[i], found.cameras[i], one.late[i] - found.report[i].clock)
    bars = error_bars(found.report[i])
    beyond = (after > np.maximum(before / 10, 2 * bars) + NOTHING).any()
    part = int(np.argmax(before > NOTHING))
    return "beyond" if beyond else "set right", float(after[part]), float(bars[part])


def verdict_of_clocks(one: Case, found: sk.RigAdjustment) -> Verdict:
    """Return what became of clocks of which none need be right: what they share does not count."""
    off = one.late - [camera.clock for camera in found.report]
    left = float(np.abs(off - np.median(off)).max())
    bar = float(np.nanmax([camera.clock_sigma for camera in found.report], initial=0.0))
    if found.of("adjusted") or found.of("doubtful"):
        return "wrong" if found.of("adjusted") else "doubt", np.nan, np.nan
    return "set right" if left <= max(float(np.ptp(one.late)) / 10, 2 * bar) else "beyond", left, bar


def summary(verdicts: list[Verdict]) -> dict[str, Any]:
    """Return the shares of the outcomes, and the medians of what is left and of its error bar."""
    counts = Counter(name for name, *_ in verdicts)
    row: dict[str, Any] = {f"{name} %": f"{100 * counts[name] / len(verdicts):.3g}" for name in OUTCOMES}
    for k, head in ((1, "left"), (2, "error bar")):
        values = np.array([one[k] for one in verdicts])
        row[head] = f"{np.nanmedian(values):.3g}" if np.isfinite(values).any() else "–"
    return row


def real_case(path: Path, kind: str, size: float, seed: int) -> Case:
    """Return a real take with a fault in one of its cameras."""
    from calibrate import filmed

    one, rng = filmed(path, "known"), np.random.default_rng(seed)
    faulty = {int(rng.integers(len(one.true)))} if kind != "sound" else set()
    given = [spoilt(c, kind, size, rng) if i in faulty else c for i, c in enumerate(one.true)]
    return Case(one.true, given, one.late, faulty, one.detections)


def measured_in_real(name: str, paths: list[Path]) -> dict[str, Any]:
    """Measure one fault in real takes."""
    kind, _, size = name.partition(" ")
    cases = (real_case(path, kind, float(size or 0), seed) for seed, path in enumerate(paths))
    given = {"focal": kind == "focal", "config": ONE_THREAD}
    return summary([verdict(one, sk.adjust_cameras(one.detections, one.given, **given)) for one in cases])


def measured(name: str, views: int, takes: int) -> dict[str, Any]:
    """Measure one fault in one rig."""
    fault, _, another = name.partition(", another late ")
    kind, _, size = fault.partition(" ")
    given = {"focal": kind == "focal", "clock": "clock" in name, "config": ONE_THREAD}
    verdicts = []
    for seed in range(FIRST, FIRST + takes):
        one = case(views, kind, float(size or 0), seed, float(another or 0))
        verdicts.append(verdict(one, sk.adjust_cameras(one.detections, one.given, **given)))
    return summary(verdicts)


def measured_by_people(name: str, views: int, takes: int, people: int) -> dict[str, dict[str, Any]]:
    """Measure one fault, by one person and by everybody, of people who cross, circle and pass each other."""
    kind, _, size = name.partition(" ")
    found: dict[str, list[Verdict]] = {"one": [], "all": []}
    for seed in range(FIRST, FIRST + takes):
        rng, meetings = np.random.default_rng(seed), ["cross", "circle", "apart"]
        scene = synthetic.simulate_scene(
            people, mixed_heights(views), n_frames=200, fps=FPS, meetings=meetings, seed=seed
        )
        faulty = set() if kind == "sound" else {int(rng.integers(views))}
        true, seen, late = list(scene.cameras), scene.people, np.zeros(views)
        given = [spoilt(one, kind, float(size), rng) if i in faulty else one for i, one in enumerate(true)]
        rig = sk.CameraRig(given, scene.cameras.unit)
        one = choose_person(seen, rig, layout=scene.layout)[0][:, :, None]
        for who, detections in (("one", one), ("all", seen)):
            read = Scene(rig, detections, np.arange(len(seen)), scene.layout, ReadAs())
            found[who].append(verdict(Case(true, given, late, faulty, detections), adjusted(read)))
    return {f"{name}, by {who}": summary(verdicts) for who, verdicts in found.items()}


def clocks_of_the_demo() -> Table:
    """Return what is found where cameras of the demo's recording are read late; its cam_03 is turned."""
    names, rng = ("cam_01", "cam_02", "cam_03", "cam_04"), np.random.default_rng(FIRST)
    cases = {
        f"one by {late}": [{name: frames} for name, frames in product(names, (late, -late))]
        for late in (1, 2, 3, 5, 8, 15)
    }
    drawn = rng.integers(-10, 10, (8, len(names)), endpoint=True)
    cases["all by up to 10"] = [dict(zip(names, map(int, one), strict=True)) for one in drawn]
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        paths = demo.extract(Path(folder))
        given = {"read": {"unit": demo.UNIT}, "layout": demo.LAYOUT}
        for name, several in cases.items():
            counts = Counter[str]()
            for offsets in several:
                found = adjust_files(paths.calibration, paths.detections, offsets=offsets, **given).adjustment
                off = np.array([one.clock - offsets.get(one.name, 0) for one in found.report])
                off -= np.median(off)  # clocks are known up to one that all share
                right = [one.name for one in found.of("adjusted")] == ["cam_03"] and not off.round().any()
                counts["right" if right else "doubt" if found.of("doubtful") else "wrong"] += 1
            rows[name] = {key: counts[key] for key in ("right", "doubt", "wrong")}
    title = "four cameras, of which cam_03 is turned: real detections, eight cases each"
    return Table.of(title, "cameras read early or late", rows)


def rig(
    *,
    views: tuple[int, ...] = (3, 4, 5, 8),
    faults: tuple[str, ...] = (),
    takes: int = 20,
    people: int = 0,
    sample: bool = False,
    real: Path | None = None,
    subjects: tuple[str, ...] = ("S1", "S5", "S6", "S7", "S8"),
) -> Iterator[Table]:
    """Measure faults in rigs, or what the last names say."""
    if sample:
        yield clocks_of_the_demo()
    elif real is not None:
        every = sorted(path for path in real.glob("*.npz") if path.stem.split("_")[0] in subjects)
        paths = every[:: max(1, len(every) // takes)]
        rows = {fault: measured_in_real(fault, paths) for fault in faults or REAL_FAULTS}
        yield Table.of(f"{len(paths)} real takes, Human3.6M, {', '.join(subjects)}", "fault", rows)
    elif people:
        found = [measured_by_people(fault, 4, takes, people) for fault in faults or BY_PEOPLE]
        rows = {name: row for each in found for name, row in each.items()}
        yield Table.of(f"{people} people, 4 views, {takes} takes, simulated", "fault", rows)
    else:
        for n_views in views:
            rows = {fault: measured(fault, n_views, takes) for fault in faults or FAULTS}
            yield Table.of(f"{n_views} views, {takes} takes, simulated", "fault", rows)


if __name__ == "__main__":
    lab.main(__doc__, rig)
