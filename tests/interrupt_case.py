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


def frame() -> np.ndarray:
    """Give one frame of detections (M, 17, 2)."""
    return sk.project(synthetic.motion("walk", 1, seed=3), RIG)[:, 0]


def views(n_views: int, n_frames: int, n_joints: int) -> tuple[np.ndarray, list[sk.Camera]]:
    """Give detections (T, M, N, 2) that agree on nothing, and the cameras."""
    cameras = [RIG[i % len(RIG)] for i in range(n_views)]
    return RANDOM.uniform(0, 1000, size=(n_frames, n_views, n_joints, 2)), cameras


def one_paper_frame() -> None:
    """Refine one frame, whose steps are the paper's."""
    sk.refine(None, frame(), RIG, layout="h36m17", config=sk.RefineConfig.paper(**ENDLESS))


def one_closed_form_frame() -> None:
    """Refine one frame, with the closed form driving Adam."""
    config = sk.RefineConfig.paper(renderer="closed_form", **ENDLESS)
    sk.Refiner(RIG, layout="h36m17", config=config).step(frame())


def one_step() -> None:
    """Take a single step of the paper's, over windows of whole images on one channel."""
    config = sk.RefineConfig.paper(encoding="single", sigma_mm=3000.0, max_steps=1)
    sk.refine(MEANS, PIXELS, [CAMERA], config=config)


def batch() -> None:
    """Refine two frames."""
    config = sk.RefineConfig.paper(**ENDLESS)
    sk.refine(None, np.array([frame()] * 2), RIG, layout="h36m17", config=config)


def sequence() -> None:
    """Refine a recording of a quarter of an hour over time, with views that agree on nothing."""
    detections, cameras = views(12, 20_000, 17)
    sk.refine_sequence(detections, cameras, fps=25.0)


def triangulate() -> None:
    """Triangulate many views, of which no two agree."""
    detections, cameras = views(200, 2000, 20)
    sk.triangulate(detections, cameras)


def render() -> None:
    """Render thousands of splats that cover the image."""
    sk.render(MEANS, WIDE, CAMERA, encoding="single")


def pseudo_ground_truth() -> None:
    """Draw as many heat maps."""
    sk.pseudo_ground_truth(PIXELS[0], MEANS, WIDE, CAMERA, encoding="single")


def loss_and_gradient() -> None:
    """Compare as many splats with their targets."""
    quaternions = np.tile([1.0, 0, 0, 0], (MANY, 1))
    config = sk.RefineConfig.paper(encoding="single")
    sk.loss_and_gradient(MEANS, np.full((MANY, 3), 8.0), quaternions, PIXELS, [CAMERA], config=config)


def one_frame_of_many_views() -> None:
    """Refine one frame by the default method; last, since its thread goes on to the frame's end."""
    detections, cameras = views(1500, 1, 300)
    sk.refine(None, detections[0], cameras)


def interrupted(work: Callable[[], None]) -> bool:
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


CASES = [
    one_paper_frame,
    one_closed_form_frame,
    one_step,
    batch,
    sequence,
    triangulate,
    render,
    pseudo_ground_truth,
    loss_and_gradient,
    one_frame_of_many_views,
]

if __name__ == "__main__":
    for case in CASES:
        if interrupted(case):
            if case is not CASES[-1]:
                idle()
            print(case.__name__, flush=True)
