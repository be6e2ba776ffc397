"""Where the optimisation starts, by detector (paper, table tab:abl-initial-guess)."""

from __future__ import annotations

from dataclasses import dataclass

from skelsplat.evaluation.ablations._measure import Errors, difference, errors_of
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import quote
from skelsplat.evaluation.ablations._sample import Sample, Start
from skelsplat.evaluation.ablations._source import DEFAULT, PAPER, Source
from skelsplat.evaluation.reported import reported

_LABEL = "tab:abl-initial-guess"
_STARTS: dict[Start, str] = {"dlt": "Triangulation", "fusion": "3D fusion"}
# Table tab:abl-initial-guess: the two starts end at most 1.2 mm apart for any detector.
_APART_MM = 1.2


@dataclass(frozen=True, slots=True)
class _Cell:
    """Errors for one start and detector."""

    guess: Errors
    paper: Errors
    default: Errors
    prior: Errors | None

    def row(self, start: str, data: str) -> Row:
        prior = None if self.prior is None else self.prior.mpjpe
        return Row(start, data, (self.guess.mpjpe, self.paper.mpjpe, self.default.mpjpe, prior))


def _run(source: Source) -> Outcome:
    rows, findings = [], []
    for sample in source.detectors():
        kinds: list[Start] = ["dlt", "fusion"] if sample.has_monocular else ["dlt"]
        if len(kinds) == 1:
            source.note(f"{sample.name}: no monocular poses, so no fusion of them")
        cells = {kind: _cell(source, sample, kind) for kind in kinds}
        rows += [cell.row(_STARTS[kind], sample.name) for kind, cell in cells.items()]
        findings += _findings(sample.name, cells)
    columns = ("Guess", PAPER, DEFAULT, f"{DEFAULT}, guess as prior")
    table = Table("Start and detections, MPJPE", "start, detections", columns, (*rows, *_paper_rows()))
    prior = (
        f"As a prior the fused poses enter with {source.choices.init_sigma_mm:g} mm per axis; "
        "a triangulation of the same detections must not be one."
    )
    return Outcome((table,), tuple(findings), (prior,))


def _cell(source: Source, sample: Sample, kind: Start) -> _Cell:
    starts = sample.starts(kind)
    words = _STARTS[kind]
    prior = None
    if kind == "fusion":
        prior = source.default_errors(
            sample, starts, f"{words} as prior", init_sigma_mm=source.choices.init_sigma_mm
        )
    return _Cell(
        errors_of(sample, starts),
        source.paper_errors(sample, starts, words),
        source.default_errors(sample, starts, words),
        prior,
    )


def _paper_rows() -> list[Row]:
    return [
        Row(
            f"{_STARTS['dlt' if row.setting['init'] == 'dlt' else 'fusion']} (paper)",
            f"{row.detector}",
            (row.value("guess"), row.value("skelsplat"), None, None),
            "paper",
        )
        for row in reported(_LABEL)
    ]


def _findings(name: str, cells: dict[Start, _Cell]) -> list[Finding]:
    out = []
    for kind, cell in cells.items():
        gain = difference(cell.paper, cell.guess)
        out.append(
            Finding(
                f"Refinement improves on the start: {_STARTS[kind]}",
                quote(_LABEL, ("guess", "skelsplat"), init=kind),
                f"{name}: {cell.guess.mpjpe:.1f}, {cell.paper.mpjpe:.1f} mm; difference {gain}",
                gain.is_less,
            )
        )
    if "fusion" not in cells:
        return out
    dlt, fusion = cells["dlt"], cells["fusion"]
    for method, a, b in (
        (PAPER, fusion.paper, dlt.paper),
        (DEFAULT, fusion.default, dlt.default),
    ):
        apart = difference(a, b)
        out.append(
            Finding(
                f"The start has little influence on the result (at most {_APART_MM:g} mm)",
                f"from triangulation {quote(_LABEL, ('skelsplat',), init='dlt')}, "
                f"from fusion {quote(_LABEL, ('skelsplat',), init='fusion')}",
                f"{method}, {name}: {b.mpjpe:.1f}, {a.mpjpe:.1f} mm; fusion − triangulation {apart}",
                abs(apart.mean) <= _APART_MM,
                ours=method == DEFAULT,
            )
        )
    return out


ABLATION = Ablation("initialisation", "Start of the optimisation, by detections", (_LABEL,), 300, _run)
