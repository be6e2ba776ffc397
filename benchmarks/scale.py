"""What poses cost: per core, by frames, views, people and joints, and memory.

    python benchmarks/scale.py speed growth memory       all tables, about ten minutes
    python benchmarks/scale.py growth picture            draws the growth too: docs/figures/scaling.png
    python benchmarks/scale.py refine --frames 1000000   memory and time of `skelsplat refine`

Simulated recordings (`synthetic.motion`, errors that last), seen by a ring of cameras, 17 joints in 4 views
where nothing else is said. CPU time of one thread, the best of several runs: other programs disturb it
little, but they share caches and clock rates. Memory is the largest resident set of a process of its own.
"""

from __future__ import annotations

import collections
import functools
import itertools
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import lab
import numpy as np
from lab import ONE_THREAD, Table, cpu_ms

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import write_calibration

FPS = 100.0
FRAMES, PEOPLE_FRAMES, LONG, PIECE = 2000, 1000, 16_000, 4000
DAY_FRAMES = 24 * 3600 * FPS
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "scaling.png"
# For `growth`: where everything else is 17 joints, 4 views, 2000 frames.
SIZES = {
    "frames": (250, 1000, 4000, 16_000),
    "views": (2, 4, 8, 16, 31),
    "joints": (17, 34, 68, 136),
    "people": (1, 2, 4, 6),
}


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


def people_us(people: int, views: int, repeat: int) -> float:
    """CPU time per frame of ``track``, which finds out who is who and solves everybody in time, µs."""
    rig = synthetic.ring(views, radius_mm=4500.0)
    scene = synthetic.simulate_scene(people, rig, n_frames=PEOPLE_FRAMES, fps=FPS, seed=1)
    given = {"fps": FPS, "layout": scene.layout, "config": ONE_THREAD}
    return 1e3 * cpu_ms(lambda: sk.track(scene.people, scene.cameras, **given), repeat) / PEOPLE_FRAMES


def speed(repeat: int) -> Table:
    """Measure what a pose costs, and how many a core solves."""
    costs = {
        "frame by frame, `refine`": frame_us("alone", repeat),
        "in time, `refine_sequence` of 2000 frames": frame_us("in time", repeat),
        "the same of 16,000 frames": frame_us("in time", repeat, LONG),
        "the same in chunks of 1000, `refine_batches`": frame_us("chunks", repeat, LONG),
        "live, `Refiner(fps=…).step`": frame_us("live", repeat),
        "4 people, `track`, per person": people_us(4, 4, repeat) / 4,
    }
    rows = {
        name: {"µs per pose": f"{us:.0f}", "poses per second and core": f"{1e6 / us:,.0f}"}
        for name, us in costs.items()
    }
    hours = people_us(4, 8, repeat) * DAY_FRAMES / 3.6e9
    note = f"a day of 8 cameras at {FPS:g} Hz with 4 people, `track`: {hours:.1f} core hours"
    return Table.of("17 joints, 4 views", "way", rows, [note])


def growth(repeat: int) -> Table:
    """How the time per frame grows with frames, views, joints and people."""
    rows = {}
    for what, costs in measured_growth(repeat).items():
        first = next(iter(costs.values()))
        for size, ways in costs.items():
            row = {f"µs per frame {way}": f"{us:.0f}" for way, us in ways.items()}
            row |= {f"{way}, times the first": f"{us / first[way]:.2f}" for way, us in ways.items()}
            rows[f"{size:,} {what}"] = row
    return Table.of("growth", "", rows)


