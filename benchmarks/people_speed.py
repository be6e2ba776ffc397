"""Several people: CPU time per frame of association, of everything with sequences, and of a live step.

    python benchmarks/people_speed.py [--frames 600] [--markdown]

Simulated scenes (`skelsplat.synthetic.simulate_scene`), 30 Hz, 17 joints, one thread. "track" is `sk.track`;
"sequences" solves the same people with `sk.refine_sequence`, from the detections that `track` gave them;
"association" is the difference, with the conversion of the arrays. "live" is `sk.Tracker.step`: mean and the
99th percentile. CPU time, so that other programs disturb little; the numbers are of one run.
"""

from __future__ import annotations

import lab
import numpy as np
from lab import ONE_THREAD, Table, cpu_ms

import skelsplat as sk
from skelsplat import synthetic

CONDITIONS = [(1, 4), (3, 4), (4, 5), (6, 8)]  # people, views


def measured(people: int, views: int, frames: int) -> dict[str, float]:
    """Return the times per frame of a scene."""
    scene = synthetic.simulate_scene(people, synthetic.ring(views, radius_mm=4500.0), n_frames=frames, seed=1)
    found: list[sk.Person] = []
    options = {"fps": scene.fps, "layout": scene.layout, "config": ONE_THREAD}
    track = cpu_ms(lambda: found.extend(sk.track(scene.people, scene.cameras, **options))) / frames
    own = [person.detections(scene.people) for person in found]
    sequences = cpu_ms(lambda: [sk.refine_sequence(seen, scene.cameras, **options) for seen in own]) / frames
    tracker = sk.Tracker(scene.cameras, **options)
    live = [cpu_ms(lambda frame=frame: tracker.step(frame)) for frame in scene.people]
    times = {"association ms": track - sequences, "sequences ms": sequences, "track ms": track}
    return times | {"live ms": float(np.mean(live)), "live 99 % ms": float(np.quantile(live, 0.99))}


def people_speed(*, frames: int = 600) -> Table:
    """Measure every condition, on scenes of so many frames."""
    rows = {f"{people}, {views}": measured(people, views, frames) for people, views in CONDITIONS}
    return Table.of("several people, simulated, one thread", "people, views", rows, digits=2)


if __name__ == "__main__":
    lab.main(__doc__, people_speed)
