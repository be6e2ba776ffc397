"""Several people: CPU time per frame of association, of live steps, and of crowds.

    python benchmarks/people_speed.py track [--frames 600] [--markdown]
    python benchmarks/people_speed.py crowds [--frames 10]

Simulated scenes (`skelsplat.synthetic.simulate_scene`), 30 Hz, 17 joints, one thread. CPU time, so that other
programs disturb little.
"""

from __future__ import annotations

import warnings
from functools import partial
from itertools import product

import lab
import numpy as np
from lab import ONE_THREAD, Table, cpu_ms

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.association import choose_person

LAYOUT, FPS = sk.layouts.H36M17, 30.0
GIVEN = {"layout": LAYOUT, "config": ONE_THREAD}
NOISE = synthetic.DetectionNoise.recording(FPS)
RADIUS_MM, HALL_MM = 4500.0, 9000.0  # of the rings of cameras
TRACKED = [(1, 4), (3, 4), (4, 5), (6, 8)]  # people, views
CROWDS = list(product(("hall", "strangers", "copies"), ((40, 4), (60, 4), (40, 8), (60, 8))))
REPEATS = 3


def live_ms(people: np.ndarray, cameras: sk.CameraRig) -> list[float]:
    """Return the time of each step of `sk.Tracker`."""
    tracker = sk.Tracker(cameras, fps=FPS, **GIVEN)
    return [cpu_ms(partial(tracker.step, frame)) for frame in people]


def track(*, frames: int = 600) -> Table:
    """Time `sk.track`, association and sequences apart, and live steps, once.

    "sequences" solves the same people with `sk.refine_sequence`, from the detections that `track` gave them;
    "association" is the difference, with the conversion of the arrays. "live" is `sk.Tracker.step`.
    """
    rows = {}
    for people, views in TRACKED:
        rig, found = synthetic.ring(views, radius_mm=RADIUS_MM), []
        here = synthetic.simulate_scene(people, rig, n_frames=frames, seed=1)
        call = partial(sk.track, here.people, here.cameras, fps=FPS, **GIVEN)
        whole = cpu_ms(lambda found=found, call=call: found.extend(call())) / frames
        solve = partial(sk.refine_sequence, cameras=here.cameras, fps=FPS, **GIVEN)
        own = [person.detections(here.people) for person in found]
        solved = cpu_ms(lambda own=own, solve=solve: [solve(seen) for seen in own]) / frames
        live = live_ms(here.people, here.cameras)
        rows[f"{people}, {views}"] = {
            "association ms": whole - solved,
            "sequences ms": solved,
            "track ms": whole,
            "live ms": float(np.mean(live)),
            "live 99 % ms": float(np.quantile(live, 0.99)),
        }
    return Table.of("several people, simulated, one thread", "people, views", rows, digits=2)


def crowds(*, frames: int = 100) -> Table:
    """Time the choice and live steps with 40 to 60 people in every image.

    "hall": people at random places; "strangers": other people in every view; "copies": one person detected
    many times.
    """
    warnings.simplefilter("ignore")  # too many people to compare: that is what is measured
    rows = {}
    for kind, (people, views) in CROWDS:
        everyone, cameras = crowd(kind, people, views, frames)
        few, live = everyone[:2], live_ms(everyone, cameras)
        chosen = cpu_ms(partial(choose_person, few, cameras, layout=LAYOUT), REPEATS) / len(few)
        times = {"choose ms": chosen, "live ms": float(np.mean(live)), "live at most ms": max(live)}
        rows[f"{kind}, {people}, {views}"] = times
    return Table.of("crowds, simulated, one thread", "crowd, people, views", rows, digits=0)


def crowd(kind: str, people: int, views: int, frames: int) -> tuple[np.ndarray, sk.CameraRig]:
    """Return detections (T, M, P, 17, 3) of a crowd, and the cameras."""
    rng, cameras = np.random.default_rng(people + views), synthetic.ring(views, radius_mm=HALL_MM)
    body = synthetic.crowd(1, frames + 1, seed=1)[0, :frames]
    body[..., :2] -= np.nanmean(body[:1, :, :2], axis=1, keepdims=True)

    def seen() -> np.ndarray:
        place = np.append(rng.uniform(-5000.0, 5000.0, 2) * (kind != "copies"), 0.0)
        return synthetic.simulate_detections(body + place, cameras, noise=NOISE, seed=rng)

    if kind == "strangers":
        shown = [[seen()[:, view] for view in range(views)] for _ in range(people)]
        return np.moveaxis(np.array(shown), (0, 1, 2), (2, 1, 0)), cameras
    return np.stack([seen() for _ in range(people)], axis=2), cameras


if __name__ == "__main__":
    lab.main(__doc__, track, crowds)
