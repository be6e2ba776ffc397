"""Speed of the default settings, compared with their targets.

    python benchmarks/speed.py [--batch 1000] [--repeat 5] [--markdown]

Simulated detections `good` of six motions, 17 joints, triangulation included. Batches: best of repeated runs.
Single poses: median of many calls from Python, one core.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterable

import _one_core  # noqa: F401  before numpy
import common

import skelsplat as sk
from skelsplat import synthetic

# Share of the batch used for the dome, which has up to 31 views.
_DOME_SHARE = 5
_SINGLE_POSES = 300
# Warm-up calls: the first ones allocate.
_WARM_UP = 10


def batch_s(scene: common.Scene, threads: int, repeat: int) -> float:
    """Return the best time of refining all poses of a scene in one call, s."""
    config = sk.RefineConfig(n_threads=threads)
    return common.seconds(
        lambda: sk.refine(None, scene.detections, scene.rig, layout="h36m17", config=config), repeat
    )


def median_us(call: Callable[[object], object], items: Iterable[object]) -> float:
    """Return the median time of ``call`` over the items after the first few, µs."""
    times = []
    for item in items:
        begun = time.perf_counter()
        call(item)
        times.append(time.perf_counter() - begun)
    return 1e6 * statistics.median(times[_WARM_UP:] or times)


def lines(batch: int, repeat: int) -> list[list[str]]:
    """Measure everything: what, measured, wanted."""
    room = common.simulated(batch)
    one, two = (batch_s(room, threads, repeat) for threads in (1, 2))
    dome = {
        views: batch_s(common.simulated(-(-batch // _DOME_SHARE), rig=synthetic.dome(views)), 1, repeat)
        for views in (4, 31)
    }
    rig = room.rig
    walk = synthetic.motion("walk", min(batch, _SINGLE_POSES), seed=0)
    frames = synthetic.simulate_detections(walk, rig, noise=common.NOISE["good"], seed=0)
    config = sk.RefineConfig(n_threads=1)
    refiner = sk.Refiner(rig, layout="h36m17", config=config)
    single = median_us(lambda d: sk.refine(None, d, rig, layout="h36m17", config=config), frames)
    step = median_us(refiner.step, frames)
    live = median_us(sk.Refiner(rig, layout="h36m17", fps=30, config=config).step, frames)
    return [
        [f"batch of {batch}, 4 views, 1 core, per pose", f"{1e6 * one / batch:.1f} µs", "≤ 50 µs"],
        ["the same on 2 cores, times the throughput", f"{one / two:.2f}", "≥ 1.8"],
        ["31 views of a dome, times the time of 4", f"{dome[31] / dome[4]:.2f}", "≤ 9"],
        ["one pose, sk.refine from Python", f"{single:.0f} µs", "≤ 150 µs"],
        ["next frame, sk.Refiner.step from Python", f"{step:.0f} µs", "≤ 80 µs"],
        ["the same with fps: the past predicts", f"{live:.0f} µs", "≤ 120 µs"],
    ]


def show(batch: int, repeat: int, *, markdown: bool) -> None:
    """Measure and print the table."""
    title = "Default settings, 17 joints, simulated detections 'good'"
    common.show(title, ["what", "measured", "wanted"], lines(batch, repeat), markdown=markdown)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--batch", type=int, default=1000, help="poses of a batch (1000)")
    parser.add_argument("--repeat", type=int, default=5, help="runs of which the best time counts (5)")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    options = parser.parse_args()
    show(options.batch, options.repeat, markdown=options.markdown)
    print(common.circumstances())


if __name__ == "__main__":
    main()
