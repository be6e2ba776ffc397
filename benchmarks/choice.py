"""Choosing one person among several: CPU time per frame next to refining, and with 40 to 60 people per image.

    python benchmarks/choice.py [--frames 100] [--markdown] [--crowds]

One thread, 17 joints, 30 Hz. "choose" is `skelsplat.association.choose_person`; "refine" are
`sk.refine_sequence` and `sk.refine` of the person it chose, in scenes of `synthetic.simulate_scene`.
In a crowd everybody is visible in every image: "hall", people at random places; "strangers", other people in
every view; "copies", one person detected many times. "live" is `sk.Tracker.step`, on average and at most. CPU
time; that of "choose" and "refine" is the least of three.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from itertools import product

import _one_core  # noqa: F401  before numpy
import common
import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from skelsplat._people import padded
from skelsplat.association import choose_person

CONFIG = sk.RefineConfig(n_threads=1)
LAYOUT, NOISE = sk.layouts.H36M17, synthetic.DetectionNoise.recording(30.0)
SCENES = list(product((1, 2, 3, 6), (4, 6, 8)))  # people, views
CROWDS = list(product(("hall", "strangers", "copies"), ((40, 4), (60, 4), (40, 8), (60, 8))))


def milliseconds(work: Callable[[], object], times: int = 3) -> float:
    """CPU time of a call, the least of some."""

    def once() -> float:
        begin = time.process_time()
        work()
        return 1e3 * (time.process_time() - begin)

    return min(once() for _ in range(times))


def compared(people: int, views: int, frames: int) -> list[float]:
    """Return the times per frame of a choice, a sequence and single frames."""
    scene = synthetic.simulate_scene(people, synthetic.ring(views, radius_mm=4500.0), n_frames=frames, seed=1)
    everyone, cameras = np.asarray(padded(scene.people)), scene.cameras
    chosen, _ = choose_person(everyone, cameras, layout=LAYOUT)
    works = (
        lambda: choose_person(everyone, cameras, layout=LAYOUT),
        lambda: sk.refine_sequence(chosen, cameras, fps=scene.fps, layout=LAYOUT, config=CONFIG),
        lambda: sk.refine(None, chosen, cameras, layout=LAYOUT, config=CONFIG),
    )
    return [milliseconds(work) / frames for work in works]


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


def crowded(kind: str, people: int, views: int, frames: int) -> list[float]:
    """Return the times per frame of a choice, and of live steps on average and at most."""
    everyone, cameras = crowd(kind, people, views, frames)
    tracker = sk.Tracker(cameras, layout=LAYOUT, fps=30.0, config=CONFIG)
    few = everyone[:2]
    choose = milliseconds(lambda: choose_person(few, cameras, layout=LAYOUT)) / len(few)
    live = [milliseconds(lambda frame=frame: tracker.step(frame), 1) for frame in everyone]
    return [choose, float(np.mean(live)), max(live)]


def main() -> None:
    """Print one of the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=100, help="of a scene (100)")
    parser.add_argument("--crowds", action="store_true", help="40 to 60 people in every image instead")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")  # too many people to compare: that is what is measured
    if chosen.crowds:
        columns = ["crowd", "people, views", "choose ms", "live ms", "live at most ms"]
        rows = [
            [kind, f"{size[0]}, {size[1]}", *(f"{ms:.0f}" for ms in crowded(kind, *size, chosen.frames))]
            for kind, size in CROWDS
        ]
    else:
        columns = ["people, views", "choose ms", "refine_sequence ms", "refine ms"]
        rows = [[f"{p}, {v}", *(f"{ms:.2f}" for ms in compared(p, v, chosen.frames))] for p, v in SCENES]
    common.show("the choice of a person, simulated, one thread", columns, rows, markdown=chosen.markdown)


if __name__ == "__main__":
    main()