@functools.cache
def measured_growth(repeat: int) -> dict[str, dict[int, dict[str, float]]]:
    """Return µs per frame, alone and in time, by what grows and its size; of people what `track` takes."""
    sizes = {
        "frames": lambda size: {"frames": size},
        "views": lambda size: {"views": size},
        "joints": lambda size: {"bodies": size // 17},
    }
    out = {
        what: {
            size: {way: frame_us(way, repeat, **given(size)) for way in ("alone", "in time")}
            for size in SIZES[what]
        }
        for what, given in sizes.items()
    }
    return out | {"people": {n: {"in time": people_us(n, 4, repeat)} for n in SIZES["people"]}}


def memory(_: int) -> Table:
    """Largest resident set of a process by frames: all at once, and in chunks."""
    rows = {}
    for frames in (10_000, 40_000, 160_000):
        row = {"`refine_sequence`, MB": child_mib("whole", frames)}
        rows[f"{frames:,}"] = row | {"`refine_batches`, chunks of 4000": child_mib("chunks", frames)}
    rows["1,000,000"] = {"`refine_batches`, chunks of 4000": child_mib("chunks", 1_000_000)}
    return Table.of("memory", "frames", rows, digits=0)


def child_mib(way: str, frames: int) -> float:
    """Return the largest resident set of a process that refines so many frames, MiB."""
    command = [sys.executable, __file__, "child", way, str(frames)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def child(way: str, frames: int) -> None:
    """Refine frames, and print the largest resident set in MiB."""
    rig, seen = recorded(1000)
    given = {"fps": FPS, "layout": "h36m17"}
    chunk = np.tile(seen, (PIECE // len(seen), 1, 1, 1))
    if way == "whole":
        sk.refine_sequence(np.concatenate([chunk] * (frames // PIECE)), rig, **given)
    else:
        chunks = functools.partial(itertools.repeat, chunk, frames // PIECE)
        collections.deque(sk.refine_batches(chunks, rig, **given), maxlen=0)
    print(lab.peak_mib())


def refine(frames: int) -> Table:
    """Peak memory and times of ``skelsplat refine``: one person walks, sits and waves by turns.

    A million frames need 25 GB in the folder of temporary files (``TMPDIR``).
    """
    rig = synthetic.human36m_like()
    with tempfile.TemporaryDirectory(prefix="skelsplat-scale-") as temporary:
        top = Path(temporary)
        write_calibration(top / "cameras.json", rig)
        np.savez(top / "detections.npz", detections=written(top, frames, rig), camera_names=rig.names)
        command = [sys.executable, "-m", "skelsplat", "refine", str(top / "cameras.json")]
        command += [str(top / "detections.npz"), "-o", str(top / "out"), "--layout", "h36m17"]
        seconds = lab.seconds(lambda: subprocess.run([*command, "--fps", f"{FPS:g}", "-q"], check=True))
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        sizes = {path.name: path.stat().st_size / 1e6 for path in sorted((top / "out").iterdir())}
    row = {
        "peak MB": used.ru_maxrss / 1024,
        "wall s": seconds,
        "CPU s": used.ru_utime + used.ru_stime,
        "µs per frame": 1e6 * seconds / frames,
    }
    files = "files, MB: " + ", ".join(f"{name} {size:.0f}" for name, size in sizes.items())
    return Table.of("skelsplat refine", "frames", {f"{frames:,}": row}, [files], digits=0)


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


def picture(repeat: int) -> None:
    """Draw the growth into docs/figures/scaling.png."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    looks = {"alone": ("frame by frame", "o", "#4477aa"), "in time": ("in time", "s", "#cc6677")}
    costs = measured_growth(repeat)
    figure, axes = plt.subplots(1, len(costs), figsize=(11, 3), sharey=True, layout="constrained")
    for axis, (what, of_sizes) in zip(axes, costs.items(), strict=True):
        ways = next(iter(of_sizes.values()))
        for way in ways:
            label, mark, colour = looks[way] if len(ways) > 1 else ("people, with track", "^", "#117733")
            line = [cost[way] for cost in of_sizes.values()]
            axis.loglog(list(of_sizes), line, marker=mark, color=colour, label=label)
        axis.set_xticks(list(of_sizes), [f"{size:,}" for size in of_sizes], minor=False)
        axis.minorticks_off()
        axis.set_xlabel(what)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("CPU time per frame [µs]")
    for axis in axes[[1, -1]]:
        axis.legend(frameon=False)
    figure.savefig(FIGURE, dpi=150)


def scale(
    tables: tuple[str, ...] = ("speed", "growth", "memory"), *, repeat: int = 5, frames: int = 100_000
) -> Iterator[Table]:
    """Measure each table; of so many runs the best counts. `frames` are those of `refine`."""
    measures = {"speed": speed, "growth": growth, "memory": memory}
    for name in tables:
        if name == "picture":
            picture(repeat)
        else:
            yield refine(frames) if name == "refine" else measures[name](repeat)


if __name__ == "__main__":
    if sys.argv[1:2] == ["child"]:
        child(sys.argv[2], int(sys.argv[3]))
    else:
        lab.main(__doc__, scale)
