"""What poses cost: per core, by frames, views, people and joints, where the time goes, and memory.

    python benchmarks/scale.py                           all tables, about ten minutes
    python benchmarks/scale.py speed growth --markdown   some of them: speed, growth, day, stages, memory
    python benchmarks/scale.py growth picture            draws the growth too: docs/figures/scaling.png

Simulated recordings (`synthetic.motion`, errors that last), seen by a ring of cameras, 17 joints in 4 views
where nothing else is said. CPU time of one thread, the best of several runs: other programs disturb it
little, but they share caches and clock rates. Memory is the largest resident set of a process of its own.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import _one_core  # noqa: F401  before numpy
import common
import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import write_calibration
from skelsplat.run import Job, _run, figures, folder, run

ONE = sk.RefineConfig(n_threads=1)
FPS = 100.0
FRAMES = 2000
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
# What `skelsplat.run.run` calls, by stage; what is left of the last is writing poses and the report.
STAGES = {
    "reading": (_run, "read_inputs"),
    "solving": (_run, "refine_inputs"),
    "judging": (_run, "summed_up"),
    "pictures": (figures, "write_figures"),
    "html": (folder, "write_html"),
    "poses": (folder, "write_folder"),
}
Rows = list[list[str]]


def recorded(frames: int = FRAMES, views: int = 4, bodies: int = 1) -> tuple[sk.CameraRig, np.ndarray]:
    """Return a ring of cameras, and detections (T, M, 17 bodies, 3) of a walk, once per body."""
    rig, noise = synthetic.ring(views), synthetic.DetectionNoise.recording(FPS)
    pose = synthetic.motion("walk", frames, fps=FPS, seed=1)
    seen = [synthetic.simulate_detections(pose, rig, noise=noise, seed=k) for k in range(bodies)]
    return rig, np.concatenate(seen, axis=2)


def cpu_s(call: Callable[[], object], repeat: int) -> float:
    """Return the least CPU time of some runs."""
    times = []
    for _ in range(repeat):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return min(times)


def alone_us(frames: int, views: int, bodies: int, repeat: int) -> float:
    """CPU time per frame of ``refine``, µs."""
    rig, seen = recorded(frames, views, bodies)
    layout = "h36m17" if bodies == 1 else None
    return 1e6 * cpu_s(lambda: sk.refine(None, seen, rig, layout=layout, config=ONE), repeat) / frames


def in_time_us(frames: int, views: int, bodies: int, repeat: int) -> float:
    """CPU time per frame of ``refine_sequence``, µs."""
    rig, seen = recorded(frames, views, bodies)
    given = {"fps": FPS, "layout": "h36m17" if bodies == 1 else None, "config": ONE}
    return 1e6 * cpu_s(lambda: sk.refine_sequence(seen, rig, **given), repeat) / frames


def people_us(people: int, views: int, repeat: int) -> float:
    """CPU time per frame of ``track``, which finds out who is who and solves everybody in time, µs."""
    rig = synthetic.ring(views, radius_mm=4500.0)
    scene = synthetic.simulate_scene(people, rig, n_frames=PEOPLE_FRAMES, fps=FPS, seed=1)
    given = {"fps": FPS, "layout": scene.layout, "config": ONE}
    return 1e6 * cpu_s(lambda: sk.track(scene.people, scene.cameras, **given), repeat) / PEOPLE_FRAMES


def live_us(repeat: int) -> float:
    """CPU time of ``Refiner.step`` with ``fps``, µs."""
    rig, seen = recorded()

    def loop() -> None:
        refiner = sk.Refiner(rig, layout="h36m17", fps=FPS, config=ONE)
        for frame in seen:
            refiner.step(frame)

    return 1e6 * cpu_s(loop, repeat) / len(seen)


def chunks_us(frames: int, repeat: int) -> float:
    """CPU time per frame of ``refine_batches`` with ``fps``, µs."""
    rig, many = recorded(frames)
    given = {"fps": FPS, "layout": "h36m17", "config": ONE, "frames_per_chunk": 1000}

    def loop() -> None:
        for _ in sk.refine_batches(many, rig, **given):
            pass

    return 1e6 * cpu_s(loop, repeat) / len(many)


def speed(repeat: int) -> Iterator[tuple[str, list[str], Rows]]:
    """Measure what a pose costs, and how many a core solves."""
    costs = {
        "frame by frame, `refine`": alone_us(FRAMES, 4, 1, repeat),
        "in time, `refine_sequence` of 2000 frames": in_time_us(FRAMES, 4, 1, repeat),
        "the same of 16,000 frames": in_time_us(16_000, 4, 1, repeat),
        "the same in chunks of 1000, `refine_batches`": chunks_us(16_000, repeat),
        "live, `Refiner(fps=…).step`": live_us(repeat),
        "4 people, `track`, per person": people_us(4, 4, repeat) / 4,
    }
    rows = [[name, f"{us:.0f}", f"{1e6 / us:,.0f}"] for name, us in costs.items()]
    yield "17 joints, 4 views", ["", "µs per pose", "poses per second and core"], rows


def growth(repeat: int) -> Iterator[tuple[str, list[str], Rows]]:
    """How the time per frame grows with frames, views, joints and people."""
    for what, costs in measured_growth(repeat).items():
        columns = [what, "µs per frame alone", "times the first", "µs per frame in time", "times the first"]
        rows = []
        for size, pair in costs.items():
            first = next(iter(costs.values()))
            cells = [[f"{us:.0f}", f"{us / of_first:.2f}"] for us, of_first in zip(pair, first, strict=True)]
            rows.append([f"{size:,}", *(cells[0] if what != "people" else ["–", "–"]), *cells[-1]])
        yield f"growth with {what}", columns, rows


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


def day(repeat: int) -> Iterator[tuple[str, list[str], Rows]]:
    """Compute what a day of 8 cameras at 100 Hz with 4 people costs, from one minute's share of it."""
    us = people_us(4, 8, repeat)
    hours = us * DAY_FRAMES / 3.6e9
    rig, seen = recorded(100, 8)
    result = sk.refine_sequence(seen, rig, fps=FPS, layout="h36m17")
    names = [name for name in result.__dataclass_fields__ if name not in ("joint_bias", "loss_history")]
    size = sum(getattr(result, name).nbytes for name in names if getattr(result, name).shape[:1] == (100,))
    poses = 4 * DAY_FRAMES
    rows = [
        ["frames", f"{DAY_FRAMES:,.0f}"],
        ["poses", f"{poses:,.0f}"],
        ["measured: µs per frame of 4 people in 8 views, `track`", f"{us:.0f}"],
        ["core hours", f"{hours:.1f}"],
        ["cores to keep up with the recording", f"{hours / 24:.2f}"],
        ["detections in, float32", f"{8 * 17 * 3 * 4 * poses / 1e9:.0f} GB"],
        ["poses out, float32", f"{17 * 3 * 4 * poses / 1e9:.0f} GB"],
        ["all fields out", f"{size / 100 * poses / 1e9:.0f} GB"],
    ]
    yield "a day, computed from measured seconds", ["", ""], rows


