"""Factor on the covariance of occlusion-prone joints (paper, supplement, table tab:abl-covariance)."""

from __future__ import annotations

import math

import skelsplat as sk
from skelsplat.evaluation.ablations._measure import Errors, difference
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import paper_rows, quote
from skelsplat.evaluation.ablations._sample import FloatArray, Sample
from skelsplat.evaluation.ablations._source import DEFAULT, PAPER, Source

_LABEL = "tab:abl-covariance"
_FACTORS = (1.0, 1.25, 1.5, 2.0)
_KEYS = tuple(f"{factor:g}" for factor in _FACTORS)
# Splats of this factor cover so many pixels that they are integrated instead; so many poses check it.
_INTEGRATED = 2.0
_CHECKED = 8
# Table tab:abl-covariance: 1.5 costs 4.7 to 7.0 %; 2 multiplies the error by 2.0 to 2.2.
_LITTLE, _NEARLY_TWICE = 1.1, 1.8


def _run(source: Source) -> Outcome:
    rows, findings, checks = [], [], []
    for sample in source.occluded("2", "3"):
        starts = source.starts(sample, "fusion")
        theirs = {f: _paper(source, sample, starts, f) for f in _FACTORS}
        ours = {
            f: source.default_errors(sample, starts, f"factor {f:g}", occlusion_sigma=_sigma_mm(f))
            for f in _FACTORS
        }
        rows += [
            Row(PAPER, sample.name, tuple(e.mpjpe for e in theirs.values())),
            Row(DEFAULT, sample.name, tuple(e.mpjpe for e in ours.values())),
        ]
        checks.append(_check(source, sample))
        findings += _findings(sample, theirs)
    columns = tuple(f"{f:g} ({_sigma_mm(f):.0f} mm)" for f in _FACTORS)
    table = Table("Covariance factor, MPJPE", "factor (σ)", columns, (*rows, *paper_rows(_LABEL, _KEYS)))
    notes = (
        "The factor multiplies the logarithm of σ in mm of elbows, wrists and ankles. The default solver "
        "gets the same σ in mm for these joints.",
        f"At {_INTEGRATED:g} the loss is integrated in closed form, which takes no pixels. "
        + " ".join(checks),
    )
    return Outcome((table,), tuple(findings), notes)


def _sigma_mm(factor: float) -> float:
    return math.exp(factor * math.log(sk.RefineConfig.paper().sigma))


def _paper(source: Source, sample: Sample, starts: list[FloatArray], factor: float) -> Errors:
    renderer = "closed_form" if factor >= _INTEGRATED else "raster"
    return source.paper_errors(
        sample, starts, f"factor {factor:g}", occlusion_factor=factor, renderer=renderer
    )


def _check(source: Source, sample: Sample) -> str:
    """Compare pixels and closed form at the largest factor, on a few poses."""
    few = sample.head(_CHECKED)
    starts = few.starts(source.start_kind(few, "fusion"))
    pixels, integrated = (
        source.paper_errors(
            few, starts, f"check with {name}", occlusion_factor=_INTEGRATED, renderer=renderer
        )
        for name, renderer in (("pixels", "raster"), ("closed form", "closed_form"))
    )
    return (
        f"{sample.name}, {few.n_poses} poses: {pixels.mpjpe:.2f} mm with pixels, "
        f"{integrated.mpjpe:.2f} mm without."
    )


def _findings(sample: Sample, found: dict[float, Errors]) -> list[Finding]:
    name = f"{PAPER}, {sample.name}"
    least, some, large = (found[f].mpjpe for f in (1.25, 1.5, 2.0))
    gain = difference(found[1.25], found[1.0])
    return [
        Finding(
            f"1.25 is better than no factor, {sample.dataset}",
            "said in the text, without figures",
            f"{name}: {found[1.0].mpjpe:.1f}, {least:.1f} mm; 1.25 − 1 {gain}",
            gain.is_less,
        ),
        Finding(
            f"1.25 is the best of 1.25, 1.5 and 2, {sample.dataset}",
            quote(_LABEL, ("1.25", "1.5", "2"), dataset=sample.dataset),
            f"{name}: {least:.1f}, {some:.1f}, {large:.1f} mm",
            difference(found[1.25], found[1.5]).is_less and difference(found[1.25], found[2.0]).is_less,
        ),
        Finding(
            f"1.5 costs little (at most 10 %), {sample.dataset}",
            quote(_LABEL, ("1.25", "1.5"), dataset=sample.dataset),
            f"{name}: {100 * (some / least - 1):+.1f} %",
            some <= _LITTLE * least,
        ),
        Finding(
            f"2 nearly doubles the error (at least ×{_NEARLY_TWICE:g}), {sample.dataset}",
            quote(_LABEL, ("1.25", "2"), dataset=sample.dataset),
            f"{name}: ×{large / least:.2f}",
            large >= _NEARLY_TWICE * least,
        ),
    ]


ABLATION = Ablation("covariance", "Covariance of occlusion-prone joints", (_LABEL,), 150, _run)
