"""How often the truth lies within 1, 2, 3 σ, per joint (paper, discussion, figures fig:sigma_h36m, -occ)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skelsplat import metrics
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import paper_rows, quote
from skelsplat.evaluation.ablations._sample import FloatArray, Sample
from skelsplat.evaluation.ablations._source import DEFAULT, PAPER, Source

_LABEL = "text:coverage"
_SIGMAS = (1, 2, 3)
_KEYS = tuple(f"{k}" for k in _SIGMAS)
# Share of a Gaussian in three dimensions within 1, 2, 3 standard deviations (χ² with 3 degrees of freedom).
_IDEAL = (19.9, 73.9, 97.1)
_SPLAT, _PLAIN, _POSTERIOR = (
    f"{PAPER}, splat covariance",
    f"{PAPER} without factor, splat covariance",
    f"{DEFAULT}, uncertainty",
)
# How close "the same coverage" must come, percentage points.
_NEAR = 10.0

Shares = dict[str, FloatArray]
"""By kind of covariance, whether each joint lies within each k: (3, P, N), 1, 0, or NaN if unknown."""


def _run(source: Source) -> Outcome:
    plain = source.plain()
    samples = [*plain, *(s for s in source.occluded("3") if s.dataset not in {p.dataset for p in plain})]
    rows, tables, findings = [], [], []
    for sample in samples:
        shares = _measured(source, sample)
        rows += [Row(name, sample.name, tuple(_percent(s) for s in share)) for name, share in shares.items()]
        tables.append(_by_joint(sample, shares))
        findings += _findings(sample, shares)
    ideal = Row("Gaussian in 3D", "", _IDEAL, "theory")
    overall = Table(
        "Truth within k σ",
        "covariance",
        tuple(f"{k} σ" for k in _SIGMAS),
        (*rows, *paper_rows(_LABEL, _KEYS), ideal),
        "%",
    )
    notes = (
        "The paper's figures per joint are charts without numbers. On occluded data its preset enlarges the "
        "covariance of elbows, wrists and ankles; without factor they are as large as the others.",
    )
    return Outcome((overall, *tables), tuple(findings), notes)


def _measured(source: Source, sample: Sample) -> Shares:
    starts = source.starts(sample, "fusion")
    splat = source.paper(sample, starts, "coverage")
    out = {_SPLAT: _shares(sample, [r.pose for r in splat], [r.covariance for r in splat])}
    if "occlusion_factor" in sample.paper_fields:
        same = source.paper(sample, starts, "coverage without factor", occlusion_factor=1.0)
        out[_PLAIN] = _shares(sample, [r.pose for r in same], [r.covariance for r in same])
    posterior = source.default(sample, starts, "coverage")
    out[_POSTERIOR] = _shares(sample, [r.pose for r in posterior], [r.uncertainty for r in posterior])
    return out


def _shares(sample: Sample, poses: Sequence[FloatArray], covariances: Sequence[FloatArray]) -> FloatArray:
    each = [
        metrics.sigma_coverage(pose, covariance, group.truth, sigmas=_SIGMAS, reduce="none")
        for group, pose, covariance in zip(sample.groups, poses, covariances, strict=True)
    ]
    return np.concatenate(each, axis=1)


def _percent(shares: FloatArray) -> float:
    return 100.0 * float(np.nanmean(shares))


def _by_joint(sample: Sample, shares: Shares) -> Table:
    kinds = {"splat": shares.get(_PLAIN, shares[_SPLAT]), "uncert.": shares[_POSTERIOR]}
    columns = tuple(f"{kind} {k} σ" for kind in kinds for k in _SIGMAS)
    rows = tuple(
        Row(joint, "", tuple(_percent(share[k, :, j]) for share in kinds.values() for k in range(len(share))))
        for j, joint in enumerate(sample.layout.joints)
    )
    title = f"Truth within k σ by joint, {sample.name}{', without factor' * (_PLAIN in shares)}"
    return Table(title, "joint", columns, rows, "%", chart=False)


def _findings(sample: Sample, shares: Shares) -> list[Finding]:
    out = [] if _PLAIN in shares else [_level(sample, shares[_SPLAT])]
    for kind in (_SPLAT, _PLAIN):
        if kind in shares:
            out.append(_prone(sample, kind, shares[kind]))
    posterior = [_percent(share) for share in shares[_POSTERIOR]]
    worst = max(abs(a - b) for a, b in zip(posterior, _IDEAL, strict=True))
    return [
        *out,
        Finding(
            f"`uncertainty` covers as a Gaussian would (within {_NEAR:g} points)",
            f"not the paper's claim; a Gaussian {_list(_IDEAL)} %",
            f"{sample.name}: {_list(posterior)} %; furthest {worst:.1f} points",
            worst <= _NEAR,
            ours=True,
        ),
    ]


def _level(sample: Sample, shares: FloatArray) -> Finding:
    ours = [_percent(share) for share in shares]
    theirs = [value for value in paper_rows(_LABEL, _KEYS)[0].values if value is not None]
    far = max(abs(a - b) for a, b in zip(ours, theirs, strict=True))
    return Finding(
        f"The truth of 57, 92, 98 % lies within 1, 2, 3 σ of the splat (to {_NEAR:g} points)",
        quote(_LABEL, _KEYS),
        f"{_SPLAT}, {sample.name}: {_list(ours)} %; furthest {far:.1f} points",
        far <= _NEAR,
    )


def _prone(sample: Sample, kind: str, shares: FloatArray) -> Finding:
    prone = list(sample.layout.occlusion_prone)
    others = [j for j in range(sample.layout.n_joints) if j not in prone]
    low, high = (_percent(shares[0][:, joints]) for joints in (prone, others))
    return Finding(
        "Elbows, wrists and ankles are covered less often than the other joints",
        "said in the text, without figures",
        f"{kind}, {sample.name}: {low:.1f} and {high:.1f} % at 1 σ",
        low < high,
    )


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.1f}" for value in values)


ABLATION = Ablation("coverage", "Coverage of the covariances, per joint", (_LABEL,), 300, _run)
