"""Cameras set right: what `skelsplat.adjust_cameras` leaves of a fault, and what it does to sound cameras.

    python benchmarks/rig.py [--views 3 4] [--faults "turn 1" sound] [--takes 20] [--condition good]
    python benchmarks/rig.py --lost                      what a clock costs that is off by parts of a frame
    python benchmarks/rig.py --sample                    clocks in the recording of the demo
    python benchmarks/rig.py --speed                     how long 1,000 frames of four cameras take

Simulated: CMU motions of ten seconds at 30 Hz (without the data: the package's synthetic motions), detections
with memory (`recordings.noise`), and one camera, in half of the takes two of five or more, that was turned or
moved in a random direction, zoomed, or is late; or one that was turned and another that is late; or all count
frames differently, by up to so many either way. Nothing tells the method which. Faults are in degrees, mm,
shares of the focal length, and frames; `focal=True` and `clock=True` are given for these faults alone.

set right: takes in which every faulty camera is adjusted (or late) and no other, and at most a tenth of the
fault or twice the error bar is left, of the fault and of what it might be confused with. beyond: more is.
doubt: a faulty camera is said to be doubtful, or the faulty ones are set right and a sound one is doubtful.
within: nothing is found, and the fault is at most twice the error bar that is stated. missed: it is more.
wrong: a sound camera was changed. left, error bar: medians of what is left of the fault, and of its error
bar. CPU s: one core.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import _one_core  # noqa: F401  before numpy
import common
import numpy as np
import recordings
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.io import sample
from skelsplat.run.adjust import adjust_cameras as adjust_files

FPS, FRAMES, LONGEST = 30.0, 300, 40
# Takes below this one were looked at when the thresholds of the method were chosen.
FIRST = 1000
CONFIG = sk.RefineConfig(n_threads=1)
FAULTS = (
    "sound",
    "sound, clocks",
    "turn 0.2",
    "turn 1",
    "turn 3",
    "turn 10",
    "move 5",
    "move 20",
    "move 100",
    "move 500",
    "focal 0.02",
    "clock 0.3",
    "clock 3",
    "clock 20",
    "clocks 10",
    "turn 3, another late 3",
)
# What rounding leaves: degrees, mm, share, frames.
NOTHING = np.array([1e-4, 1e-3, 1e-9, 1e-9])
COLUMNS = [
    "",
    "set right %",
    "beyond %",
    "doubt %",
    "within %",
    "missed %",
    "wrong %",
    "left",
    "error bar",
    "CPU s",
]


@dataclass(frozen=True)
class Case:
    """A rig with faults, and the recording that should reveal them."""

    true: list[sk.Camera]
    given: list[sk.Camera]
    late: FloatArray
    faulty: set[int]
    detections: FloatArray


def rig(views: int) -> list[sk.Camera]:
    """Cameras of a room."""
    return list(synthetic.human36m_like() if views == 4 else synthetic.ring(views, radius_mm=4500.0))


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


def case(views: int, kind: str, size: float, condition: str, seed: int, *, another: float = 0.0) -> Case:
    """Draw a motion, the faults and the detections; `another` camera may be late by so many frames."""
    rng = np.random.default_rng(seed)
    motions = recordings.motions()
    longest = sorted(motions, key=lambda name: -len(motions[name]))[:LONGEST]
    motion = motions[longest[rng.integers(len(longest))]]
    start = rng.integers(max(1, len(motion) - FRAMES))
    poses = motion[start : start + FRAMES]
    poses = poses - np.append(np.nanmean(poses[..., :2], axis=(0, 1)), 0.0)
    true = rig(views)
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
    noise = recordings.noise(condition, views, FPS)
    if late.any():  # each camera sees the motion at its own time
        seen = [
            synthetic.simulate_detections(at(poses, -late[i]), [true[i]], noise=noise, seed=1000 * seed + i)
            for i in range(views)
        ]
        detections = np.concatenate(seen, axis=1)
    else:
        detections = synthetic.simulate_detections(poses, true, noise=noise, seed=seed)
    return Case(true, given, late, faulty, detections)


def at(poses: FloatArray, shift: float) -> FloatArray:
    """Return the motion `shift` frames later, between two frames along a line."""
    when = np.clip(np.arange(len(poses)) + shift, 0, len(poses) - 1)
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


def verdict(one: Case, found: sk.RigAdjustment) -> tuple[str, float, float]:
    """Return what became of a case, what is left of the fault, and its error bar; NaN if not set right."""
    if len(one.faulty) == len(one.true):
        return verdict_of_clocks(one, found)
    changed = {i for i, r in enumerate(found.report) if r.status in ("adjusted", "late")}
    doubtful = {i for i, r in enumerate(found.report) if r.status == "doubtful"}
    if changed - one.faulty:
        return "wrong", np.nan, np.nan
    if doubtful and one.faulty & doubtful:
        return "doubt", np.nan, np.nan
    if one.faulty - changed:
        return ("wrong" if doubtful else "within" if within(one, found) else "missed"), np.nan, np.nan
    if doubtful:
        return "doubt", np.nan, np.nan
    outcome, left, bar = "set right", 0.0, 0.0
    for i in one.faulty:
        before = errors(one.true[i], one.given[i], one.late[i])
        after = errors(one.true[i], found.cameras[i], one.late[i] - found.report[i].clock)
        bars = error_bars(found.report[i])
        if (after > np.maximum(before / 10, 2 * bars) + NOTHING).any():
            outcome = "beyond"
        part = int(np.argmax(before > NOTHING))
        left, bar = max(left, float(after[part])), max(bar, float(bars[part]))
    return outcome, left, bar


def verdict_of_clocks(one: Case, found: sk.RigAdjustment) -> tuple[str, float, float]:
    """Return what became of clocks of which none need be right: what they share does not count."""
    off = one.late - [camera.clock for camera in found.report]
    left = float(np.abs(off - np.median(off)).max())
    bar = float(np.nanmax([camera.clock_sigma for camera in found.report], initial=0.0))
    if found.of("adjusted"):
        return "wrong", np.nan, np.nan
    if found.of("doubtful"):
        return "doubt", np.nan, np.nan
    return "set right" if left <= max(float(np.ptp(one.late)) / 10, 2 * bar) else "beyond", left, bar


def within(one: Case, found: sk.RigAdjustment) -> bool:
    """Return whether the faults that were not found are at most twice the error bars of their cameras."""
    left = [i for i in one.faulty if found.report[i].status == "sound"]
    faults = {i: errors(one.true[i], one.given[i], one.late[i]) for i in left}
    return all((faults[i] <= 2 * error_bars(found.report[i]) + NOTHING).all() for i in left)


def error_bars(one: sk.CameraAdjustment) -> FloatArray:
    """Return the error bars in the order of `errors`; 0 for what was not looked at."""
    return np.nan_to_num([one.turn_sigma, one.shift_sigma, one.focal_sigma, one.clock_sigma], nan=0.0)


def row(name: str, views: int, takes: int, condition: str) -> list[object]:
    """Measure one fault in one rig."""
    fault, _, another = name.partition(", another late ")
    kind, size = ("sound", "0") if name.startswith("sound") else fault.split()
    counts: Counter[str] = Counter()
    left, bars, seconds = [], [], []
    for seed in range(FIRST, FIRST + takes):
        one = case(views, kind, float(size), condition, seed, another=float(another or 0))
        begun = time.process_time()
        found = sk.adjust_cameras(
            one.detections, one.given, focal=kind == "focal", clock="clock" in name, config=CONFIG
        )
        seconds.append(time.process_time() - begun)
        if kind == "sound":
            quiet = all(r.status == "sound" for r in found.report)
            doubt = any(r.status == "doubtful" for r in found.report)
            counts["set right" if quiet else "doubt" if doubt else "wrong"] += 1
            continue
        outcome, rest, bar = verdict(one, found)
        counts[outcome] += 1
        left.append(rest)
        bars.append(bar)
    share = [
        100 * counts[key] / takes for key in ("set right", "beyond", "doubt", "within", "missed", "wrong")
    ]
    middle = [
        float(np.nanmedian(x)) if np.isfinite(x).any() else np.nan for x in (np.array(left), np.array(bars))
    ]
    return [name, *share, *middle, float(np.mean(seconds))]


def lost(takes: int) -> list[list[str]]:
    """Return what half a frame costs: mean error of a walk of 20 s, one camera of four late, mm."""
    rows = []
    for fps, late in ((15, 0.25), (15, 0.5), (30, 0.25), (30, 0.5), (60, 0.5)):
        errors = np.array([lost_in(fps, late, seed) for seed in range(FIRST, FIRST + takes)])
        synchronised, wrong, measured, clock = errors.mean(axis=0)
        cells = [f"{synchronised:.2f}"]
        cells += [f"{error:.2f} (+{100 * (error / synchronised - 1):.1f} %)" for error in (wrong, measured)]
        rows.append([f"{fps}", f"{late}", *cells, f"{clock:.2f} ± {errors[:, 3].std():.2f}"])
    return rows


def lost_in(fps: int, late: float, seed: int) -> tuple[float, float, float, float]:
    """Return the error of a walk: synchronised, with a camera `late`, with the clock measured; and that."""
    fine = synthetic.motion("walk", (20 * fps + 2) * 4, fps=4 * fps, seed=seed)
    cameras, noise = synthetic.ring(4), synthetic.DetectionNoise.recording(fps)
    truth, own = fine[4:-4:4], fine[4 - round(4 * late) :: 4][: 20 * fps]
    sound = synthetic.simulate_detections(truth, cameras, noise=noise, seed=seed)
    seen = sound.copy()
    seen[:, 1] = synthetic.simulate_detections(own, cameras, noise=noise, seed=seed)[:, 1]
    found = sk.adjust_cameras(seen, cameras, clock=True, config=CONFIG)

    def error(detections: FloatArray) -> float:
        pose = sk.refine_sequence(detections, cameras, fps=fps, layout="h36m17", config=CONFIG).pose
        return float(np.nanmean(np.linalg.norm(pose - truth, axis=-1)))

    return error(sound), error(seen), error(found.synchronised(seen)), found.report[1].clock


def clocks_of_the_sample() -> list[list[str]]:
    """Return what is found where cameras of the demo's recording are read late; its cam_03 is turned."""
    names, rng = ("cam_01", "cam_02", "cam_03", "cam_04"), np.random.default_rng(FIRST)
    cases = {
        f"one by {late}": [{name: frames} for name, frames in product(names, (late, -late))]
        for late in (1, 2, 3, 5, 8, 15)
    }
    drawn = rng.integers(-10, 10, (8, len(names)), endpoint=True)
    cases["all by up to 10"] = [dict(zip(names, map(int, one), strict=True)) for one in drawn]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        paths = sample.extract(Path(folder))
        for name, several in cases.items():
            counts, most = Counter[str](), 0.0
            for offsets in several:
                found = adjust_files(
                    paths.calibration,
                    paths.detections,
                    read={"unit": sample.UNIT},
                    layout=sample.LAYOUT,
                    offsets=offsets,
                ).adjustment
                off = np.array([one.clock - offsets.get(one.name, 0) for one in found.report])
                off -= np.median(off)  # clocks are known up to one that all share
                right = [one.name for one in found.of("adjusted")] == ["cam_03"] and not off.round().any()
                counts["right" if right else "doubt" if found.of("doubtful") else "wrong"] += 1
                most = max(most, float(np.abs(off).max()) if right else 0.0)
            rows.append([name, *(f"{counts[key]}" for key in ("right", "doubt", "wrong")), f"{most:.2f}"])
    return rows


