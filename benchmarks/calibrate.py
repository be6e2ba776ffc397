"""No calibration: what `skelsplat.calibrate_cameras` finds from people's detections.

    python benchmarks/calibrate.py [--views 4] [--cases known --cases "known, useless"] [--takes 20]
    python benchmarks/calibrate.py --real FOLDER [--subjects S1]      Human3.6M, of tools/h36m_hourglass.py
    python benchmarks/calibrate.py --cases known --peers OpenCV --peers Aniposelib      others, known lenses
    python benchmarks/calibrate.py --frames 500 --frames 4000      memory and time

Simulated: ten seconds (with clocks: twenty, started up to ten apart) at 30 Hz of CMU takes of one subject,
each begun where the one before ended (without the data: the package's synthetic motions), and detections with
memory (`recordings.noise`). A case says what is known: `known` or unknown focal lengths, `focal`, or `same`
of all; lenses `wide`, of 60 to 110°, or of `phones`, instead of the room's 47°; `occluded 2`, `occluded 3`;
`clocks`; `rates`: cameras of 30, 60, 25 and 50 Hz; `useless`: one camera sees another take; `knocked`: one is
turned by 3° between 0.3 and 0.7 of the time, and right as in the longer part; named: it is, or any other.
*moves*: the person covers a metre along an axis.

Several people: a case with `2 people` or `3 people`, `simulate_scene` in a ring of cameras at one height, and
with `bystander` one whom two cameras see. oracle: the same with the true association, which is not given
otherwise; as good: every camera within 1.5 times its errors, or within 0.1° and 10 mm of them.

Found and true rigs are aligned by a similarity of turns and places. right: all cameras within 1°, 60 mm and
half a frame, none left out wrongly; refused: not `sure`; wrong, world: a camera, or scale or up, beyond three
error bars though not refused; useless, left out: this camera, and another. Per cent of the takes; 3 σ: of the
cameras. Others are medians: of the worst camera, its error bar, scale and up, and seconds of one core. The
similarity takes up the distance of two cameras, so that their mm say little.

Real: 20 s at 25 Hz. given, found: mm, joints of arms and legs over time, every take aligned by a similarity;
stature: the scale if the height of the subject's head while walking is given, in place of adults' stature.
"""

from __future__ import annotations

import contextlib
import io
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import lab
import numpy as np
import recordings
import scenarios
from lab import ONE_THREAD, Table
from rig import at
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat._clocks import shifted
from skelsplat._start import from_line, rays_of, relative
from skelsplat._who import one_after_another
from skelsplat._world import ADULT
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.exceptions import DegenerateGeometryError

