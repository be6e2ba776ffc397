"""Running methods on cases, with the poses of every take kept on disk so that a stopped run goes on.

A result is read back only if its checksum is right and it belongs to the same settings and data.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat._atomic import atomic_write
from skelsplat._skelsplat import Layout
from skelsplat.datasets import Take
from skelsplat.evaluation.methods import Method, Options, Solution
from skelsplat.evaluation.protocols import Case

# Raise it when the meaning of a file or of a method's settings changes.
_FORMAT = 1
_CHECKSUM = hashlib.sha256().digest_size

Report = Callable[[str, str, int, int], None]
"""Called with method, take, poses done or found on disk so far, and poses in all (of all methods)."""


@dataclass(frozen=True)
class Store:
    """Results on disk: ``<folder>/<method>-<hash of settings>/<take>.npz``, each with its SHA-256 behind."""

    folder: Path
    #: What else the results depend on, as JSON values: data set, layout, detector, protocol.
    source: Mapping[str, Any]

    def path(self, method: Method, settings: Mapping[str, Any], take: Take) -> Path:
        """Return where the result of a take is or will be."""
        readable = re.sub(r"[^A-Za-z0-9]+", "-", take.key).strip("-")
        name = f"{readable}-{_digest(take.key)[:8]}.npz"
        return self.folder / f"{method.name}-{_digest(self._text(method, settings))[:12]}" / name

    def load(self, method: Method, settings: Mapping[str, Any], take: Take, data: str) -> Solution | None:
        """Return the stored result of a take whose arrays have the `fingerprint` `data`, if there is one."""
        path = self.path(method, settings, take)
        try:
            content = path.read_bytes()
            whole, checksum = content[:-_CHECKSUM], content[-_CHECKSUM:]
            if hashlib.sha256(whole).digest() != checksum:
                return None
            with np.load(io.BytesIO(whole), allow_pickle=False) as found:
                belongs = (str(found["settings"]), str(found["data"])) == (self._text(method, settings), data)
                pose, seconds = found["pose"], float(found["seconds"])
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            return None  # absent, or another kind of file
        fits = pose.shape == take.truth.shape and pose.dtype == np.float64 and not np.isinf(pose).any()
        return Solution(pose, seconds) if belongs and fits and 0 <= seconds < np.inf else None

    def save(
        self, method: Method, settings: Mapping[str, Any], take: Take, data: str, solution: Solution
    ) -> None:
        """Write the result of a take, whole or not at all.

        Raises `DatasetError` if the folder cannot be written.
        """
        path = self.path(method, settings, take)
        path.parent.mkdir(parents=True, exist_ok=True)
        content = io.BytesIO()
        np.savez(
            content,
            pose=solution.pose,
            seconds=np.float64(solution.seconds),
            key=np.str_(take.key),
            settings=np.str_(self._text(method, settings)),
            data=np.str_(data),
        )
        whole = content.getvalue()
        with atomic_write(path, durable=False) as stream:  # `load` checks what it reads
            stream.write(whole + hashlib.sha256(whole).digest())

    def _text(self, method: Method, settings: Mapping[str, Any]) -> str:
        what = {
            "format": _FORMAT,
            "version": _skelsplat.__version__,
            "method": method.name,
            "settings": dict(settings),
            "source": dict(self.source),
        }
        return json.dumps(what, sort_keys=True)


def fingerprint(take: Take) -> str:
    """Hash of everything in a take that a result or its score depends on."""
    digest = hashlib.blake2b(digest_size=16)
    arrays: dict[str, Any] = {
        name: getattr(take, name)
        for name in ("frames", "truth", "detections", "monocular", "boxes", "visible")
    }
    for i, camera in enumerate(take.rig):
        arrays |= {f"{name}{i}": getattr(camera, name) for name in ("K", "R", "t", "distortion", "size")}
        arrays[f"fisheye{i}"] = camera.fisheye
    digest.update(f"{take.key}|{take.rig.unit}".encode())
    for name, value in arrays.items():
        array = np.zeros(0) if value is None else np.ascontiguousarray(value)
        digest.update(f"|{name}:{value is None}:{array.dtype.str}:{array.shape}|".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _data(case: Case, over_time: bool) -> str:
    """Fingerprint of what counts, and over time of the recording around it and its rate."""
    whole, own = case.given(over_time), fingerprint(case.take)
    return f"{own} of {fingerprint(whole)} at {whole.fps:g} Hz" if over_time else own


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def run(
    cases: Sequence[Case],
    layout: Layout,
    methods: Sequence[Method],
    options: Options,
    *,
    store: Store | None = None,
    report: Report | None = None,
) -> dict[str, list[Solution]]:
    """Run every method on every case, or take the result from the store.

    Returns one solution per case by the method's name. Without a store nothing is kept on disk. Raises
    `DatasetError` if a take lacks what a method needs (before any work), or a result cannot be written.
    """
    settings = {method.name: method.settings(options) for method in methods}
    for method in methods:
        for case in cases:
            method.check(case.given(method.over_time), settings[method.name])
    kinds = {method.over_time for method in methods} if store is not None else ()
    prints = {kind: [_data(case, kind) for case in cases] for kind in kinds}
    total, done = len(methods) * sum(len(case.take) for case in cases), 0
    solutions: dict[str, list[Solution]] = {method.name: [] for method in methods}
    for method in methods:
        own = settings[method.name]
        for k, case in enumerate(cases):
            take, data = case.take, prints[method.over_time][k] if prints else ""

            def heard(now: int, _: int, where: tuple[str, str, int] = (method.name, take.key, done)) -> None:
                if report is not None:
                    report(*where[:2], where[2] + now, total)

            heard(0, total)
            solution = None if store is None else store.load(method, own, take, data)
            if solution is None:
                whole = case.given(method.over_time)
                solution = method.solve(whole, layout, own, heard if method.by_pixels else None)
                if whole is not take:
                    share = len(take) / len(whole)
                    solution = Solution(solution.pose[case.rows], share * solution.seconds)
                if store is not None:
                    store.save(method, own, take, data, solution)
            heard(len(take), total)
            solutions[method.name].append(solution)
            done += len(take)
    return solutions