def stages(repeat: int) -> Iterator[tuple[str, list[str], Rows]]:
    """CPU time per frame of the stages of ``skelsplat refine --fps``, by the kind of files."""
    rig, seen = recorded()
    columns = ["files", *(f"{name} µs" for name in STAGES), "solving, share"]
    rows = []
    with tempfile.TemporaryDirectory() as place:
        write_calibration(Path(place) / "cameras.json", rig)
        for kind, write in {"one npz": one_npz, "OpenPose, a file per frame": openpose}.items():
            detections = write(Path(place) / kind.split(",")[0], rig, seen)
            job = Job(
                Path(place) / "cameras.json",
                detections,
                layout="h36m17",
                fps=FPS,
                config=ONE,
                output=Path(place) / "out",
                write=("npz", "csv", "trc"),
            )
            best = [min(times) for times in zip(*(timed(job) for _ in range(repeat)), strict=True)]
            best[-1] -= sum(best[-3:-1])
            per_frame = [1e6 * cost / len(seen) for cost in best]
            rows.append([kind, *(f"{us:.0f}" for us in per_frame), f"{best[1] / sum(best):.0%}"])
    yield f"stages of a run of {len(seen)} frames", columns, rows


def timed(job: Job) -> list[float]:
    """Return the CPU time of every stage of a job."""
    times = dict.fromkeys(STAGES, 0.0)

    def of(stage: str, call: Callable[..., object]) -> Callable[..., object]:
        def measured(*args: object, **given: object) -> object:
            begin = time.process_time()
            try:
                return call(*args, **given)
            finally:
                times[stage] += time.process_time() - begin

        return measured

    with contextlib.ExitStack() as stack:
        for stage, (module, name) in STAGES.items():
            stack.enter_context(mock.patch.object(module, name, of(stage, getattr(module, name))))
        run(job)
    return list(times.values())


