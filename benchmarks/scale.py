"""What poses cost: per core, by frames, views, people and joints, and memory.

    python benchmarks/scale.py                           all tables, about ten minutes
    python benchmarks/scale.py speed growth --markdown   some of them: speed, growth, memory
    python benchmarks/scale.py growth picture            draws the growth too: docs/figures/scaling.png
    python benchmarks/scale.py refine --frames 1000000   memory and time of `skelsplat refine`

Simulated recordings (`synthetic.motion`, errors that last), seen by a ring of cameras, 17 joints in 4 views
where nothing else is said. CPU time of one thread, the best of several runs: other programs disturb it
little, but they share caches and clock rates. Memory is the largest resident set of a process of its own.
"""

from __future__ import annotations

import functools
import resource
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import lab
import numpy as np
from lab import ONE_THREAD, Table, cpu_ms

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import write_calibration

FPS = 100.0
FRAMES = 2000
PIECE = 4000
PEOPLE_FRAMES = 1000
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


def alone_us(frames: int, views: int, bodies: int, repeat: int) -> float:
    """CPU time per frame of ``refine``, µs."""
    rig, seen = recorded(frames, views, bodies)
    layout = "h36m17" if bodies == 1 else None
    return 1e3 * cpu_ms(lambda: sk.refine(None, seen, rig, layout=layout, config=ONE_THREAD), repeat) / frames


def in_time_us(frames: int, views: int, bodies: int, repeat: int) -> float:
    """CPU time per frame of ``refine_sequence``, µs."""
    rig, seen = recorded(frames, views, bodies)
    given = {"fps": FPS, "layout": "h36m17" if bodies == 1 else None, "config": ONE_THREAD}
    return 1e3 * cpu_ms(lambda: sk.refine_sequence(seen, rig, **given), repeat) / frames


def people_us(people: int, views: int, repeat: int) -> float:
    """CPU time per frame of ``track``, which finds out who is who and solves everybody in time, µs."""
    rig = synthetic.ring(views, radius_mm=4500.0)
    scene = synthetic.simulate_scene(people, rig, n_frames=PEOPLE_FRAMES, fps=FPS, seed=1)
    given = {"fps": FPS, "layout": scene.layout, "config": ONE_THREAD}
    return 1e3 * cpu_ms(lambda: sk.track(scene.people, scene.cameras, **given), repeat) / PEOPLE_FRAMES


def live_us(repeat: int) -> float:
    """CPU time of ``Refiner.step`` with ``fps``, µs."""
    rig, seen = recorded()

    def loop() -> None:
        refiner = sk.Refiner(rig, layout="h36m17", fps=FPS, config=ONE_THREAD)
        for frame in seen:
            refiner.step(frame)

    return 1e3 * cpu_ms(loop, repeat) / len(seen)


def chunks_us(frames: int, repeat: int) -> float:
    """CPU time per frame of ``refine_batches`` with ``fps``, µs."""
    rig, many = recorded(frames)
    given = {"fps": FPS, "layout": "h36m17", "config": ONE_THREAD, "frames_per_chunk": 1000}
    return 1e3 * cpu_ms(lambda: list(sk.refine_batches(many, rig, **given)), repeat) / len(many)


def speed(repeat: int) -> Iterator[Table]:
    """Measure what a pose costs, and how many a core solves."""
    costs = {
        "frame by frame, `refine`": alone_us(FRAMES, 4, 1, repeat),
        "in time, `refine_sequence` of 2000 frames": in_time_us(FRAMES, 4, 1, repeat),
        "the same of 16,000 frames": in_time_us(16_000, 4, 1, repeat),
        "the same in chunks of 1000, `refine_batches`": chunks_us(16_000, repeat),
        "live, `Refiner(fps=…).step`": live_us(repeat),
        "4 people, `track`, per person": people_us(4, 4, repeat) / 4,
    }
    rows = {
        name: {"µs per pose": f"{us:.0f}", "poses per second and core": f"{1e6 / us:,.0f}"}
        for name, us in costs.items()
    }
    hours = people_us(4, 8, repeat) * DAY_FRAMES / 3.6e9
    note = f"a day of 8 cameras at {FPS:g} Hz with 4 people, `track`: {hours:.1f} core hours"
    yield Table.of("17 joints, 4 views", "way", rows, [note])


