"""What all tests share; tests/unit has one of its own."""

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

import pytest
from matplotlib.figure import Figure

import skelsplat as sk
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
        told = pickle.dumps((function.__name__, given, {**named, "progress": None}))
        path = folder / sha256(told).hexdigest()
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
