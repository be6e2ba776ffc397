"""What poses cost: time and memory of the solvers, of the paper's settings, of several people, of files.

    python benchmarks/speed.py ways | growth | memory | people | live
    python benchmarks/speed.py paper                     one pose (about 3 s on a GPU, as the paper reports)
    python benchmarks/speed.py refine --frames 1000000   memory and time of `skelsplat refine`

Simulated recordings (`synthetic.motion`, errors that last), seen by a ring of cameras, 17 joints in 4 views
where nothing else is said. CPU time of one thread, the best of several runs: other programs disturb it
little, but they share caches and clock rates. Memory is the largest resident set of a process of its own.
"""

from __future__ import annotations

import collections
import itertools
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import lab
import numpy as np
from lab import ONE_THREAD, Table, cpu_ms
from scenarios import simulated

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cameras import altered
from skelsplat.io import write_calibration

FPS = 100.0
FRAMES, PEOPLE_FRAMES, LONG, PIECE = 2000, 1000, 16_000, 4000
# Of the paper's settings: calls of which the median counts, and the width and height of images.
CALLS, SIDE_PX = 15, 1000
# Of several people: people and views.
SCENES = [(3, 4), (6, 8)]
SCENES_FPS = 30.0
# For `growth`: where everything else is 17 joints, 4 views, 2000 frames.
SIZES = {"frames": (250, 1000, 4000, 16_000), "views": (2, 4, 8, 16, 31), "joints": (17, 34, 68, 136)}


def recorded(frames: int = FRAMES, views: int = 4, bodies: int = 1) -> tuple[sk.CameraRig, np.ndarray]:
    """Return a ring of cameras, and detections (T, M, 17 bodies, 3) of a walk, once per body."""
    rig, noise = synthetic.ring(views), synthetic.DetectionNoise.recording(FPS)
    pose = synthetic.motion("walk", frames, fps=FPS, seed=1)
    seen = [synthetic.simulate_detections(pose, rig, noise=noise, seed=k) for k in range(bodies)]
    return rig, np.concatenate(seen, axis=2)


def frame_us(way: str, repeat: int, frames: int = FRAMES, views: int = 4, bodies: int = 1) -> float:
    """CPU time per frame of a way to solve a recording, µs."""
    rig, seen = recorded(frames, views, bodies)
    given = {"layout": "h36m17" if bodies == 1 else None, "config": ONE_THREAD}

    def live() -> None:
        refiner = sk.Refiner(rig, fps=FPS, **given)
        for frame in seen:
            refiner.step(frame)

    ways = {
        "alone": lambda: sk.refine(None, seen, rig, **given),
        "in time": lambda: sk.refine_sequence(seen, rig, fps=FPS, **given),
        "chunks": lambda: list(sk.refine_batches(seen, rig, fps=FPS, frames_per_chunk=1000, **given)),
        "live": live,
    }
    return 1e3 * cpu_ms(ways[way], repeat) / frames


def person_us(repeat: int) -> float:
    """CPU time per frame and person of ``track``, which solves four people over time, µs."""
    rig = synthetic.ring(4, radius_mm=4500.0)
    scene = synthetic.simulate_scene(4, rig, n_frames=PEOPLE_FRAMES, fps=FPS, seed=1)
    given = {"fps": FPS, "layout": scene.layout, "config": ONE_THREAD}
    return 1e3 * cpu_ms(lambda: sk.track(scene.people, rig, **given), repeat) / PEOPLE_FRAMES / 4


def ways(*, repeat: int = 5) -> Table:
    """Measure what a pose costs."""
    costs = {
        "frame by frame, `refine`": frame_us("alone", repeat),
        "over time, `refine_sequence` of 2000 frames": frame_us("in time", repeat),
        "over time, in chunks, `refine_batches` of 16,000 frames": frame_us("chunks", repeat, LONG),
        "live, `Refiner(fps=…).step`": frame_us("live", repeat),
        "4 people, `track`, per person": person_us(repeat),
    }
    rows = {name: {"µs per pose": us} for name, us in costs.items()}
    return Table.of("17 joints, 4 views", "way", rows, digits=0)


