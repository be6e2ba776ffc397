"""Forks, Ctrl-C, and excessive numbers and image sizes."""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable

import numpy as np

import skelsplat as sk
from attacks import attack
from skelsplat import synthetic

_PATIENCE_S = 20.0
_DELAY_S = 0.5
_RIG = synthetic.human36m_like()
_PAPER = sk.RefineConfig.paper(sigma_mm=60.0, max_steps=3)


def _detections(n_frames: int) -> np.ndarray:
    return sk.project(synthetic.motion("walk", n_frames, seed=3), _RIG).swapaxes(0, 1)


def _batch() -> bytes:
    return sk.refine(None, _detections(8), _RIG, layout="h36m17").pose.tobytes()


def _paper_frame() -> bytes:
    return sk.refine(None, _detections(8)[0], _RIG, layout="h36m17", config=_PAPER).pose.tobytes()


def _in_child(work: Callable[[], bytes], expected: bytes) -> str:
    """Return the outcome of ``work`` in a forked child, which is ended if it hangs."""
    warnings.simplefilter("ignore", DeprecationWarning)
    child = os.fork()
    if child == 0:
        os._exit(0 if work() == expected else 1)
    end = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return "same result" if status == 0 else f"status {status}"
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return f"hangs (ended after {_PATIENCE_S:.0f} s)"


@attack("4a", "batch, then fork: a batch in the child", "same result")
def fork_after_a_batch() -> str:
    return _in_child(_batch, _batch())


@attack("4b", "one paper() frame, then fork: one in the child", "same result")
def fork_after_one_paper_frame() -> str:
    return _in_child(_paper_frame, _paper_frame())


@attack("4c", "fork while two threads run batches: a batch in the child", "same result")
def fork_beside_batches() -> str:
    expected = _batch()
    done = threading.Event()

    def busy() -> None:
        while not done.is_set():
            _batch()

    threads = [threading.Thread(target=busy) for _ in range(2)]
    for thread in threads:
        thread.start()
    time.sleep(0.1)
    try:
        return _in_child(_batch, expected)
    finally:
        done.set()
        for thread in threads:
            thread.join()


def _until_interrupted(work: Callable[[], object]) -> str:
    """Measure the seconds from SIGINT to KeyboardInterrupt."""
    warnings.simplefilter("ignore")
    sent = []

    def send() -> None:
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(_DELAY_S, send)
    timer.start()
    try:
        work()
        timer.join()
    except KeyboardInterrupt:
        return f"{time.monotonic() - sent[0]:.2f} s"
    return "ended before the signal"


# Splats that cover an image of 2000 x 2000 pixels.
_MANY = 1000
_CAMERA = sk.Camera([[2e3, 0, 1e3], [0, 2e3, 1e3], [0, 0, 1]], np.eye(3), [0, 0, 3e3], size=(2000, 2000))


def _covering() -> tuple[np.ndarray, np.ndarray]:
    means = np.random.default_rng(0).normal(size=(_MANY, 3)) * 100.0
    return means, np.tile(np.eye(3) * 1e7, (_MANY, 1, 1))


@attack("9a", "SIGINT to one paper() frame of 400,000 steps: time to KeyboardInterrupt", "< 1 s")
def interrupt_one_paper_frame() -> str:
    config = sk.RefineConfig.paper(max_steps=400_000, stop_tolerance=0.0)
    seen = _detections(1)[0]
    return _until_interrupted(lambda: sk.refine(None, seen, _RIG, layout="h36m17", config=config))


@attack("9b", "SIGINT to Refiner.step with paper(), 400,000 steps", "< 1 s")
def interrupt_paper_step() -> str:
    config = sk.RefineConfig.paper(max_steps=400_000, stop_tolerance=0.0)
    refiner = sk.Refiner(_RIG, layout="h36m17", config=config)
    seen = _detections(1)[0]
    return _until_interrupted(lambda: refiner.step(seen))