def growth(repeat: int) -> Iterator[Table]:
    """How the time per frame grows with frames, views, joints and people."""
    for what, costs in measured_growth(repeat).items():
        rows, first = {}, next(iter(costs.values()))
        for size, pair in costs.items():
            ways = ("alone", "in time") if len(pair) == 2 else ("in time",)
            rows[f"{size:,}"] = {
                head: cell
                for way, us, at_first in zip(ways, pair, first, strict=True)
                for head, cell in (
                    (f"µs per frame {way}", f"{us:.0f}"),
                    (f"{way}, times the first", f"{us / at_first:.2f}"),
                )
            }
        yield Table.of(f"growth with {what}", what, rows)


@functools.cache
def measured_growth(repeat: int) -> dict[str, dict[int, tuple[float, ...]]]:
    """Return µs per frame, alone and in time, by what grows and its size; of people what `track` takes."""
    both = (alone_us, in_time_us)
    sizes = {
        "frames": lambda size, cost: cost(size, 4, 1, repeat),
        "views": lambda size, cost: cost(FRAMES, size, 1, repeat),
        "joints": lambda size, cost: cost(FRAMES, 4, size // 17, repeat),
    }
    out = {
        what: {size: tuple(measure(size, cost) for cost in both) for size in SIZES[what]}
        for what, measure in sizes.items()
    }
    return out | {"people": {size: (people_us(size, 4, repeat),) for size in SIZES["people"]}}


def memory(repeat: int) -> Iterator[Table]:
    """Largest resident set of a process by frames: all at once, and in chunks."""
    del repeat
    ways = {"whole": "`refine_sequence`, MB", "chunks": "`refine_batches`, chunks of 4000"}
    ways["generator"] = "of a generator"
    rows = {}
    for frames in (10_000, 40_000, 160_000):
        rows[f"{frames:,}"] = {head: child_mib(way, frames) for way, head in ways.items()}
    rows["1,000,000"] = {ways["chunks"]: child_mib("chunks", 1_000_000)}
    yield Table.of("memory", "frames", rows, digits=0)


def child_mib(way: str, frames: int) -> float:
    """Return the largest resident set of a process that refines so many frames, MiB."""
    command = [sys.executable, __file__, "child", way, str(frames)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def child(way: str, frames: int) -> None:
    """Refine frames, and print the largest resident set in MiB."""
    rig, seen = recorded(1000)
    given = {"fps": FPS, "layout": "h36m17"}

    def chunks() -> Iterator[np.ndarray]:
        for _ in range(frames // 4000):
            yield np.tile(seen, (4, 1, 1, 1))

    if way == "whole":
        sk.refine_sequence(np.concatenate(list(chunks())), rig, **given)
    else:
        for _ in sk.refine_batches(chunks if way == "chunks" else chunks(), rig, **given):
            pass
    print(lab.peak_mib())


def refine(repeat: int, frames: int = 100_000) -> Iterator[Table]:
    """Peak memory and times of ``skelsplat refine``: one person walks, sits and waves by turns.

    A million frames need 25 GB in the folder of temporary files (``TMPDIR``).
    """
    del repeat
    rig = synthetic.human36m_like()
    with tempfile.TemporaryDirectory(prefix="skelsplat-scale-") as temporary:
        top = Path(temporary)
        write_calibration(top / "cameras.json", rig)
        source, out = written(top, frames, rig), top / "out"
        command = [sys.executable, "-m", "skelsplat", "refine", str(top / "cameras.json"), str(source)]
        command += ["-o", str(out), "--layout", "h36m17", "--fps", f"{FPS:g}", "--quiet"]
        seconds = lab.seconds(lambda: subprocess.run(command, check=True), 1)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        sizes = {path.name: path.stat().st_size / 1e6 for path in sorted(out.iterdir())}
    row = {
        "peak MB": used.ru_maxrss / 1024,
        "wall s": seconds,
        "CPU s": used.ru_utime + used.ru_stime,
        "µs per frame": 1e6 * seconds / frames,
    }
    files = "files, MB: " + ", ".join(f"{name} {size:.0f}" for name, size in sizes.items())
    yield Table.of("skelsplat refine", "frames", {f"{frames:,}": row}, [files], digits=0)


def pieces(frames: int, rig: sk.CameraRig) -> Iterator[np.ndarray]:
    """Yield the detections (≤ 4000, M, 17, 3) of a recording: each motion there and back."""
    names, done, noise = synthetic.motion_names, 0, synthetic.DetectionNoise.good()
    for k in range(-(-frames // PIECE)):
        there = synthetic.motion(names[k % len(names)], PIECE // 2, seed=k)
        poses = np.concatenate([there, there[::-1]])[: frames - done]
        yield synthetic.simulate_detections(poses, rig, noise=noise, layout="h36m17", seed=k)
        done += len(poses)


def written(folder: Path, frames: int, rig: sk.CameraRig) -> Path:
    """Write a recording piece by piece, one npz file of all cameras."""
    path, layout = folder / "detections.npz", sk.layouts.get("h36m17")
    shape = (frames, len(rig), layout.n_joints, 3)
    with zipfile.ZipFile(path, "w") as archive:
        with archive.open("detections.npy", "w", force_zip64=True) as stream:
            header = {"descr": "<f8", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_2_0(stream, header)
            for piece in pieces(frames, rig):
                stream.write(np.ascontiguousarray(piece, dtype="<f8").tobytes())
        small = {"camera_names": rig.names, "joint_names": layout.joints, "frame_rate": FPS}
        for name, value in small.items():
            with archive.open(f"{name}.npy", "w") as stream:
                np.lib.format.write_array(stream, np.asarray(value))
    return path


def picture(repeat: int) -> Iterator[Table]:
    """Draw the growth into docs/figures/scaling.png."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    costs = measured_growth(repeat)
    figure, axes = plt.subplots(1, len(costs), figsize=(11, 3), sharey=True, layout="constrained")
    for axis, (what, of_sizes) in zip(axes, costs.items(), strict=True):
        sizes = np.array(list(of_sizes))
        lines = np.array(list(of_sizes.values())).T
        labels = ["frame by frame", "in time"] if len(lines) == 2 else ["people, with track"]
        for line, label, mark in zip(lines, labels, "os" if len(lines) == 2 else "^", strict=True):
            colour = {"frame by frame": "#4477aa", "in time": "#cc6677"}.get(label, "#117733")
            axis.loglog(sizes, line, marker=mark, color=colour, label=label)
        axis.set_xticks(sizes, [f"{size:,}" for size in sizes], minor=False)
        axis.minorticks_off()
        axis.set_xlabel(what)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("CPU time per frame [µs]")
    axes[1].legend(frameon=False)
    axes[-1].legend(frameon=False)
    figure.savefig(FIGURE, dpi=150)
    yield from ()


TABLES = {table.__name__: table for table in (speed, growth, memory, refine, picture)}


def scale(
    tables: tuple[str, ...] = ("speed", "growth", "memory"), *, repeat: int = 5, frames: int = 100_000
) -> Iterator[Table]:
    """Measure each table; of so many runs the best counts. `frames` are those of `refine`."""
    for name in tables:
        yield from refine(repeat, frames) if name == "refine" else TABLES[name](repeat)


if __name__ == "__main__":
    if sys.argv[1:2] == ["child"]:
        child(sys.argv[2], int(sys.argv[3]))
    else:
        lab.main(__doc__, scale)
