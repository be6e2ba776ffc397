"""Resolution of the renderings (paper, supplement, table tab:abl-resolution)."""

from __future__ import annotations

from skelsplat.evaluation.ablations._measure import Errors, difference
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import paper_rows, quote
from skelsplat.evaluation.ablations._source import PAPER, Source

_LABEL = "tab:abl-resolution"
_PERCENT = (100, 75, 50, 25)
# Table tab:abl-resolution: +0.5 % at most at 75 %, +2.0 % at 50 %; +3.0 % and +6.9 % at 25 %.
_LITTLE = 1.03


def _run(source: Source) -> Outcome:
    rows, findings = [], []
    for sample in source.plain():
        starts = source.starts(sample, "fusion")
        found = {
            percent: source.paper_errors(sample, starts, f"{percent} %", resolution=percent / 100)
            for percent in _PERCENT
        }
        rows.append(Row(PAPER, sample.name, tuple(found[p].mpjpe for p in _PERCENT)))
        findings += _findings(sample.name, found)
    keys = tuple(f"{percent}" for percent in _PERCENT)
    table = Table(
        "Resolution of the renderings, MPJPE",
        "resolution",
        tuple(f"{percent} %" for percent in _PERCENT),
        (*rows, *paper_rows(_LABEL, keys)),
    )
    notes = (
        "Cameras and detections are scaled; the detections keep their sub-pixel places. "
        "The default solver has no resolution: it renders no pixels.",
    )
    return Outcome((table,), tuple(findings), notes)


def _findings(name: str, found: dict[int, Errors]) -> list[Finding]:
    full = found[100].mpjpe
    worst = max(found[p].mpjpe / full for p in (75, 50)) - 1
    loss = difference(found[100], found[25])
    figures = f"{name}: {', '.join(f'{e.mpjpe:.1f}' for e in found.values())} mm"
    return [
        Finding(
            "Resolution costs little down to 50 % (at most 3 %)",
            quote(_LABEL, ("100", "75", "50")),
            f"{figures}; at most {100 * worst:+.1f} %",
            1 + worst <= _LITTLE,
        ),
        Finding(
            "At 25 % accuracy is lost",
            quote(_LABEL, ("100", "25")),
            f"{figures}; 100 % − 25 % {loss}",
            loss.is_less,
        ),
    ]


ABLATION = Ablation("resolution", "Resolution of the renderings", (_LABEL,), 300, _run)
