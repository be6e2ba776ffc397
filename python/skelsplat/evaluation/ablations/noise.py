"""Gaussian noise on the triangulated start (paper, table and figure tab:abl-noise, fig:abl-noise)."""

from __future__ import annotations

from skelsplat import synthetic
from skelsplat.evaluation.ablations._measure import Errors, errors_of
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import paper_rows, quote
from skelsplat.evaluation.ablations._sample import FloatArray, Sample
from skelsplat.evaluation.ablations._source import DEFAULT, PAPER, Source

_LABEL = "tab:abl-noise"
_PAPER_MM = (0, 10, 20, 40, 60, 80, 100)
_LEVELS_MM = (*_PAPER_MM, 200, 400)
# Table tab:abl-noise, both detectors: up to +8.4 % at 20 mm, +25.1 % at 40 mm; ×2.4 and ×3.0 at 80 mm,
# ×3.2 and ×4.1 at 100 mm.
_FLAT, _STABLE, _TWICE, _THRICE = 1.1, 1.3, 2.0, 3.0
# A start that does not matter changes the result by less than this share.
_UNMOVED = 0.02


def _run(source: Source) -> Outcome:
    rows, findings = [], []
    for sample in source.plain():
        clean = sample.starts("dlt")
        found: dict[str, dict[int, Errors]] = {"the start": {}, PAPER: {}, DEFAULT: {}}
        for level in _LEVELS_MM:
            starts = _noisy(sample, clean, level, source.choices.seed)
            found["the start"][level] = errors_of(sample, starts)
            if level in _PAPER_MM:
                found[PAPER][level] = source.paper_errors(sample, starts, f"{level} mm")
            found[DEFAULT][level] = source.default_errors(sample, starts, f"{level} mm")
        for method, by_level in found.items():
            cells = tuple(by_level[k].mpjpe if k in by_level else None for k in _LEVELS_MM)
            rows.append(Row(method, sample.name, cells))
        findings += [*_findings(sample.name, found[PAPER]), _own(sample.name, found[DEFAULT])]
    levels = tuple(f"{level}" for level in _LEVELS_MM)
    table = Table("Noise on the start, MPJPE", "σ per axis, mm", levels, (*rows, *paper_rows(_LABEL, levels)))
    return Outcome((table,), tuple(findings), ("Start by DLT without weights, plus the noise.",))


def _noisy(sample: Sample, starts: list[FloatArray], level: int, seed: int) -> list[FloatArray]:
    """Add the same draw at every level, scaled."""
    return [
        synthetic.perturb(start, level / group.rig.mm_per_unit, seed=seed + 1 + k)
        for k, (group, start) in enumerate(zip(sample.groups, starts, strict=True))
    ]


def _findings(name: str, found: dict[int, Errors]) -> list[Finding]:
    def at_most(level: int, factor: float) -> bool:
        return all(found[k].mpjpe <= factor * found[0].mpjpe for k in found if k <= level)

    def ratio(level: int) -> str:
        share = found[level].mpjpe / found[0].mpjpe
        return f"{name}: {found[0].mpjpe:.1f}, at {level} mm {found[level].mpjpe:.1f} mm (×{share:.2f})"

    def at_least(level: int, factor: float) -> bool:
        return found[level].mpjpe >= factor * found[0].mpjpe

    claims = (
        ("Flat to 20 mm (at most +10 %)", 20, at_most(20, _FLAT)),
        ("Stable to 40 mm (at most +30 %)", 40, at_most(40, _STABLE)),
        ("More than twice by 80 mm", 80, at_least(80, _TWICE)),
        ("More than three times by 100 mm", 100, at_least(100, _THRICE)),
    )
    return [Finding(c, quote(_LABEL, ("0", f"{k}")), ratio(k), ok) for c, k, ok in claims]


def _own(name: str, found: dict[int, Errors]) -> Finding:
    worst = max(abs(e.mpjpe / found[0].mpjpe - 1) for e in found.values())
    return Finding(
        f"The default solver does not depend on the start (within {100 * _UNMOVED:g} %)",
        "not the paper's claim",
        f"{name}: {found[0].mpjpe:.1f} mm, within {100 * worst:.1f} % to {max(found)} mm",
        worst <= _UNMOVED,
        ours=True,
    )


ABLATION = Ablation("noise", "Noise on the start", (_LABEL,), 300, _run)
