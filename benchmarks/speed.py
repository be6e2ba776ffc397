"""Speed of the default settings, compared with their targets.

    python benchmarks/speed.py [--batch 1000] [--repeat 5] [--markdown]

Simulated detections `good` of six motions, 17 joints, triangulation included. Batches: best of repeated runs.
Single poses: median of many calls from Python, one core.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable

import lab
from lab import ONE_THREAD, Table
from scenarios import NOISES, Scene, simulated

import skelsplat as sk
from skelsplat import synthetic

# Share of the batch used for the dome, which has up to 31 views.
_DOME_SHARE = 5
_SINGLE_POSES = 300
# Warm-up calls: the first ones allocate.
_WARM_UP = 10


def batch_s(scene: Scene, threads: int, repeat: int) -> float:
    """Return the best time of refining all poses of a scene in one call, s."""
    config = sk.RefineConfig(n_threads=threads)
    return lab.seconds(
        lambda: sk.refine(None, scene.detections, scene.rig, layout="h36m17", config=config), repeat
    )


def median_us(call: Callable[[object], object], items: Iterable[object]) -> float:
    """Return the median time of ``call`` over the items after the first few, µs."""
    times = [lab.seconds(lambda item=item: call(item), 1) for item in items]
    return 1e6 * statistics.median(times[_WARM_UP:] or times)


def speed(*, batch: int = 1000, repeat: int = 5) -> Table:
    """Measure batches of so many poses, and single ones."""
    room = simulated(batch)
    one, two = (batch_s(room, threads, repeat) for threads in (1, 2))
    poses = -(-batch // _DOME_SHARE)
    dome = {m: batch_s(simulated(poses, cameras=synthetic.dome(m)), 1, repeat) for m in (4, 31)}
    rig = room.rig
    walk = synthetic.motion("walk", min(batch, _SINGLE_POSES), seed=0)
    frames = synthetic.simulate_detections(walk, rig, noise=NOISES["good"], seed=0)
    given = {"layout": "h36m17", "config": ONE_THREAD}
    single = median_us(lambda seen: sk.refine(None, seen, rig, **given), frames)
    step, live = (median_us(sk.Refiner(rig, fps=fps, **given).step, frames) for fps in (None, 30))
    rows = {
        f"batch of {batch}, 4 views, 1 core, per pose": (f"{1e6 * one / batch:.1f} µs", "≤ 50 µs"),
        "the same on 2 cores, times the throughput": (f"{one / two:.2f}", "≥ 1.8"),
        "31 views of a dome, times the time of 4": (f"{dome[31] / dome[4]:.2f}", "≤ 9"),
        "one pose, sk.refine from Python": (f"{single:.0f} µs", "≤ 150 µs"),
        "next frame, sk.Refiner.step from Python": (f"{step:.0f} µs", "≤ 80 µs"),
        "the same with fps: the past predicts": (f"{live:.0f} µs", "≤ 120 µs"),
    }
    return wanted("Default settings, 17 joints, simulated detections 'good'", rows)


def wanted(title: str, rows: dict[str, tuple[str, str]]) -> Table:
    """Return the table of figures and their targets."""
    return Table.of(
        title,
        "what",
        {name: dict(zip(("measured", "wanted"), row, strict=True)) for name, row in rows.items()},
    )


if __name__ == "__main__":
    lab.main(__doc__, speed)