def speed() -> list[list[str]]:
    """Return how long a walk of 1,000 frames takes, four cameras, of which one is turned and late."""
    cameras = synthetic.ring(4)
    noise = synthetic.DetectionNoise.recording(int(FPS))
    pose = synthetic.motion("walk", 1000, fps=FPS, seed=FIRST)
    seen = synthetic.simulate_detections(pose, cameras, noise=noise, seed=FIRST)
    seen[3:, 2] = seen[:-3, 2].copy()
    turn = matrix_from_vector(np.radians([0.0, 2.0, 0.0]))
    turned = [
        altered(one, R=turn @ one.R, t=turn @ one.t) if k == 1 else one for k, one in enumerate(cameras)
    ]
    rows = []
    for what in ({}, {"clock": True}, {"focal": True, "clock": True}):
        begun, cpu = time.perf_counter(), time.process_time()
        sk.adjust_cameras(seen, sk.CameraRig(turned, unit=cameras.unit), config=CONFIG, **what)
        now = (time.perf_counter() - begun, time.process_time() - cpu)
        rows.append([", ".join(("turn", "movement", *what)), *(f"{one:.2f}" for one in now)])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--views", type=int, nargs="+", default=[3, 4, 5, 8])
    parser.add_argument("--faults", nargs="+", default=list(FAULTS))
    parser.add_argument("--takes", type=int, default=20)
    parser.add_argument("--condition", choices=recordings.CONDITIONS, default="good")
    parser.add_argument("--lost", action="store_true")
    parser.add_argument("--sample", action="store_true")
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true")
    given = parser.parse_args()
    if given.speed:
        title = "1,000 frames, four cameras, one thread"
        common.show(title, ["adjusted", "s", "CPU s"], speed(), markdown=given.markdown)
        print(common.circumstances())
        return
    if given.sample:
        columns = ["cameras read early or late", "right", "doubt", "wrong", "off by at most"]
        title = "four cameras, of which cam_03 is turned: real detections, eight cases each"
        common.show(title, columns, clocks_of_the_sample(), markdown=given.markdown)
        print(common.circumstances())
        return
    if given.lost:
        columns = [
            "frames per s",
            "late, frames",
            "synchronised, mm",
            "as recorded, mm",
            "set right, mm",
            "clock",
        ]
        title = f"walk of 20 s, one of four cameras late, {given.takes} takes, simulated"
        common.show(title, columns, lost(given.takes), markdown=given.markdown)
        print(common.circumstances())
        return
    report: dict[str, list[list[object]]] = {}
    for views in given.views:
        report[str(views)] = [row(fault, views, given.takes, given.condition) for fault in given.faults]
        if not given.json:
            title = f"{views} views, {given.takes} takes, {given.condition}, simulated"
            rows = [[str(one[0]), *(f"{value:.3g}" for value in one[1:])] for one in report[str(views)]]
            common.show(title, COLUMNS, rows, markdown=given.markdown)
    if given.json:
        print(
            json.dumps(
                {"circumstances": common.circumstances(), "columns": COLUMNS, "views": report}, indent=2
            )
        )
        return
    print(common.circumstances())


if __name__ == "__main__":
    main()
