"""Running methods on cases, with the poses of every take kept on disk so that a stopped run goes on.

A result is read back only if the checksum of the file and of the data that it was made of is right.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat._atomic import atomic_write
from skelsplat._refine import Progress
from skelsplat._skelsplat import Layout
from skelsplat.datasets import Take
from skelsplat.evaluation.methods import Method, Options, Settings, Solution
from skelsplat.evaluation.protocols import Case

# Raise it when the meaning of a file or of a method's settings changes.
_FORMAT = 3

Report = Callable[[str, str, int, int], None]
"""Called with method, take, poses done or found on disk so far, and poses in all (of all methods)."""


@dataclass(frozen=True)
class Store:
    """Results on disk: ``<folder>/<method>-<hash of settings>/<take>.npz``, each with a checksum behind."""

    folder: Path
    source: tuple[str | None, ...]  #: what else the results depend on

    def path(self, method: Method, settings: Settings, take: Take) -> Path:
        """Return where the result of a take is or will be."""
        run = json.dumps(
            (_FORMAT, _skelsplat.__version__, method.name, settings, self.source), sort_keys=True
        )
        readable = re.sub(r"[^A-Za-z0-9]+", "-", take.key).strip("-")
        name = f"{readable}-{_digest(take.key.encode())[:8]}.npz"
        return self.folder / f"{method.name}-{_digest(run.encode())[:12]}" / name


def load(path: Path, data: bytes) -> Solution | None:
    """Return what `save` has written of the same data, if it is there and whole."""
    content = path.read_bytes() if path.is_file() else b""
    whole, checksum = content[:-32], content[-32:]
    if hashlib.sha256(whole + data).digest() != checksum:
        return None
    with np.load(io.BytesIO(whole), allow_pickle=False) as found:
        return Solution(found["pose"], float(found["seconds"]))


def save(path: Path, data: bytes, solution: Solution) -> None:
    """Write a result, whole or not at all; raises `DatasetError` if the folder cannot be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    np.savez(content, pose=solution.pose, seconds=np.float64(solution.seconds))
    whole = content.getvalue()
    with atomic_write(path, durable=False) as stream:  # `load` checks what it reads
        stream.write(whole + hashlib.sha256(whole + data).digest())


def fingerprint(take: Take) -> bytes:
    """Everything in a take that a result or its score depends on."""
    arrays: list[Any] = [take.frames, take.truth, take.detections, take.monocular, take.boxes]
    for camera in take.rig:
        arrays += [camera.K, camera.R, camera.t, camera.distortion, camera.size, camera.fisheye]
    content = f"{take.key}|{take.rig.unit}|{take.fps}".encode()
    for value in arrays:
        array = np.zeros(0) if value is None else np.ascontiguousarray(value)
        content += f"|{value is None}:{array.dtype.str}:{array.shape}|".encode() + array.tobytes()
    return content


def _digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def run(
    cases: Sequence[Case],
    layout: Layout,
    methods: Sequence[Method],
    options: Options,
    *,
    store: Store | None = None,
    report: Report | None = None,
) -> dict[str, list[Solution]]:
    """Return by method one solution per case, from the store if it has it; without one nothing is kept.

    Raises `DatasetError` if a take lacks what a method needs (before any work), or one cannot be written.
    """
    settings = {method.name: method.settings(options) for method in methods}
    for method in methods:
        for case in cases:
            method.check(case.given(method.over_time), settings[method.name])
    total, done = len(methods) * sum(len(case.take) for case in cases), 0
    solutions: dict[str, list[Solution]] = {method.name: [] for method in methods}

    def told(now: int, _: int = 0) -> None:
        if report is not None:
            report(method.name, case.take.key, done + now, total)

    for method in methods:
        for case in cases:
            told(0)
            solutions[method.name].append(_solved(method, case, layout, settings[method.name], store, told))
            done += len(case.take)
            told(len(case.take))
    return solutions


def _solved(
    method: Method, case: Case, layout: Layout, settings: Settings, store: Store | None, told: Progress
) -> Solution:
    """Return the poses that count in a case, from the store if it has them."""
    take, whole = case.take, case.given(method.over_time)
    if store is not None:
        path, data = store.path(method, settings, take), fingerprint(take)
        if method.over_time:
            data += fingerprint(whole)
        if (found := load(path, data)) is not None:
            return found
    solution = method.solve(whole, layout, settings, told if method.by_pixels else None)
    if whole is not take:
        solution = Solution(solution.pose[case.rows], len(take) / len(whole) * solution.seconds)
    if store is not None:
        save(path, data, solution)
    return solution
