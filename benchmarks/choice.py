"""Choosing one person among several: CPU time per frame next to refining, and with 40 to 60 people per image.

    python benchmarks/choice.py [--frames 100] [--markdown] [--crowds]

One thread, 17 joints, 30 Hz. "choose" is `skelsplat.association.choose_person`; "refine" are
`sk.refine_sequence` and `sk.refine` of the person it chose, in scenes of `synthetic.simulate_scene`.
In a crowd everybody is visible in every image: "hall", people at random places; "strangers", other people in
every view; "copies", one person detected many times. "live" is `sk.Tracker.step`, on average and at most. CPU
time; that of "choose" and "refine" is the least of three.
"""

from __future__ import annotations

import warnings
from itertools import product

import lab
import numpy as np
from lab import ONE_THREAD, Table, cpu_ms

import skelsplat as sk
from skelsplat import synthetic
from skelsplat._people import padded
from skelsplat.association import choose_person

LAYOUT, NOISE = sk.layouts.H36M17, synthetic.DetectionNoise.recording(30.0)
SCENES = list(product((1, 2, 3, 6), (4, 6, 8)))  # people, views
CROWDS = list(product(("hall", "strangers", "copies"), ((40, 4), (60, 4), (40, 8), (60, 8))))
REPEATS = 3


def compared(people: int, views: int, frames: int) -> dict[str, float]:
    """Return the times per frame of a choice, a sequence and single frames."""
    scene = synthetic.simulate_scene(people, synthetic.ring(views, radius_mm=4500.0), n_frames=frames, seed=1)
    everyone, cameras = np.asarray(padded(scene.people)), scene.cameras
    chosen, _ = choose_person(everyone, cameras, layout=LAYOUT)
    given = {"layout": LAYOUT, "config": ONE_THREAD}
    works = {
        "choose ms": lambda: choose_person(everyone, cameras, layout=LAYOUT),
        "refine_sequence ms": lambda: sk.refine_sequence(chosen, cameras, fps=scene.fps, **given),
        "refine ms": lambda: sk.refine(None, chosen, cameras, **given),
    }
    return {name: cpu_ms(work, REPEATS) / frames for name, work in works.items()}


def crowd(kind: str, people: int, views: int, frames: int) -> tuple[np.ndarray, sk.CameraRig]:
    """Return detections (T, M, P, 17, 3) of a crowd, and the cameras."""
    rng, cameras = np.random.default_rng(people + views), synthetic.ring(views, radius_mm=9000.0)
    body = synthetic.crowd(1, frames + 1, seed=1)[0, :frames]
    body[..., :2] -= np.nanmean(body[:1, :, :2], axis=1, keepdims=True)

    def seen() -> np.ndarray:
        place = np.append(rng.uniform(-5000.0, 5000.0, 2) * (kind != "copies"), 0.0)
        return synthetic.simulate_detections(body + place, cameras, noise=NOISE, seed=rng)

    if kind == "strangers":
        shown = [[seen()[:, view] for view in range(views)] for _ in range(people)]
        return np.moveaxis(np.array(shown), (0, 1, 2), (2, 1, 0)), cameras
    return np.stack([seen() for _ in range(people)], axis=2), cameras


def crowded(kind: str, people: int, views: int, frames: int) -> dict[str, float]:
    """Return the times per frame of a choice, and of live steps on average and at most."""
    everyone, cameras = crowd(kind, people, views, frames)
    tracker = sk.Tracker(cameras, layout=LAYOUT, fps=30.0, config=ONE_THREAD)
    few = everyone[:2]
    choose = cpu_ms(lambda: choose_person(few, cameras, layout=LAYOUT), REPEATS) / len(few)
    live = [cpu_ms(lambda frame=frame: tracker.step(frame)) for frame in everyone]
    return {"choose ms": choose, "live ms": float(np.mean(live)), "live at most ms": max(live)}


def choice(*, frames: int = 100, crowds: bool = False) -> Table:
    """Measure scenes of so many frames; `crowds`: of 40 to 60 people in every image."""
    warnings.simplefilter("ignore")  # too many people to compare: that is what is measured
    title = "the choice of a person, simulated, one thread"
    if crowds:
        rows = {f"{kind}, {p}, {v}": crowded(kind, p, v, frames) for kind, (p, v) in CROWDS}
        return Table.of(title, "crowd, people, views", rows, digits=0)
    rows = {f"{p}, {v}": compared(p, v, frames) for p, v in SCENES}
    return Table.of(title, "people, views", rows, digits=2)


if __name__ == "__main__":
    lab.main(__doc__, choice)
