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
# Share of a Gaussian in three dimensions within 1, 2, 3 standard deviations (χ² with 3 degrees of freedom).
_IDEAL = (19.9, 73.9, 97.1)
_SPLAT, _POSTERIOR = f"{PAPER}, splat covariance", f"{DEFAULT}, uncertainty"
# How close "the same coverage" must come, percentage points.
_NEAR = 10.0


def _run(source: Source) -> Outcome:
    plain = source.plain()
    samples = [*plain, *(s for s in source.occluded()[-1:] if s.dataset not in {p.dataset for p in plain})]
    rows, tables, findings = [], [], []
    for sample in samples:
        starts = source.starts(sample, "fusion")
        splat = source.paper(sample, starts, "coverage")
        posterior = source.default(sample, starts, "coverage")
        shares = {
            _SPLAT: _shares(sample, [r.pose for r in splat], [r.covariance for r in splat]),
            _POSTERIOR: _shares(sample, [r.pose for r in posterior], [r.uncertainty for r in posterior]),
        }
        for name, share in shares.items():
            rows.append(Row(name, sample.name, tuple(_percent(share[k]) for k in range(len(_SIGMAS)))))
        tables.append(_by_joint(sample, shares))
        findings += _findings(sample, shares)
    overall = Table(
        "Truth within k σ",
        "k",
        tuple(f"{k} σ" for k in _SIGMAS),
        (
            *rows,
            *paper_rows(_LABEL, tuple(f"{k}" for k in _SIGMAS)),
            Row("Gaussian in 3D", "", _IDEAL, "theory"),
        ),
        "%",
    )
    notes = ("The paper's figures per joint are charts without numbers.",)
    return Outcome((overall, *tables), tuple(findings), notes)


def _shares(sample: Sample, poses: Sequence[FloatArray], covariances: Sequence[FloatArray]) -> FloatArray:
    """Whether each joint lies within each k, (3, P, N): 1, 0, or NaN where it cannot be judged."""
    each = [
        metrics.sigma_coverage(pose, covariance, group.truth, sigmas=_SIGMAS, reduce="none")
        for group, pose, covariance in zip(sample.groups, poses, covariances, strict=True)
    ]
    return np.concatenate(each, axis=1)


def _percent(shares: FloatArray) -> float:
    return 100.0 * float(np.nanmean(shares))


def _by_joint(sample: Sample, shares: dict[str, FloatArray]) -> Table:
    columns = tuple(f"{kind} {k} σ" for kind in ("splat", "uncertainty") for k in _SIGMAS)
    rows = tuple(
        Row(joint, sample.name, tuple(_percent(share[k, :, j]) for share in shares.values() for k in range(len(_SIGMAS))))
        for j, joint in enumerate(sample.layout.joints)
    )
    return Table(f"Truth within k σ by joint, {sample.name}", "joint", columns, rows, "%", chart=False)


def _findings(sample: Sample, shares: dict[str, FloatArray]) -> list[Finding]:
    splat, posterior = ([_percent(share[k]) for k in range(3)] for share in shares.values())
    prone = list(sample.layout.occlusion_prone)
    others = [j for j in range(sample.layout.n_joints) if j not in prone]
    ours = [_percent(shares[_SPLAT][0][:, joints]) for joints in (prone, others)]
    worst = max(abs(a - b) for a, b in zip(posterior, _IDEAL, strict=True))
    figures = ", ".join(f"{share:.1f}" for share in splat)
    wide = ", ".join(f"{share:.1f}" for share in posterior)
    out = [
        Finding(
            "Elbows, wrists and ankles are covered less often than the other joints",
            "said in the text, without figures",
            f"{_SPLAT}, {sample.name}: {ours[0]:.1f} and {ours[1]:.1f} % at 1 σ",
            ours[0] < ours[1],
        ),
        Finding(
            f"Not in the paper: `uncertainty` covers as a Gaussian would (within {_NEAR:g} points)",
            f"a Gaussian {', '.join(f'{v:g}' for v in _IDEAL)} %",
            f"{sample.name}: {wide} %; furthest {worst:.1f} points",
            worst <= _NEAR,
        ),
    ]
    if "-occ" in sample.dataset:
        return out
    theirs = paper_rows(_LABEL, ("1", "2", "3"))[0].values
    far = max(abs(a - b) for a, b in zip(splat, (v or 0.0 for v in theirs), strict=True))
    claim = f"Within 1, 2, 3 σ of the splat lies the truth of 57, 92, 98 % (to {_NEAR:g} points)"
    measured = f"{_SPLAT}, {sample.name}: {figures} %; furthest {far:.1f} points"
    return [Finding(claim, quote(_LABEL, ("1", "2", "3")), measured, far <= _NEAR), *out]


ABLATION = Ablation("coverage", "Coverage of the covariances, per joint", (_LABEL,), 300, _run)
