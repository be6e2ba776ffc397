"""Views whose gradients are accumulated before a step (paper, table tab:abl-accumulation)."""

from __future__ import annotations

from skelsplat.evaluation.ablations._measure import Errors, difference
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import paper_rows, quote
from skelsplat.evaluation.ablations._source import PAPER, Source

_LABEL = "tab:abl-accumulation"
_VIEWS = (1, 2, 4)


def _run(source: Source) -> Outcome:
    keys = tuple(f"{views}" for views in _VIEWS)
    rows, steps, findings = [], [], []
    for sample in source.plain():
        starts = source.starts(sample, "fusion")
        for rule, fields in (("", {}), (", no early stopping", {"stop_tolerance": 0.0})):
            found = {
                views: source.paper_errors(
                    sample, starts, f"{views} per step{rule}", views_per_step=views, **fields
                )
                for views in _VIEWS
                if views <= sample.n_views
            }
            name = f"{PAPER}{rule}"
            rows.append(Row(name, sample.name, tuple(found[v].mpjpe if v in found else None for v in _VIEWS)))
            steps.append(
                Row(name, sample.name, tuple(found[v].steps if v in found else None for v in _VIEWS))
            )
            if not rule and len(found) == len(_VIEWS):
                findings += _findings(sample.name, found)
    columns = tuple(f"{views} view{'s' * (views > 1)}" for views in _VIEWS)
    return Outcome(
        (
            Table("Views per step, MPJPE", "views per step", columns, (*rows, *paper_rows(_LABEL, keys))),
            Table(
                "Views per step, steps taken",
                "views per step",
                columns,
                tuple(steps),
                "steps",
                0,
                chart=False,
            ),
        ),
        tuple(findings),
        ("The default solver always uses all views at once.",),
    )


def _findings(name: str, found: dict[int, Errors]) -> list[Finding]:
    measured = ", ".join(f"{found[v].mpjpe:.1f}" for v in _VIEWS)
    four, two = difference(found[4], found[2]), difference(found[2], found[1])
    return [
        Finding(
            "4 views per step beat 2",
            quote(_LABEL, ("2", "4")),
            f"{name}: {measured} mm; 4 − 2 views {four}",
            four.is_less,
        ),
        Finding(
            "2 views per step beat 1",
            quote(_LABEL, ("1", "2")),
            f"{name}: {measured} mm; 2 − 1 views {two}",
            two.is_less,
        ),
    ]


ABLATION = Ablation("accumulation", "Views whose gradients are accumulated", (_LABEL,), 300, _run)
