"""Several people: CPU time per frame of association, of everything with sequences, and of a live step.

    python benchmarks/people_speed.py [--frames 600] [--markdown]

Simulated scenes (`skelsplat.synthetic.simulate_scene`), 30 Hz, 17 joints, one thread. "track" is `sk.track`;
"sequences" solves the same people with `sk.refine_sequence`, from the detections that `track` gave them;
"association" is the difference, with the conversion of the arrays. "live" is `sk.Tracker.step`: mean and the
99th percentile. CPU time, so that other programs disturb little; the numbers are of one run.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import _one_core  # noqa: F401  before numpy
import common
import numpy as np

import skelsplat as sk
from skelsplat import synthetic

CONFIG = sk.RefineConfig(n_threads=1)
CONDITIONS = [(1, 4), (3, 4), (4, 5), (6, 8)]  # people, views
COLUMNS = ["people, views", "association ms", "sequences ms", "track ms", "live ms", "live 99 % ms"]


def milliseconds(work: Callable[[], object]) -> float:
    """CPU time of a call."""
    begin = time.process_time()
    work()
    return 1e3 * (time.process_time() - begin)


def measured(people: int, views: int, frames: int) -> list[float]:
    """Return the times per frame of a scene, in the order of the columns."""
    scene = synthetic.simulate_scene(people, synthetic.ring(views, radius_mm=4500.0), n_frames=frames, seed=1)
    found: list[sk.Person] = []
    options = {"fps": scene.fps, "layout": scene.layout, "config": CONFIG}
    track = milliseconds(lambda: found.extend(sk.track(scene.people, scene.cameras, **options)))
    detections = [person.detections(scene.people) for person in found]
    sequences = milliseconds(
        lambda: [sk.refine_sequence(own, scene.cameras, **options) for own in detections]
    )
    tracker = sk.Tracker(scene.cameras, **options)
    live = [milliseconds(lambda frame=frame: tracker.step(frame)) for frame in scene.people]
    per_frame = [(track - sequences) / frames, sequences / frames, track / frames]
    return [*per_frame, float(np.mean(live)), float(np.quantile(live, 0.99))]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=600, help="of a scene (600)")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    chosen = parser.parse_args()
    rows = [
        [f"{people}, {views}", *(f"{ms:.2f}" for ms in measured(people, views, chosen.frames))]
        for people, views in CONDITIONS
    ]
    common.show("several people, simulated, one thread", COLUMNS, rows, markdown=chosen.markdown)


if __name__ == "__main__":
    main()
