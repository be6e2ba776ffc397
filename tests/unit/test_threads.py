"""Threads and processes: compiled calls let others run, eight at once and children compute what one does.

Threads do not survive a fork: a child that waited for the parent's would wait for ever.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import skelsplat as sk
from array_forms import bits
from skelsplat import _skelsplat, synthetic
from skelsplat.findings import collected_warnings

RIG = synthetic.human36m_like()
FRAME = sk.project(synthetic.motion("walk", 1, seed=3), RIG)[:, 0]
REFINER = _skelsplat.Refiner(RIG, layout="h36m17")

# With the few numbers of one frame: on many NumPy, which prepares them, lets others run as well.
CALLS: dict[str, Callable[[], object]] = {
    "triangulate": lambda: _skelsplat.triangulate(FRAME, RIG),
    "refine": lambda: REFINER.refine(None, FRAME),
    "step": lambda: sk.Refiner(RIG, layout="h36m17").step(FRAME),
}


@pytest.fixture
def ticks() -> Iterator[list[int]]:
    """Count in another thread, which gives way after every count; nobody else is made to give way."""
    counted, done = [0], threading.Event()

    def count() -> None:
        while not done.is_set():
            counted[0] += 1
            time.sleep(0)

    interval = sys.getswitchinterval()
    thread = threading.Thread(target=count)
    sys.setswitchinterval(1e3)
    thread.start()
    yield counted
    done.set()
    sys.setswitchinterval(interval)
    thread.join()


@pytest.mark.parametrize("name", CALLS)
def test_other_threads_go_on(name: str, ticks: list[int]) -> None:
    """A short call may be over before the other thread wakes up, but not a thousand of them."""
    for _ in range(1000):
        before = ticks[0]
        CALLS[name]()
        if ticks[0] > before:
            return
    pytest.fail("no other thread ran during any call")


THREADS = 8
SCENE = synthetic.simulate_scene(2, synthetic.ring(4, radius_mm=4500.0), n_frames=20, fps=30.0, seed=1)
WALK = sk.project(synthetic.motion("walk", 12, seed=3), RIG).swapaxes(0, 1)


def own_steps() -> list[sk.Refinement]:
    live = sk.Refiner(RIG, layout="h36m17", fps=50.0)
    return [live.step(frame) for frame in WALK]


def crowd_steps() -> list[object]:
    tracker = sk.Tracker(SCENE.cameras, fps=30.0, layout=SCENE.layout)
    return [list(tracker.step(frame)) for frame in SCENE.people]


AT_ONCE: dict[str, Callable[[], object]] = {
    "refine": lambda: sk.refine(None, WALK, RIG, layout="h36m17"),
    "one frame": lambda: list(REFINER.refine(None, FRAME).values()),
    "paper": lambda: sk.refine(
        None, WALK[:2], RIG, layout="h36m17", config=sk.RefineConfig.paper(max_steps=3)
    ),
    "sequence": lambda: sk.refine_sequence(WALK, RIG, fps=50.0, layout="h36m17"),
    "step": own_steps,
    "track": lambda: sk.track(SCENE.people, SCENE.cameras, fps=30.0, layout=SCENE.layout),
    "tracker": crowd_steps,
}


def at_once(work: Callable[[], object]) -> list[object]:
    """Return what each of the threads computes, all beginning together."""
    ready = threading.Barrier(THREADS)

    def begin(_: int) -> object:
        ready.wait()
        return work()

    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(begin, range(THREADS)))


@pytest.mark.parametrize("name", AT_ONCE)
def test_eight_threads_at_once_compute_what_one_does(name: str) -> None:
    alone = bits(AT_ONCE[name]())
    assert [bits(result) for result in at_once(AT_ONCE[name])] == [alone] * THREADS


def test_each_thread_collects_its_own_warnings() -> None:
    def work() -> tuple[str, list[object]]:
        name = threading.current_thread().name
        with collected_warnings() as found:
            for _ in range(20):
                time.sleep(0)
                warnings.warn(name, stacklevel=1)
        return name, [finding.numbers["text"] for finding in found]

    assert all(found == [name] for name, found in at_once(work))


POSIX = pytest.mark.skipif(os.name != "posix", reason="fork is of POSIX")

PROGRAM = Path(__file__).parents[1] / "process_case.py"
LIMIT_S = 60.0  # the slowest takes three seconds


def outcome(name):
    """Return what the program printed; one that hangs is ended with all of its workers."""
    # Python 3.12 and later warn of every fork of a process that has threads.
    command = [sys.executable, "-W", "ignore::DeprecationWarning", str(PROGRAM), name]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, start_new_session=True, **pipes) as program:
        try:
            out, err = program.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(program.pid, signal.SIGKILL)
            return "hangs"
    return out.strip() or err


@POSIX
@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
def test_a_pool_of_workers_after_a_batch(method):
    assert outcome(method) == "same"


@POSIX
def test_a_fork_after_one_frame_of_the_papers_method():
    assert outcome("after_one_frame") == "same"


@POSIX
def test_workers_of_a_data_loader_beside_busy_threads():
    assert outcome("epochs") == "same same same"
