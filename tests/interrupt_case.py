"""Long calls that get a Ctrl-C each: prints the name of every one that ends at once, as a KeyboardInterrupt.

Run as a script by tests/unit/test_interrupt.py. Without the interrupt each call takes half a minute or more.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable

import numpy as np

import skelsplat as sk
from skelsplat import synthetic

DELAY_S = 0.3
RIG = synthetic.human36m_like()
RANDOM = np.random.default_rng(0)

CAMERA = sk.Camera([[2e3, 0, 1e3], [0, 2e3, 1e3], [0, 0, 1]], np.eye(3), [0, 0, 3e3], size=(2000, 2000))
# Splats that cover the whole image.
MANY = 5000
MEANS = RANDOM.normal(size=(MANY, 3)) * 100.0
WIDE = np.tile(np.eye(3) * 1e7, (MANY, 1, 1))
PIXELS = sk.project(MEANS, [CAMERA])
ENDLESS = {"max_steps": 10**9, "stop_tolerance": 0.0}


FRAME = sk.project(synthetic.motion("walk", 1, seed=3), RIG)[:, 0]  # (M, 17, 2)
PAPER = sk.RefineConfig.paper(**ENDLESS)
SINGLE = {"encoding": "single"}


def views(n_views: int, n_frames: int, n_joints: int) -> tuple[np.ndarray, list[sk.Camera]]:
    """Give detections (T, M, N, 2) that agree on nothing, and the cameras."""
    cameras = [RIG[i % len(RIG)] for i in range(n_views)]
    return np.resize(RANDOM.uniform(0, 1000, 7919), (n_frames, n_views, n_joints, 2)), cameras


def one_closed_form_frame() -> None:
    """Refine one frame, with the closed form driving Adam."""
    config = sk.RefineConfig.paper(renderer="closed_form", **ENDLESS)
    sk.Refiner(RIG, layout="h36m17", config=config).step(FRAME)


def one_step() -> None:
    """Take a single step of the paper's, over windows of whole images on one channel."""
    config = sk.RefineConfig.paper(sigma_mm=3000.0, max_steps=1, **SINGLE)
    sk.refine(MEANS, PIXELS, [CAMERA], config=config)


def loss_and_gradient() -> None:
    """Compare thousands of splats that cover the image with their targets."""
    quaternions = np.tile([1.0, 0, 0, 0], (MANY, 1))
    config = sk.RefineConfig.paper(**SINGLE)
    sk.loss_and_gradient(MEANS, np.full((MANY, 3), 8.0), quaternions, PIXELS, [CAMERA], config=config)


def one_frame_of_many_views() -> None:
    """Refine one frame by the default method; last, since its thread goes on to the frame's end."""
    detections, cameras = views(1500, 1, 300)
    sk.refine(None, detections[0], cameras)


CASES: dict[str, Callable[[], object]] = {
    "one_paper_frame": lambda: sk.refine(None, FRAME, RIG, layout="h36m17", config=PAPER),
    "one_closed_form_frame": one_closed_form_frame,
    "one_step": one_step,
    "batch": lambda: sk.refine(None, np.array([FRAME] * 2), RIG, layout="h36m17", config=PAPER),
    "sequence": lambda: sk.refine_sequence(*views(12, 20_000, 17), fps=25.0),
    "triangulate": lambda: sk.triangulate(*views(200, 2000, 20)),
    "render": lambda: sk.render(MEANS, WIDE, CAMERA, **SINGLE),
    "pseudo_ground_truth": lambda: sk.pseudo_ground_truth(PIXELS[0], MEANS, WIDE, CAMERA, **SINGLE),
    "loss_and_gradient": loss_and_gradient,
    "one_frame_of_many_views": one_frame_of_many_views,
}


def interrupted(work: Callable[[], object]) -> bool:
    """Say whether Ctrl-C ends ``work`` as it should."""
    timer = threading.Timer(DELAY_S, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        work()
    except KeyboardInterrupt:
        return True
    finally:
        timer.join()
    return False


def idle() -> None:
    """Wait until the threads of an interrupted call have ended: nothing computes."""
    while True:
        before = time.process_time()
        time.sleep(0.1)
        if time.process_time() - before < 1e-3:
            return


if __name__ == "__main__":
    for name, case in CASES.items():
        if interrupted(case):
            if case is not one_frame_of_many_views:
                idle()
            print(name, flush=True)
