"""Ablations and parts of them that are more than one setting varied: starts, coverage, time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from skelsplat import Refinement
from skelsplat._arrays import Array
from skelsplat.evaluation.ablations._source import ANNEALED, PAPER, Sample, Source, Start
from skelsplat.evaluation.ablations._sweep import Outcome, reported_rows
from skelsplat.evaluation.reported import reported
from skelsplat.evaluation.tables import Column, Row, Table
from skelsplat.metrics import sigma_coverage

INITIALISATION, COVERAGE = "tab:abl-initial-guess", "text:coverage"
_STARTS: dict[Start, str] = {"dlt": "Triangulation", "fusion": "3D fusion"}
_GUESS, _PRIOR = "Guess", f"{ANNEALED}, guess as prior"
_COLUMNS = (_GUESS, PAPER, ANNEALED, _PRIOR)


def initialisation(source: Source) -> Outcome:
    """Measure where the optimisation starts, by detector (tab:abl-initial-guess)."""
    rows = []
    for sample in source.samples("plain", "noisy"):
        if not sample.has_monocular:
            source.notes.append(f"{sample.name}: no monocular poses, so no fusion of them")
        for kind, start in _STARTS.items():
            if sample.has_monocular or kind == "dlt":
                cells = _started(source, sample, kind)
                rows.append(Row(start, tuple(map(cells.get, _COLUMNS)), data=sample.name))
    for row in reported(INITIALISATION).rows:
        start = _STARTS["dlt" if row.setting["init"] == "dlt" else "fusion"]
        theirs = row.cells(("guess", "skelsplat", None, None))
        rows.append(Row(f"{start} (reported)", theirs, "reported", f"{row.detector}"))
    columns = tuple(map(Column, _COLUMNS))
    table = Table("Start and detections, MPJPE", "start, detections", columns, tuple(rows), unit="mm")
    prior = (
        f"As a prior the fused poses enter with {source.init_sigma_mm:g} mm per axis; "
        "a triangulation of the same detections must not be one."
    )
    return (table,), (prior,)


def _started(source: Source, sample: Sample, kind: Start) -> dict[str, float]:
    """Return the MPJPE by column."""
    starts, words = sample.starts(kind), _STARTS[kind]
    found = {_GUESS: sample.errors(starts)}
    for method in (PAPER, ANNEALED):
        found[method] = source.errors(method, sample, starts, words)
    if kind == "fusion":
        sigma = source.init_sigma_mm
        found[_PRIOR] = source.errors(ANNEALED, sample, starts, f"{words} as prior", init_sigma_mm=sigma)
    return {column: errors["mpjpe"] for column, errors in found.items()}


_SIGMAS = ("1", "2", "3")
# Share of a Gaussian in three dimensions within 1, 2, 3 standard deviations (χ² with 3 degrees of freedom).
_IDEAL = (19.9, 73.9, 97.1)
_SPLAT, _PLAIN = f"{PAPER}, splat covariance", f"{PAPER} without factor, splat covariance"
_POSTERIOR = f"{ANNEALED}, uncertainty"

Shares = dict[str, Array]
"""By kind of covariance, whether each joint lies within each k: (3, P, N), 1, 0, or NaN if unknown."""


def coverage(source: Source) -> Outcome:
    """Measure how often the truth lies within 1, 2, 3 σ (discussion, figures fig:sigma_h36m, -occ)."""
    rows, tables = [], []
    for sample in source.samples("plain", "occ-3"):
        shares = _covered(source, sample)
        rows += [Row(name, _percents(share), data=sample.name) for name, share in shares.items()]
        tables.append(_by_joint(sample, shares))
    columns = tuple(Column(f"{k} σ") for k in _SIGMAS)
    all_rows = (*rows, *reported_rows(COVERAGE, _SIGMAS), Row("Gaussian in 3D", _IDEAL, "theory"))
    notes = (
        "The paper's figures per joint are charts without numbers. On occluded data its preset enlarges the "
        "covariance of elbows, wrists and ankles; without factor they are as large as the others.",
    )
    table = Table("Truth within k σ", "covariance", columns, all_rows, unit="%")
    return (table, *tables), notes


def _covered(source: Source, sample: Sample) -> Shares:
    starts = sample.starts(source.start_kind(sample))
    kinds: dict[str, tuple[str, str, dict[str, float]]] = {_SPLAT: (PAPER, "covariance", {})}
    if "occlusion_factor" in sample.paper_fields:
        kinds[_PLAIN] = (PAPER, "covariance", {"occlusion_factor": 1.0})
    kinds[_POSTERIOR] = (ANNEALED, "uncertainty", {})
    found = {}
    for name, (method, covariance, fields) in kinds.items():
        results = source.refined(method, sample, starts, "coverage", **fields)
        shares = [
            sigma_coverage(r.pose, getattr(r, covariance), group.truth, sigmas=(1, 2, 3), reduce="none")
            for group, r in zip(sample.groups, results, strict=True)
        ]
        found[name] = np.concatenate(shares, axis=1)
    return found


def _percents(shares: Array) -> tuple[float, ...]:
    return tuple(100.0 * float(np.nanmean(share)) for share in shares)


def _by_joint(sample: Sample, shares: Shares) -> Table:
    kinds = {"splat": shares.get(_PLAIN, shares[_SPLAT]), "uncert.": shares[_POSTERIOR]}
    rows = tuple(
        Row(joint, tuple(p for share in kinds.values() for p in _percents(share[:, :, j])))
        for j, joint in enumerate(sample.layout.joints)
    )
    columns = tuple(Column(f"{kind} {k} σ") for kind in kinds for k in _SIGMAS)
    title = f"Truth within k σ by joint, {sample.name}{', without factor' * (_PLAIN in shares)}"
    return Table(title, "joint", columns, rows, unit="%")


SECONDS = "tab:abl-symmetry:seconds"
TIERS = ("none", "Symm-1", "Symm-2", "Symm-3")
# Poses that are timed, and how often; the best time counts.
_TIMED, _REPEATS = 8, 3


def time_of_tiers(source: Source) -> Outcome:
    """Measure the time per iteration by symmetry tier."""
    few = replace(source, poses=min(_TIMED, source.poses or _TIMED)).samples("plain")[0]
    starts = few.starts(source.start_kind(few))
    timed = []
    for method, fields in ((PAPER, {"stop_tolerance": 0.0}), (ANNEALED, {})):
        solve = partial(source.refined, method, few, starts, "time", n_threads=1, **fields)
        best = [
            min(_ms(partial(solve, symmetry_tier=tier)) for _ in range(_REPEATS))
            for tier in range(len(TIERS))
        ]
        timed.append(Row(method, tuple(best), data=few.name))
    for row in reported_rows(SECONDS, [f"{tier}" for tier in range(4)]):
        values = tuple(1e3 * value if isinstance(value, float) else None for value in row.cells)
        timed.append(replace(row, cells=values))
    columns = tuple(Column(tier, 4) for tier in TIERS)
    table = Table("Time per iteration", "tier", columns, tuple(timed), unit="ms")
    note = f"Times: CPU time on one thread, best of {_REPEATS}, {_TIMED} poses; the paper's on a GPU."
    return (table,), (note,)


def _ms(solve: Callable[[], Sequence[Refinement]]) -> float:
    """Return the CPU time per iteration and pose."""
    begun = time.process_time()
    steps = int(sum(np.sum(result.n_iter) for result in solve()))
    return 1e3 * (time.process_time() - begun) / max(1, steps)