FPS, FRAMES, SPREAD_S, MOVES_MM = 30.0, 300, 5.0, 1000.0
RATES = (30.0, 60.0, 25.0, 50.0)
# Frames in which one take passes into the next, and headings of which the one is taken that stays nearest.
BLEND, HEADINGS = 15, 24
WIDE_DEG, KNOCKED_DEG = (60.0, 110.0), 3.0
# Focal lengths of phones' main cameras, for an image 36 mm wide.
PHONES_MM = (24.0, 28.0)
# Several people: distance of the cameras from the middle of the room, and what the people do.
ROOM_MM, MEETINGS = 4500.0, ("cross", "handover", "circle", "behind", "leave")
REAL_CASES = ("known", "focal", "same", "known, clocks")
CASES = (
    *("known", "known, occluded 2", "known, occluded 3", "known, clocks", "known, useless", "known, knocked"),
    *("focal", "same", *(f"focal, {what}" for what in ("wide", "phones", "occluded 2", "clocks", "useless"))),
)
# Real takes: frames of 50 Hz, joints that have a truth, and frames by which cameras are late.
REAL_FRAMES, REAL_JOINTS, HEAD = slice(0, 1000, 2), [*range(8), *range(10, 16)], 10
REAL_CLOCKS = np.array([0.0, 37.0, -58.0, 121.0])
_JOINTS = (
    *("right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "pelvis", "neck"),
    *("right_wrist", "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist"),
)
_BONES = [(0, 1), (1, 2), (3, 4), (4, 5), (6, 7), (8, 9), (9, 10), (11, 12), (12, 13)]
BODY = sk.Layout("h36m14", _JOINTS, limbs=_BONES, human=True)
LIMBS = [*range(6), *range(8, 14)]
# Frames in which joints are placed by the found cameras.
JUDGED = 100
# Errors of a camera, and factors.
UNITS = {"°": 1.0, "mm": 1.0, "focal %": 100.0, "frames": 1.0}


@dataclass(frozen=True)
class Recording:
    """Detections without a calibration, and what should be found."""

    detections: FloatArray  # (T, M, N, 2|3)
    true: list[sk.Camera]
    late: FloatArray  # frames
    truth: FloatArray  # (T, N, 3) mm
    useless: int | None = None
    knocked: int | None = None
    layout: sk.Layout | str = "h36m17"
    fps: float = FPS
    oracle: FloatArray | None = None  # detections of several people one after another
    stature: float = np.nan  # mm

    @property
    def moves(self) -> bool:
        """Whether the person covers a metre along an axis."""
        path = np.nanmedian(self.truth, axis=1)
        return bool((np.nanmax(path, axis=0) - np.nanmin(path, axis=0)).max() >= MOVES_MM)


def motion(frames: int, seed: int) -> FloatArray:
    """Return takes of a subject in turn, blended into each other."""
    rng, every = np.random.default_rng(seed), recordings.motions()
    first = str(rng.choice(list(every)))
    own, poses = [name for name in every if name.split("_")[0] == first.split("_")[0]], every[first]
    while len(poses) < frames:
        new, end = every[str(rng.choice(own))], poses[-1, 0] * [1.0, 1.0, 0.0]
        headings = [matrix_from_vector([0.0, 0.0, angle]) for angle in rng.uniform(0, 2 * np.pi, HEADINGS)]
        tries = [(new - new[0, 0] * [1.0, 1.0, 0.0]) @ turn + end for turn in headings]
        new = min(tries, key=lambda one: np.abs(one[:, 0, :2] - poses[0, 0, :2]).max())
        part = np.linspace(0, 1, BLEND)[:, None, None]
        poses = np.concatenate([poses, poses[-1] * (1 - part) + new[0] * part, new[1:]])
    start = rng.integers(len(poses) - frames + 1)
    return poses[start : start + frames]


def simulated(views: int, seed: int, case: str) -> Recording:
    """Draw a recording."""
    if "people" in case:
        return crowded(views, seed, case)
    rng, cameras = np.random.default_rng([seed, views]), list(scenarios.rig(views))
    if "wide" in case or "phones" in case:
        halves = [
            np.tan(np.radians(rng.uniform(*WIDE_DEG)) / 2) if "wide" in case else 18 / rng.uniform(*PHONES_MM)
            for _ in cameras
        ]
        zooms = [c.size[0] / 2 / half / c.K[0, 0] for c, half in zip(cameras, halves, strict=True)]
        lenses = [[[zoom, 1, 1], [1, zoom, 1], [1, 1, 1]] for zoom in zooms]
        cameras = [altered(c, K=c.K * lens) for c, lens in zip(cameras, lenses, strict=True)]
    condition = next((one for one in case.split(", ") if one.startswith("occluded")), "good")
    rates = [RATES[i % len(RATES)] if "rates" in case else FPS for i in range(views)]
    late = np.zeros(views)
    if "clocks" in case:
        late[1:] = rng.uniform(-SPREAD_S, SPREAD_S, views - 1) * FPS
    extra = round(SPREAD_S * FPS) + 1 if late.any() else 0
    frames = (2 if extra else 1) * FRAMES
    poses = recordings.placed(motion(frames + 2 * extra, seed), sk.CameraRig(cameras), seed)

    def seen(poses: FloatArray, i: int, cameras: Sequence[sk.Camera] = cameras) -> FloatArray:
        moved = at(poses, extra - late[i], FPS / rates[i])[: round(frames * rates[i] / FPS)]
        detector = recordings.noise(condition, views, rates[i])
        return synthetic.simulate_detections(moved, cameras, noise=detector, layout="h36m17", seed=seed)[:, i]

    detections, rate = sk.retimed([seen(poses, i) for i in range(views)], rates)
    useless = int(rng.integers(views)) if "useless" in case else None
    if useless is not None:
        other = motion(frames + 2 * extra, 10_000 + seed)
        detections[:, useless] = seen(recordings.placed(other, sk.CameraRig(cameras), seed), useless)
    knocked = int(rng.integers(views)) if "knocked" in case else None
    if knocked is not None:
        axis = rng.normal(size=3)
        turn = matrix_from_vector(np.radians(KNOCKED_DEG) * axis / np.linalg.norm(axis))
        before, after = cameras, list(cameras)
        after[knocked] = altered(after[knocked], R=turn @ after[knocked].R, t=turn @ after[knocked].t)
        since = round(frames * rng.uniform(0.3, 0.7))
        detections[since:, knocked] = seen(poses, knocked, after)[since:]
        cameras = before if 2 * since > frames else after
    truth = at(poses, extra, FPS / rate)[: len(detections)]
    return Recording(detections, cameras, late * rate / FPS, truth, useless, knocked, fps=rate)


def crowded(views: int, seed: int, case: str) -> Recording:
    """Draw a scene of several people; clocks are off by whole frames."""
    rig, late = synthetic.ring(views, radius_mm=ROOM_MM), np.zeros(views)
    if "clocks" in case:
        late[1:] = np.random.default_rng(seed).integers(-SPREAD_S * FPS, SPREAD_S * FPS, views - 1)
    extra, frames = (round(SPREAD_S * FPS), 2 * FRAMES) if late.any() else (0, FRAMES)
    given = {"n_frames": frames + 2 * extra, "meetings": MEETINGS, "bystander": "bystander" in case}
    scene = synthetic.simulate_scene(int(case.partition(" people")[0][-1]), rig, fps=FPS, seed=seed, **given)

    def shown(values: FloatArray) -> FloatArray:
        begin = extra - late.astype(int)
        return np.stack([values[first:, i][:frames] for i, first in enumerate(begin)], axis=1)

    everyone = [shown(one) for one in scene.detections()]
    people, truth = shown(scene.people), scene.truth[0, extra:][:frames]
    oracle = one_after_another(everyone, round(2 * SPREAD_S * FPS))
    return Recording(people, list(rig), late, truth, oracle=oracle)


def filmed(path: Path, case: str) -> Recording:
    """Read 20 s of a take; with `clocks`, shifted."""
    with np.load(path) as z:
        sizes, match = [tuple(size) for size in z["image_size"].tolist()], dict(z["pairs"].tolist())
        given = zip(z["K"], z["R"], z["t"], z["dist"], sizes, strict=True)
        true = [
            sk.Camera(K, R, t, distortion=lens, size=size, name=f"cam{i}")
            for i, (K, R, t, lens, size) in enumerate(given)
        ]
        detections = z["det2d"][REAL_FRAMES, :, 0][:, :, REAL_JOINTS, :2].astype(float)
        truth = z["gt3d"][REAL_FRAMES, 0][:, [match[k] for k in REAL_JOINTS]].astype(float)
    late = REAL_CLOCKS if "clocks" in case else np.zeros(len(true))
    views = [shifted(detections[:, i], -late[i]) for i in range(len(true))]
    tall = stature(path.parent, path.stem.split("_")[0])
    return Recording(np.stack(views, axis=1), true, late, truth, layout=BODY, fps=25.0, stature=tall)


@cache
def stature(folder: Path, subject: str) -> float:
    """Return the height of a subject's head while walking, mm."""
    heads = [np.load(path)["gt3d"][:, 0, HEAD, 2] for path in folder.glob(f"{subject}_Walking*.npz")]
    return max((float(np.nanpercentile(one, 95)) for one in heads), default=np.nan)


def similarity(a: FloatArray, b: FloatArray, turns: FloatArray | float = 0.0) -> tuple[FloatArray, float]:
    """Return rotation (3, 3) and scale from centred points (K, 3) to others, with a sum of turns besides."""
    u, _, w = np.linalg.svd(np.sqrt((b**2).sum() / (a**2).sum()) * b.T @ a + turns)
    Q = u @ np.diag([1.0, 1.0, np.linalg.det(u @ w)]) @ w
    return Q, float((b * (a @ Q.T)).sum() / (a**2).sum())


def aligned(points: FloatArray, truth: FloatArray) -> tuple[FloatArray, float]:
    """Return how far points (T, N, 3) are from others, aligned by a similarity as a whole, and its scale."""
    known = np.isfinite(points + truth).all(axis=-1)
    a, b = points[known], truth[known]
    Q, scale = similarity(a - a.mean(axis=0), b - b.mean(axis=0))
    return scale * (points - a.mean(axis=0)) @ Q.T + b.mean(axis=0) - truth, scale


def apart(found: Sequence[sk.Camera], true: Sequence[sk.Camera]) -> tuple[Any, ...]:
    """Return the turns between two aligned rigs and of z, degrees, distances, mm, and the scale."""
    R, S = (np.stack([np.asarray(camera.R) for camera in rig]) for rig in (found, true))
    a, b = (np.stack([np.asarray(camera.centre) for camera in rig]) for rig in (found, true))
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    Q, scale = similarity(a, b, (b**2).sum() / len(b) * np.einsum("vji,vjk->ik", S, R))
    cosines = [*((np.einsum("vij,vij->v", S, R @ Q.T) - 1) / 2), Q[2, 2]]
    turns = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return *turns, np.linalg.norm(scale * a @ Q.T - b, axis=1), scale


def by_opencv(one: Recording) -> list[sk.Camera]:
    """Place cameras with known lenses as a script does: a pair by MAGSAC, the others by their joints."""
    rays = rays_of(one.detections, one.true)
    found = relative(rays[:, 0], rays[:, 1], 0, from_line(*one.true[:2]), (len(rays) * rays.shape[2], 1000))
    assert found is not None
    placed = [altered(one.true[0], R=np.eye(3), t=np.zeros(3)), altered(one.true[1], R=found[0], t=found[1])]
    points = sk.triangulate(one.detections[:, :2, :, :2], placed).reshape(-1, 3)
    for i, camera in enumerate(one.true[2:], start=2):
        own = rays[:, i].reshape(-1, 2)
        known = np.isfinite(points).all(axis=1) & np.isfinite(own).all(axis=1)
        size = max(camera.size) / camera.K[0, 0]
        given = (points[known], own[known], np.eye(3), None)
        _, turn, t, _ = cv2.solvePnPRansac(*given, reprojectionError=0.02 * size)
        placed.append(altered(camera, R=cv2.Rodrigues(turn)[0], t=t.ravel()))
    return placed


def by_aniposelib(one: Recording) -> list[sk.Camera]:
    """Adjust the cameras of `by_opencv` with Aniposelib, its settings at their defaults."""
    from aniposelib.cameras import Camera, CameraGroup

    start = by_opencv(one)
    size = float(np.linalg.norm(start[1].centre)) / 1000.0  # Anipose expects mm
    every = [
        Camera(matrix=c.K, rvec=cv2.Rodrigues(c.R)[0].ravel(), tvec=c.t / size, size=c.size) for c in start
    ]
    group, pixels = CameraGroup(every), np.moveaxis(one.detections[..., :2], 1, 0)
    with contextlib.redirect_stdout(io.StringIO()):
        group.bundle_adjust_iter(pixels.reshape(len(every), -1, 2).copy(), only_extrinsics=True)
    return [
        altered(c, R=cv2.Rodrigues(a.get_rotation())[0], t=a.get_translation())
        for c, a in zip(start, group.cameras, strict=True)
    ]


PEERS = {"OpenCV": by_opencv, "Aniposelib": by_aniposelib}


def judged(one: Recording, found: sk.RigCalibration) -> dict[str, Any]:
    """Compare a calibration with the truth; the useless camera does not count."""
    there = [i for i, camera in enumerate(found.report) if camera.status == "placed"]
    own = {i: camera for i, camera in zip(there, found.cameras, strict=True) if i != one.useless}
    out = set(range(len(one.true))) - set(there)
    named = {i for i, camera in enumerate(found.report) if camera.span is not None}
    if len(own) < 2:
        return {"right": False, "refused": not found.sure, "wrong": found.sure, "world": False}
    *turns, tilt, places, scale = apart(list(own.values()), [one.true[i] for i in own])
    report = [found.report[i] for i in own]
    zooms = [own[i].K[0, 0] / one.true[i].K[0, 0] - 1 for i in own]
    clocks = [found.report[i].clock - one.late[i] + one.late[there[0]] for i in own]
    errors = np.abs([turns, places, zooms, clocks])
    bars = [[c.turn_sigma, scale * c.place_sigma, c.focal_sigma, c.clock_sigma] for c in report]
    near = (errors.T - 3 * np.nan_to_num(bars) <= 1e-6).all(axis=1)
    off = abs(1 / scale - 1)
    row = {
        "right": not out - {one.useless} and bool((errors.T[:, [0, 1, 3]] <= [1.0, 60.0, 0.5]).all()),
        "refused": not found.sure,
        "wrong": found.sure and not near.all(),
        "world": found.sure and bool(off > 3 * found.scale_sigma or tilt > 3 * found.up_sigma),
        "useless": one.useless in out,
        "named": named == {one.knocked} if one.knocked is not None else bool(named),
        "left out": bool(out - {one.useless}),
        "3 σ": float(near.mean()),
    }
    for k, (head, unit) in enumerate(UNITS.items()):
        if errors[k].any():
            row |= {head: unit * errors[k].max(), f"± {head}": unit * np.max(bars, axis=0)[k]}
    if one.oracle is None:
        truth = one.truth[:: max(1, len(one.truth) // JUDGED)]
        seen = sk.project(truth, [one.true[i] for i in own])
        placed = sk.triangulate(np.moveaxis(seen, 0, 1), list(own.values()))
        left, size = aligned(placed, truth)
        off_mm, sigma_mm = float(np.sqrt(np.nanmean(left**2))), size * found.cameras.joint_sigma
        row |= {"joints mm": off_mm, "± joints": sigma_mm}
    row |= {"scale %": 100 * off, "± scale": 100 * found.scale_sigma, "tilt": tilt}
    if np.isfinite(one.stature):
        sigma = np.sqrt(found.scale_sigma**2 - (ADULT[1] / ADULT[0]) ** 2)
        row |= {"stature %": 100 * abs(one.stature / ADULT[0] / scale - 1), "± stature": 100 * sigma}
    return row


def limbs(one: Recording, detections: FloatArray, cameras: sk.CameraRig, late: float = 0.0) -> float:
    """Return the mean error of the joints of the limbs, mm, of a take aligned as a whole."""
    pose = sk.refine_sequence(detections, cameras, fps=one.fps, layout=one.layout, config=ONE_THREAD).pose
    left, _ = aligned(pose, shifted(one.truth, -late))
    return float(np.nanmean(np.linalg.norm(left, axis=-1)[:, LIMBS]))


def with_oracle(one: Recording, row: dict[str, Any], found: sk.RigCalibration) -> dict[str, Any]:
    """Compare what was found of several people with what was found by their true association."""
    true, heads = judged(one, found), {"°": 0.1, "mm": 10.0}
    near = [row.get(head, np.inf) <= max(1.5 * true[head], true[head] + more) for head, more in heads.items()]
    return {"as good": all(near), "oracle right": true["right"], **{f"oracle {h}": true[h] for h in heads}}


def measured(one: Recording, case: str, peers: Sequence[str] = ()) -> dict[str, Any]:
    """Calibrate and judge; of a real take also its poses. Peers take known lenses, and cameras in step."""
    lenses = one.true if case.startswith("known") else [sk.Intrinsics(c.size, name=c.name) for c in one.true]
    what = {"clock": "clocks" in case, "same_focal": case.startswith("same"), "config": ONE_THREAD}
    begun = time.process_time()
    try:
        found = sk.calibrate_cameras(one.detections, lenses, layout=one.layout, fps=one.fps, **what)
    except DegenerateGeometryError:
        return {"right": False, "refused": True, "wrong": False, "world": False}
    spent = time.process_time() - begun
    row = judged(one, found) | {"CPU s": spent}
    if one.oracle is not None:
        known = sk.calibrate_cameras(one.oracle, lenses, layout=one.layout, fps=one.fps, **what)
        row |= with_oracle(one, row, known)
    for name in peers:
        begun = time.process_time()
        placed = PEERS[name](one)
        spent = time.process_time() - begun
        *turns, _, places, _ = apart(placed, one.true)
        row |= {f"{name} °": max(turns), f"{name} mm": places.max(), f"{name} s": spent}
    if one.layout is BODY:
        first = next(i for i, camera in enumerate(found.report) if camera.status == "placed")
        views = [shifted(one.detections[:, i], late) for i, late in enumerate(one.late)]
        row["given"] = limbs(one, np.stack(views, axis=1), sk.CameraRig(one.true))
        row["found"] = limbs(one, found.synchronised(one.detections), found.cameras, one.late[first])
        row["more %"] = 100 * (row["found"] / row["given"] - 1)
    return row


def table(
    title: str,
    cases: Iterable[str],
    takes: Sequence[Any],
    recorded: Callable[[Any, str], Recording],
    peers: Sequence[str] = (),
) -> Table:
    """Measure the takes of every case: those in which the person moves, and the others."""
    found: dict[str, list[dict[str, Any]]] = {}
    for case, take in product(cases, takes):
        one = recorded(take, case)
        name = f"{case}: {'moves' if one.moves else 'other'}"
        found.setdefault(name, []).append(measured(one, case, peers))
    rows: dict[str, dict[str, str | float]] = {}
    for name, every in found.items():
        rows[name] = {"takes": str(len(every))}
        for head in dict.fromkeys(head for row in every for head in row):
            values = [row[head] for row in every if head in row]
            share = isinstance(values[0], bool) or head == "3 σ"
            rows[name][head] = f"{100 * np.mean(values):.0f}" if share else float(np.median(values))
        more = [row["more %"] for row in every if "more %" in row]
        if more:
            rows[name] |= {"mean": float(np.mean(more)), "most": max(more)}
    return Table.of(title, "case", rows)


def spent(views: int, known: bool, frames: int) -> dict[str, float]:
    """Return the largest resident set, MB, of this process when it has calibrated by so many frames."""
    one = simulated(views, 0, "known")
    lenses = one.true if known else [sk.Intrinsics(camera.size) for camera in one.true]
    seen, begun = np.resize(one.detections, (frames, *one.detections.shape[1:])), time.process_time()
    sk.calibrate_cameras(seen, lenses, layout=one.layout, config=ONE_THREAD)
    return {"peak MB": lab.peak_mib(), "CPU s": time.process_time() - begun}


def calibrate(
    *,
    views: tuple[int, ...] = (2, 3, 4, 8),
    cases: tuple[str, ...] = (),
    takes: int = 20,
    seed: int = 0,
    real: Path | None = None,
    subjects: tuple[str, ...] = ("S1", "S5", "S6", "S7", "S8"),
    peers: tuple[str, ...] = (),
    frames: tuple[int, ...] = (),
) -> Iterator[Table]:
    """Measure simulated recordings, or the real ones of a folder, or what so many frames cost."""
    warnings.simplefilter("ignore")
    if frames:
        for n, lenses in ((4, "known"), (8, "unknown")):
            rows = {f"{count:,}": lab.alone(spent, n, lenses == "known", count) for count in frames}
            yield Table.of(f"{n} views, {lenses} lenses", "frames", rows)
        return
    if real is not None:
        paths = sorted(path for path in real.glob("*.npz") if path.stem.split("_")[0] in subjects)
        title = f"{len(paths)} real takes, Human3.6M, {', '.join(subjects)}"
        yield table(title, cases or REAL_CASES, paths, filmed, peers)
        return
    for n in views:
        # Two views tell no focal lengths, and three not which of them is useless.
        fit = [
            case for case in cases or CASES if n >= (4 if "useless" in case else 2 if "known" in case else 3)
        ]
        seeds, title = range(seed, seed + takes), f"{n} views, {takes} takes, simulated"
        yield table(title, fit, seeds, partial(simulated, n), peers)


if __name__ == "__main__":
    lab.main(__doc__, calibrate)
