"""Ablations and parts of them that are more than one setting varied: starts, coverage, time, integration."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from skelsplat import Refinement, metrics
from skelsplat._arrays import Array
from skelsplat.evaluation.ablations._sample import Errors, Sample, Start, difference, errors_of
from skelsplat.evaluation.ablations._source import ANNEALED, PAPER, Source
from skelsplat.evaluation.ablations._sweep import IN_THE_TEXT, Claim, Outcome, quote, reported_rows
from skelsplat.evaluation.reported import reported
from skelsplat.evaluation.tables import Column, Row, Table

INITIALISATION, COVERAGE = "tab:abl-initial-guess", "text:coverage"
_STARTS: dict[Start, str] = {"dlt": "Triangulation", "fusion": "3D fusion"}
_GUESS, _PRIOR = "Guess", f"{ANNEALED}, guess as prior"
_COLUMNS = (_GUESS, PAPER, ANNEALED, _PRIOR)
# tab:abl-initial-guess: the two starts end at most 1.2 mm apart for any detector.
_APART_MM = 1.2


def initialisation(source: Source) -> Outcome:
    """Measure where the optimisation starts, by detector (tab:abl-initial-guess)."""
    rows, claims = [], []
    for sample in source.samples("plain", "noisy"):
        kinds: list[Start] = ["dlt", "fusion"] if sample.has_monocular else ["dlt"]
        if len(kinds) == 1:
            source.note(f"{sample.name}: no monocular poses, so no fusion of them")
        found = {kind: _started(source, sample, kind) for kind in kinds}
        for kind, by in found.items():
            cells = tuple(by[column].mpjpe if column in by else None for column in _COLUMNS)
            rows.append(Row(_STARTS[kind], cells, data=sample.name))
        claims += [_improves(sample.name, kind, by) for kind, by in found.items()]
        if "fusion" in found:
            claims += [_little_influence(sample.name, method, found) for method in (PAPER, ANNEALED)]
    for row in reported(INITIALISATION):
        start = _STARTS["dlt" if row.setting["init"] == "dlt" else "fusion"]
        cells = (row.value("guess"), row.value("skelsplat"), None, None)
        rows.append(Row(f"{start} (reported)", cells, "reported", f"{row.detector}"))
    columns = tuple(map(Column, _COLUMNS))
    table = Table("Start and detections, MPJPE", "start, detections", columns, tuple(rows), unit="mm")
    prior = (
        f"As a prior the fused poses enter with {source.choices.init_sigma_mm:g} mm per axis; "
        "a triangulation of the same detections must not be one."
    )
    return Outcome((table,), tuple(claims), (prior,))


def _started(source: Source, sample: Sample, kind: Start) -> dict[str, Errors]:
    """Return the errors by column."""
    starts, words = sample.starts(kind), _STARTS[kind]
    found = {_GUESS: errors_of(sample, starts)}
    for method in (PAPER, ANNEALED):
        found[method] = source.errors(method, sample, starts, words)
    if kind == "fusion":
        sigma = source.choices.init_sigma_mm
        found[_PRIOR] = source.errors(ANNEALED, sample, starts, f"{words} as prior", init_sigma_mm=sigma)
    return found


def _improves(name: str, kind: Start, found: dict[str, Errors]) -> Claim:
    gain = difference(found[PAPER], found[_GUESS])
    return Claim(
        f"Refinement improves on the start: {_STARTS[kind]}",
        quote(INITIALISATION, ("guess", "skelsplat"), init=kind),
        f"{PAPER}, {name}: {found[_GUESS].mpjpe:.1f}, {found[PAPER].mpjpe:.1f} mm; difference {gain}",
        gain.is_less,
    )


def _little_influence(name: str, method: str, found: dict[Start, dict[str, Errors]]) -> Claim:
    dlt, fusion = found["dlt"][method], found["fusion"][method]
    apart = difference(fusion, dlt)
    return Claim(
        f"The start has little influence on the result (at most {_APART_MM:g} mm)",
        f"from triangulation {quote(INITIALISATION, ('skelsplat',), init='dlt')}, "
        f"from fusion {quote(INITIALISATION, ('skelsplat',), init='fusion')}",
        f"{method}, {name}: {dlt.mpjpe:.1f}, {fusion.mpjpe:.1f} mm; fusion − triangulation {apart}",
        abs(apart.mean) <= _APART_MM,
        ours=method == ANNEALED,
    )


_SIGMAS = (1, 2, 3)
# Share of a Gaussian in three dimensions within 1, 2, 3 standard deviations (χ² with 3 degrees of freedom).
_IDEAL = (19.9, 73.9, 97.1)
_SPLAT, _PLAIN, _POSTERIOR = (
    f"{PAPER}, splat covariance",
    f"{PAPER} without factor, splat covariance",
    f"{ANNEALED}, uncertainty",
)
# How close "the same coverage" must come, percentage points.
_NEAR = 10.0

Shares = dict[str, Array]
"""By kind of covariance, whether each joint lies within each k: (3, P, N), 1, 0, or NaN if unknown."""


def coverage(source: Source) -> Outcome:
    """Measure how often the truth lies within 1, 2, 3 σ (discussion, figures fig:sigma_h36m, -occ)."""
    rows, tables, claims = [], [], []
    theirs = reported_rows(COVERAGE, [f"{k}" for k in _SIGMAS])
    for sample in source.samples("plain", "occ-3"):
        shares = _covered(source, sample)
        rows += [Row(name, _percents(share), data=sample.name) for name, share in shares.items()]
        tables.append(_by_joint(sample, shares))
        if _PLAIN not in shares:
            figures = [value for value in theirs[0].cells if isinstance(value, float)]
            text = f"The truth of 57, 92, 98 % lies within 1, 2, 3 σ of the splat (to {_NEAR:g} points)"
            quoted = quote(COVERAGE, [f"{k}" for k in _SIGMAS])
            claims.append(Claim(text, quoted, *_near(sample, _SPLAT, shares, figures)))
        claims += [_prone(sample, kind, shares[kind]) for kind in (_SPLAT, _PLAIN) if kind in shares]
        text = f"`uncertainty` covers as a Gaussian would (within {_NEAR:g} points)"
        quoted = f"not the paper's claim; a Gaussian {_list(_IDEAL)} %"
        claims.append(Claim(text, quoted, *_near(sample, _POSTERIOR, shares, _IDEAL), ours=True))
    columns = tuple(Column(f"{k} σ") for k in _SIGMAS)
    all_rows = (*rows, *theirs, Row("Gaussian in 3D", _IDEAL, "theory"))
    notes = (
        "The paper's figures per joint are charts without numbers. On occluded data its preset enlarges the "
        "covariance of elbows, wrists and ankles; without factor they are as large as the others.",
    )
    table = Table("Truth within k σ", "covariance", columns, all_rows, unit="%")
    return Outcome((table, *tables), tuple(claims), notes)


def _covered(source: Source, sample: Sample) -> Shares:
    starts = source.starts(sample)
    splat = source.refined(PAPER, sample, starts, "coverage")
    found = {_SPLAT: [(r.pose, r.covariance) for r in splat]}
    if "occlusion_factor" in sample.paper_fields:
        same = source.refined(PAPER, sample, starts, "coverage without factor", occlusion_factor=1.0)
        found[_PLAIN] = [(r.pose, r.covariance) for r in same]
    posterior = source.refined(ANNEALED, sample, starts, "coverage")
    found[_POSTERIOR] = [(r.pose, r.uncertainty) for r in posterior]
    return {
        name: np.concatenate(
            [
                metrics.sigma_coverage(pose, covariance, group.poses.truth, sigmas=_SIGMAS, reduce="none")
                for group, (pose, covariance) in zip(sample.groups, results, strict=True)
            ],
            axis=1,
        )
        for name, results in found.items()
    }


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
    return Table(title, "joint", columns, rows, unit="%", chart=False)


def _near(sample: Sample, kind: str, shares: Shares, expected: Sequence[float]) -> tuple[str, bool]:
    """Return what is measured, in words, and whether it is near to what is expected."""
    here = _percents(shares[kind])
    far = max(abs(a - b) for a, b in zip(here, expected, strict=True))
    return f"{kind}, {sample.name}: {_list(here)} %; furthest {far:.1f} points", far <= _NEAR


def _prone(sample: Sample, kind: str, shares: Array) -> Claim:
    prone = list(sample.layout.occlusion_prone)
    others = [j for j in range(sample.layout.n_joints) if j not in prone]
    low, high = (_percents(shares[:, :, joints])[0] for joints in (prone, others))
    return Claim(
        "Elbows, wrists and ankles are covered less often than the other joints",
        IN_THE_TEXT,
        f"{kind}, {sample.name}: {low:.1f} and {high:.1f} % at 1 σ",
        low < high,
    )


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.1f}" for value in values)


SECONDS = "tab:abl-symmetry:seconds"
TIERS = ("none", "Symm-1", "Symm-2", "Symm-3")
# Poses that are timed, and how often; the best time counts.
_TIMED, _REPEATS = 8, 3
# tab:abl-symmetry: Symm-3 costs 44 % more time.
_COSTLY = 1.2


def time_of_tiers(source: Source, samples: Sequence[Sample]) -> Outcome:
    """Measure the time per iteration by symmetry tier."""
    few = samples[0].head(_TIMED)
    whole = samples[0].starts(source.start_kind(samples[0]))
    starts = [start[: len(group)] for start, group in zip(whole, few.groups, strict=True)]
    ms: dict[str, list[float]] = {PAPER: [], ANNEALED: []}
    for tier in range(len(TIERS)):
        for method, fields in ((PAPER, {"stop_tolerance": 0.0}), (ANNEALED, {})):
            once = partial(
                source.refined, method, few, starts, "time", symmetry_tier=tier, n_threads=1, **fields
            )
            ms[method].append(1e3 * min(_seconds(once) for _ in range(_REPEATS)))
    timed = [Row(method, tuple(each), data=samples[0].name) for method, each in ms.items()]
    for row in reported_rows(SECONDS, [f"{tier}" for tier in range(4)]):
        values = tuple(1e3 * value if isinstance(value, float) else None for value in row.cells)
        timed.append(replace(row, cells=values))
    ratio = ms[PAPER][3] / ms[PAPER][1]
    claim = Claim(
        f"Symm-3 costs clearly more time than Symm-1 (at least {100 * (_COSTLY - 1):.0f} %)",
        quote(SECONDS, ("1", "3")),
        f"{PAPER}: {ms[PAPER][1]:.4f}, {ms[PAPER][3]:.4f} ms ({100 * (ratio - 1):+.1f} %)",
        ratio >= _COSTLY,
    )
    columns = tuple(Column(tier, 4) for tier in TIERS)
    table = Table("Time per iteration", "tier", columns, tuple(timed), unit="ms", chart=False)
    note = f"Times: CPU time on one thread, best of {_REPEATS}, {_TIMED} poses; the paper's on a GPU."
    return Outcome((table,), (claim,), (note,))


def _seconds(once: Callable[[], Sequence[Refinement]]) -> float:
    """Return the CPU time per iteration and pose."""
    begun = time.process_time()
    steps = int(sum(np.sum(result.n_iter) for result in once()))
    return (time.process_time() - begun) / max(1, steps)


# Splats of this covariance factor cover so many pixels that they are integrated in closed form instead.
INTEGRATED = 2.0
_CHECKED = 8


def check_of_integration(source: Source, samples: Sequence[Sample]) -> Outcome:
    """Compare pixels and closed form at the largest covariance factor, on a few poses."""
    said = [f"At {INTEGRATED:g} the loss is integrated in closed form, which takes no pixels."]
    for sample in samples:
        few = sample.head(_CHECKED)
        starts = few.starts(source.start_kind(few))
        pixels, integrated = (
            source.errors(PAPER, few, starts, "check", occlusion_factor=INTEGRATED, renderer=renderer)
            for renderer in ("raster", "closed_form")
        )
        said.append(
            f"{sample.name}, {few.n_poses} poses: {pixels.mpjpe:.2f} mm with pixels, "
            f"{integrated.mpjpe:.2f} mm without."
        )
    return Outcome((), (), (" ".join(said),))
