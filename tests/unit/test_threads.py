"""Compiled calls, however short, let other threads of Python run."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

import skelsplat as sk
from skelsplat import _skelsplat, synthetic

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
