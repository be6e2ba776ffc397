"""Joint encoding: a channel per joint against shared channels (paper, table tab:abl-encoding)."""

from __future__ import annotations

from skelsplat.evaluation.ablations._measure import Errors, difference
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import paper_rows, quote
from skelsplat.evaluation.ablations._source import PAPER, Source

_LABEL = "tab:abl-encoding"
_ENCODINGS = {"rgb": "3 channels", "single": "1 channel", "one_hot": "One-hot"}
# The paper prints tenths of a millimetre; what it calls equal agrees to that.
_EQUAL_MM = 0.1


def _run(source: Source) -> Outcome:
    rows, findings = [], []
    for sample in source.plain():
        starts = source.starts(sample, "fusion")
        found = {e: source.paper_errors(sample, starts, name, encoding=e) for e, name in _ENCODINGS.items()}
        rows.append(Row(PAPER, sample.name, tuple(f.mpjpe for f in found.values())))
        findings += _findings(sample.name, found)
    table = Table(
        "Joint encoding, MPJPE",
        "encoding",
        tuple(_ENCODINGS.values()),
        (*rows, *paper_rows(_LABEL, tuple(_ENCODINGS))),
    )
    return Outcome((table,), tuple(findings), ("The closed form exists for the one-hot encoding only.",))


def _findings(name: str, found: dict[str, Errors]) -> list[Finding]:
    rgb, single, one_hot = (found[e] for e in ("rgb", "single", "one_hot"))
    gain, apart = difference(one_hot, rgb), difference(rgb, single)
    return [
        Finding(
            "One-hot beats three shared channels and one",
            quote(_LABEL, ("rgb", "single", "one_hot")),
            f"{name}: {rgb.mpjpe:.1f}, {single.mpjpe:.1f}, {one_hot.mpjpe:.1f} mm; one-hot − 3 {gain}",
            gain.is_less and difference(one_hot, single).is_less,
        ),
        Finding(
            "Three channels and one give the same",
            quote(_LABEL, ("rgb", "single")),
            f"{name}: difference {apart}",
            abs(apart.mean) <= _EQUAL_MM,
        ),
    ]


ABLATION = Ablation("encoding", "Joint encoding", (_LABEL,), 120, _run)