def one_npz(path: Path, rig: sk.CameraRig, seen: np.ndarray) -> Path:
    """Write detections of one person as one array."""
    path.mkdir()
    np.savez(path / "own.npz", detections=seen[:, :, None], camera_names=rig.names)
    return path / "own.npz"


def openpose(path: Path, rig: sk.CameraRig, seen: np.ndarray) -> Path:
    """Write detections of one person as OpenPose does: a folder per camera, a JSON file per frame."""
    for name, frames in zip(rig.names, seen.transpose(1, 0, 2, 3), strict=True):
        (path / name).mkdir(parents=True)
        for t, points in enumerate(np.nan_to_num(frames)):
            person = {"pose_keypoints_2d": points.round(3).ravel().tolist()}
            text = json.dumps({"version": 1.3, "people": [person]})
            (path / name / f"{name}_{t:012d}_keypoints.json").write_text(text, encoding="utf-8")
    return path


def memory(repeat: int) -> Iterator[tuple[str, list[str], Rows]]:
    """Largest resident set of a process by frames: all at once, and in chunks."""
    del repeat
    rows = []
    for frames in (10_000, 40_000, 160_000):
        cells = [f"{child_mb(way, frames):.0f}" for way in ("whole", "chunks", "generator")]
        rows.append([f"{frames:,}", *cells])
    rows.append(["1,000,000", "–", f"{child_mb('chunks', 1_000_000):.0f}", "–"])
    columns = ["frames", "`refine_sequence`, MB", "`refine_batches`, chunks of 4000", "of a generator"]
    yield "memory", columns, rows


def child_mb(way: str, frames: int) -> float:
    """Return the largest resident set of a process that refines so many frames, MB."""
    command = [sys.executable, __file__, "child", way, str(frames)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def child(way: str, frames: int) -> None:
    """Refine frames, and print the largest resident set in MB."""
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
    # not the resource usage, which begins with that of the parent
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    print(next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024)


def picture(repeat: int) -> Iterator[tuple[str, list[str], Rows]]:
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


TABLES = {table.__name__: table for table in (speed, growth, day, stages, memory)}


def main() -> None:
    """Print the tables."""
    if sys.argv[1:2] == ["child"]:
        child(sys.argv[2], int(sys.argv[3]))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("tables", nargs="*", default=list(TABLES), help=", ".join([*TABLES, "picture"]))
    parser.add_argument("--repeat", type=int, default=5, help="runs, of which the best counts (5)")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    chosen = parser.parse_args()
    print(common.circumstances(), end="\n\n")
    for name in chosen.tables:
        for title, columns, rows in {**TABLES, "picture": picture}[name](chosen.repeat):
            common.show(title, columns, rows, markdown=chosen.markdown)
            sys.stdout.flush()


if __name__ == "__main__":
    main()
