"""Programs that start processes: ``python process_case.py NAME`` prints what came of one.

Run as scripts by tests/unit/test_threads.py, since what they try may hang, and since spawned workers import
their main module.
"""

from __future__ import annotations

import multiprocessing
import sys
import threading

import numpy as np

import skelsplat as sk
from skelsplat import synthetic

RIG = synthetic.human36m_like()
FRAMES = 8
# Wide splats: one pose is then large enough for its windows to be shared among threads.
PAPER = sk.RefineConfig.paper(sigma_mm=60.0, max_steps=3)


def detections(seed: int) -> np.ndarray:
    """Give detections (T, M, 17, 2) of a walk, with noise."""
    exact = sk.project(synthetic.motion("walk", FRAMES, seed=3), RIG).swapaxes(0, 1)
    return exact + np.random.default_rng(seed).normal(size=exact.shape)


# Made before any thread: what Python imports while a process forks stays locked in the child.
SEEN = [detections(seed) for seed in range(4)]


def work(seed: int) -> bytes:
    """Make every compiled call that uses threads: a batch, one of the paper's frames, a triangulation."""
    seen = SEEN[seed]
    poses = [
        sk.refine(None, seen, RIG, layout="h36m17").pose,
        sk.refine(None, seen[0], RIG, layout="h36m17", config=PAPER).pose,
        sk.refine(None, seen[:2], RIG, layout="h36m17", config=PAPER).pose,
        sk.triangulate(seen, RIG),
    ]
    return b"".join(pose.tobytes() for pose in poses)


def same(found: list[bytes]) -> str:
    """Say whether the children found what this process finds."""
    return "same" if found == [work(seed) for seed in range(len(found))] else "different"


def pool(method: str) -> str:
    """Use a pool of workers, started after this process has used its threads."""
    work(0)
    with multiprocessing.get_context(method).Pool(2) as workers:
        return same(workers.map(work, range(3)))


def after_one_frame() -> str:
    """Do the same where all that came before was one frame of the paper's method."""
    sk.refine(None, SEEN[0][0], RIG, layout="h36m17", config=PAPER)
    with multiprocessing.get_context("fork").Pool(2) as workers:
        return same(workers.map(work, range(2)))


def load(seed: int, out: multiprocessing.Queue) -> None:
    """Do the work of a data loader's worker."""
    out.put((seed, work(seed)))


def epochs() -> str:
    """Start workers as a data loader does: epoch after epoch, while another thread of the parent refines."""
    work(0)
    context, done = multiprocessing.get_context("fork"), threading.Event()

    def busy() -> None:
        while not done.is_set():
            work(0)

    other = threading.Thread(target=busy)
    other.start()
    said = []
    try:
        for _ in range(3):
            out = context.Queue()
            workers = [context.Process(target=load, args=(k, out)) for k in range(2)]
            for worker in workers:
                worker.start()
            found = dict(out.get() for _ in workers)
            for worker in workers:
                worker.join()
            said.append(same([found[seed] for seed in range(2)]))
    finally:
        done.set()
        other.join()
    return " ".join(said)


CASES = {
    **{method: lambda method=method: pool(method) for method in ("fork", "forkserver", "spawn")},
    "after_one_frame": after_one_frame,
    "epochs": epochs,
}

if __name__ == "__main__":
    print(CASES[sys.argv[1]](), flush=True)