def growth(*, repeat: int = 5) -> Table:
    """How the time per frame grows with frames, views and joints."""
    rows = {}
    for what, sizes in SIZES.items():
        for size in sizes:
            given = {"bodies": size // 17} if what == "joints" else {what: size}
            costs = {f"µs {way}": frame_us(way, repeat, **given) for way in ("alone", "in time")}
            rows[f"{size:,} {what}"] = costs
    return Table.of("growth, per frame", "", rows, digits=0)


def memory() -> Table:
    """Largest resident set of a process by frames: all at once, and in chunks."""
    rows = {}
    for frames in (10_000, 160_000, 1_000_000):
        whole = lab.alone(mib, "whole", frames) if frames < 1_000_000 else None
        in_chunks = lab.alone(mib, "chunks", frames)
        rows[f"{frames:,}"] = {"`refine_sequence`, MB": whole, "`refine_batches`, chunks of 4000": in_chunks}
    return Table.of("memory", "frames", rows, digits=0)


def mib(way: str, frames: int) -> float:
    """Return the largest resident set when frames are refined, MiB."""
    rig, seen = recorded(1000)
    given = {"fps": FPS, "layout": "h36m17"}
    chunk = np.tile(seen, (PIECE // len(seen), 1, 1, 1))
    if way == "whole":
        sk.refine_sequence(np.concatenate([chunk] * (frames // PIECE)), rig, **given)
    else:
        chunks = partial(itertools.repeat, chunk, frames // PIECE)
        collections.deque(sk.refine_batches(chunks, rig, **given), maxlen=0)
    return lab.peak_mib()


def refine(*, frames: int = 100_000) -> Table:
    """Peak memory and time of ``skelsplat refine``: one person walks, sits and waves by turns.

    A million frames need 25 GB in the folder of temporary files (``TMPDIR``).
    """
    rig = synthetic.human36m_like()
    with tempfile.TemporaryDirectory(prefix="skelsplat-scale-") as temporary:
        top = Path(temporary)
        write_calibration(top / "cameras.json", rig)
        np.savez(top / "detections.npz", detections=written(top, frames, rig), camera_names=rig.names)
        words = f"refine cameras.json detections.npz -o out --layout h36m17 --fps {FPS:g} -q"
        command = [sys.executable, "-m", "skelsplat", *words.split()]
        subprocess.run(command, cwd=top, check=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = used.ru_utime + used.ru_stime
    row = {"peak MB": used.ru_maxrss / 1024, "CPU µs per frame": 1e6 * seconds / frames}
    return Table.of("skelsplat refine", "frames", {f"{frames:,}": row}, digits=0)


def written(folder: Path, frames: int, rig: sk.CameraRig) -> np.ndarray:
    """Return the detections (T, M, 17, 3) of a recording, each motion there and back, on disk."""
    shape, noise = (frames, len(rig), 17, 3), synthetic.DetectionNoise.good()
    out = np.lib.format.open_memmap(folder / "detections.npy", "w+", np.float64, shape)
    for k, first in enumerate(range(0, frames, PIECE)):
        there = synthetic.motion(synthetic.motion_names[k % 6], PIECE // 2, seed=k)
        poses = np.concatenate([there, there[::-1]])[: frames - first]
        seen = synthetic.simulate_detections(poses, rig, noise=noise, layout="h36m17", seed=k)
        out[first : first + PIECE] = seen
    return out


def paper() -> Table:
    """Time the paper's settings, 17 joints, 4 views, all 125 steps, one core.

    Times are the median of repeated calls of ``skelsplat.refine`` from Python, everything included.
    """
    times = [lab.seconds(by_paper()) for _ in range(1 + CALLS)][1:]
    row = {"ms": 1e3 * statistics.median(times)}
    return Table.of("RefineConfig.paper(), 17 joints, 4 views", "", {"one pose": row})


def by_paper(**fields: object) -> partial[sk.Refinement]:
    """Return the refinement of one pose as a call, without early stopping."""
    cameras = []
    for camera in synthetic.human36m_like():
        K = camera.K
        K[:2, 2] = (SIDE_PX - 1) / 2
        cameras.append(altered(camera, K=K, size=(SIDE_PX, SIDE_PX)))
    rig, pose = sk.CameraRig(cameras), synthetic.motion("walk", 1, seed=0)[0]
    detections = sk.project(pose, rig)
    detections = detections + np.random.default_rng(0).normal(0, 3.0, detections.shape)
    start = synthetic.perturb(pose, 20.0, seed=1)
    config = sk.RefineConfig.paper(stop_tolerance=0.0, n_threads=1, **fields)
    return partial(sk.refine, start, detections, rig, layout="h36m17", config=config)


def people(*, frames: int = 600) -> Table:
    """Time `sk.track` and `sk.Tracker.step`, once.

    "association" is what `track` takes beyond `sk.refine_sequence` of the same people.
    """
    rows, given = {}, {"fps": SCENES_FPS, "layout": "h36m17", "config": ONE_THREAD}
    for people, views in SCENES:
        rig, found = synthetic.ring(views, radius_mm=4500.0), []
        here = synthetic.simulate_scene(people, rig, n_frames=frames, seed=1)
        call = partial(sk.track, here.people, here.cameras, **given)
        whole = cpu_ms(lambda found=found, call=call: found.extend(call())) / frames
        solve = partial(sk.refine_sequence, cameras=here.cameras, **given)
        own = [person.detections(here.people) for person in found]
        solved = cpu_ms(lambda own=own, solve=solve: [solve(seen) for seen in own]) / frames
        tracker = sk.Tracker(here.cameras, **given)
        live = [cpu_ms(partial(tracker.step, frame)) for frame in here.people]
        step = {"step ms": float(np.mean(live)), "99 % ms": float(np.quantile(live, 0.99))}
        rows[f"{people}, {views}"] = {"association ms": whole - solved, "track ms": whole, **step}
    return Table.of("several people, simulated, one thread", "people, views", rows, digits=2)


def live(*, poses: int = 5000) -> Table:
    """Measure the lines per second that `skelsplat live` answers on one core: six motions."""
    scene = simulated(poses)
    seen = np.where(np.isfinite(scene.detections), scene.detections, None)
    frames = [frame.tolist() for frame in seen]
    lines = [json.dumps({"frame": t, "detections": frame}) + "\n" for t, frame in enumerate(frames)]
    with tempfile.TemporaryDirectory() as folder:
        sent = Path(folder, "lines.jsonl")
        sent.write_text("".join(lines))
        write_calibration(Path(folder, "rig.toml"), scene.rig)
        words = "live rig.toml --unit mm --layout h36m17"
        command = [sys.executable, "-m", "skelsplat", *words.split()]
        pipes = {"cwd": folder, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with sent.open() as stdin, subprocess.Popen(command, stdin=stdin, **pipes) as process:
            os.sched_setaffinity(process.pid, {0})
            process.stderr.readline()  # it says that it is ready
            begun = time.perf_counter()
            answers = sum(bool(process.stdout.readline()) for _ in lines)
            rate = answers / (time.perf_counter() - begun)
    title = "skelsplat live, 4 views, 17 joints, one core"
    return Table.of(title, "what", {"lines per second": {"measured": rate}}, digits=0)


if __name__ == "__main__":
    lab.main(__doc__, ways, growth, memory, refine, paper, people, live)
