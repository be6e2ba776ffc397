"""What all tests share, and the scenes of the twin and the parity tests; tests/unit has one of its own."""

from __future__ import annotations

import gc
import os

# Before numpy is imported, and for the processes that tests start: several workers share the cores.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["RAYON_NUM_THREADS"] = "2"

import pickle
import signal
from collections.abc import Callable, Generator, Iterator
from functools import wraps
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import scenes
import skelsplat as sk
from reference import total
from skelsplat.run import Run, by_everybody, figures

# Looking for garbage among tests and modules, which all stay, takes a sixth of collecting them.
gc.disable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    gc.freeze()  # what is there by now is no garbage
    gc.enable()


@pytest.fixture(autouse=True, scope="session")
def _heeded_signal() -> Iterator[None]:
    """Let the tests and their children hear SIGINT, which a shell's background job ignores."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True, scope="session")
def _looked_at_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Check, adjust and find cameras once for all workers: many tests have those of the sample."""
    folder = tmp_path_factory.getbasetemp() / (".." if "PYTEST_XDIST_WORKER" in os.environ else ".")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("adjust_cameras", "calibrate_cameras"):
            patch.setattr(sk, name, _remembered(getattr(sk, name), folder))
        patch.setattr(by_everybody, "check_rig", _remembered(by_everybody.check_rig, folder))
        yield


def _remembered(function: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    @wraps(function)
    def once(*given: Any, **named: Any) -> Any:
        path = folder / sha256(pickle.dumps((function.__name__, given, named))).hexdigest()
        if not path.exists():
            whole = path.with_suffix(f".{os.getpid()}")
            whole.write_bytes(pickle.dumps(function(*given, **named)))
            whole.replace(path)
        return pickle.loads(path.read_bytes())

    return once


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Leave out what takes longest of most runs: to compose their figures, and to paint any figure.

    Tests marked ``drawn`` compose the figures of runs, tests marked ``painted`` also paint.
    """
    with pytest.MonkeyPatch.context() as patch:
        painted = item.get_closest_marker("painted")
        if not painted:
            patch.setattr(Figure, "savefig", _unpainted)
        if not painted and not item.get_closest_marker("drawn"):
            patch.setattr(figures, "write_figures", _undrawn)
            patch.setattr(figures, "write_people_figure", lambda _, path: _unpainted(None, path))
        return (yield)


_paint = Figure.savefig


def _unpainted(figure: Figure | None, target: Any, **options: Any) -> None:
    if figure is not None and options.get("format") == "pdf":  # its library counts the pages
        return _paint(Figure(), target, **options)
    write = target.write_bytes if isinstance(target, Path) else target.write
    return write(b"\x89PNG, not painted")


def _undrawn(_: Run, folder: Path) -> list[str]:
    names = ["overview.png", "weights.png"]
    for name in names:
        _unpainted(None, folder / name)
    return names


SCENES = {"three_joints": scenes.three_joints, "beyond_the_image": scenes.beyond_the_image}


def assert_no_pixel_changes_class(scene: scenes.Scene) -> None:
    """No step of the central differences may move a pixel over a threshold: there the loss has a kink."""
    for group, step in scenes.STEPS.items():
        for index in np.ndindex(getattr(scene.gaussians, group).shape):
            here = total.membership(scene.gaussians, scene.detections, scene.views, index[0])
            for sign in (-1, 1):
                there = scenes.moved(scene.gaussians, group, index, sign * step)
                after = total.membership(there, scene.detections, scene.views, index[0])
                assert all(np.array_equal(a, b) for a, b in zip(here, after, strict=True)), (group, index)


@pytest.fixture(scope="module", params=SCENES)
def scene(request: pytest.FixtureRequest) -> scenes.Scene:
    """Give a scene whose loss has no kink within the steps of the central differences."""
    built = SCENES[request.param]()
    assert_no_pixel_changes_class(built)
    return built