@attack("9c", "SIGINT to render of 1000 splats that cover the image", "< 1 s")
def interrupt_render() -> str:
    means, shapes = _covering()
    return _until_interrupted(lambda: sk.render(means, shapes, _CAMERA, encoding="single"))


@attack("9d", "SIGINT to triangulate of 200 views that agree on nothing", "< 1 s")
def interrupt_triangulate() -> str:
    cameras = [_RIG[i % len(_RIG)] for i in range(200)]
    seen = np.random.default_rng(0).uniform(0, 1000, size=(2000, 200, 20, 2))
    return _until_interrupted(lambda: sk.triangulate(seen, cameras))


@attack("9e", "SIGINT to loss_and_gradient over the same splats", "< 1 s")
def interrupt_loss() -> str:
    means, _ = _covering()
    seen = sk.project(means, [_CAMERA])
    config = sk.RefineConfig.paper(encoding="single")
    scales, turns = np.full((_MANY, 3), 8.0), np.tile([1.0, 0, 0, 0], (_MANY, 1))
    return _until_interrupted(
        lambda: sk.loss_and_gradient(means, scales, turns, seen, [_CAMERA], config=config)
    )


def _said(call: Callable[[], object]) -> str:
    """Return the exception (including PanicException) or the result."""
    try:
        found = call()
    except BaseException as error:
        return f"{type(error).__name__}: {error}"[:150]
    return f"accepted: {found}"[:150]


def _camera(focal: float = 1e3, size: int = 1000, centre: float = 500.0) -> sk.Camera:
    k = [[focal, 0, centre], [0, focal, centre], [0, 0, 1]]
    return sk.Camera(k, np.eye(3), [0, 0, 3e3], size=(size, size))


def _rendered(camera: sk.Camera, joints: int = 1) -> str:
    return str(sk.render(np.zeros((joints, 3)), np.tile(np.eye(3), (joints, 1, 1)), camera).shape)


@attack("10a", "render of 1000 joints, 20,000 x 20,000 pixels", "MemoryError")
def render_too_large() -> str:
    return _said(lambda: _rendered(_camera(size=20_000), 1000))


@attack("10b", "render of an image of 2^31 pixels on a side", "an error that names it")
def render_beyond_counting() -> str:
    return _said(lambda: _rendered(_camera(size=2**31)))


@attack("10c", "render with a focal length of 1e-306 pixels", "an error that names it")
def render_focal() -> str:
    return _said(lambda: _rendered(_camera(focal=1e-306, centre=2000.0)))


@attack("10d", "Camera.scaled(1e306)", "an error that names it")
def scaled_to_infinity() -> str:
    return _said(lambda: _camera().scaled(1e306).K.tolist())


@attack("10e", "paper() with splats over images of 20,000 x 20,000 pixels, 1000 joints", "MemoryError")
def windows_too_large() -> str:
    warnings.simplefilter("ignore")
    config = sk.RefineConfig.paper(sigma_mm=1e6, max_steps=1)
    seen = np.full((1, 1000, 2), 500.0)
    return _said(
        lambda: sk.refine(np.zeros((1000, 3)), seen, [_camera(size=20_000)], config=config).pose.shape
    )


@attack("10f", "sigma_mm = 1e300 mm in paper()", "an error that names it")
def sigma_beyond_numbers() -> str:
    seen = _detections(1)[0]
    return _said(
        lambda: (
            sk.refine(
                None, seen, _RIG, layout="h36m17", config=sk.RefineConfig.paper(sigma_mm=1e300)
            ).stop_reason
        )
    )


@attack("10g", "a detection at 1e308 pixels: reprojection error and noise", "an error that names it")
def detection_beyond_numbers() -> str:
    seen = _detections(1)[0]
    seen[0, 0] = 1e308

    def call() -> str:
        found = sk.refine(None, seen, _RIG, layout="h36m17")
        return f"reprojection error {found.reprojection_error[0, 0]}, noise {float(found.noise):.3g}"

    return _said(call)
