"""Number of views, 4 to 8 on a dome (paper, table tab:abl-views)."""

from __future__ import annotations

from skelsplat.evaluation.ablations._measure import Errors, difference, errors_of
from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Row, Table
from skelsplat.evaluation.ablations._paper import paper_rows, quote
from skelsplat.evaluation.ablations._sample import Sample
from skelsplat.evaluation.ablations._source import DEFAULT, PAPER, Source
from skelsplat.exceptions import InvalidInputError

_LABEL = "tab:abl-views"
_COUNTS = (4, 5, 6, 7, 8)
# Table tab:abl-views: 6 views err 30 % less than 4; 7 and 8 are within 7 % of 6.
_LARGE_GAIN = 0.8
_SMALL_CHANGE = 0.1


def _run(source: Source) -> Outcome:
    rows, findings = [], []
    for sample in source.many_views():
        counts = [count for count in _COUNTS if count <= sample.n_views]
        if len(counts) < 2:
            raise InvalidInputError(
                f"views: expected at least 5 cameras in {sample.name}, got {sample.n_views}"
            )
        found = _measured(source, sample, counts)
        for method, by_count in found.items():
            cells = tuple(by_count[c].mpjpe if c in by_count else None for c in _COUNTS)
            rows.append(Row(method, sample.name, cells))
        findings += _findings(f"{PAPER}, {sample.name}", found[PAPER])
    keys = tuple(f"{count}" for count in _COUNTS)
    table = Table(
        "Number of views, MPJPE",
        "views",
        tuple(f"{count} views" for count in _COUNTS),
        (*rows, *paper_rows(_LABEL, keys)),
    )
    return Outcome((table,), tuple(findings), ("Cameras are added in the data set's order.",))


def _measured(source: Source, sample: Sample, counts: list[int]) -> dict[str, dict[int, Errors]]:
    found: dict[str, dict[int, Errors]] = {"DLT": {}, PAPER: {}, DEFAULT: {}}
    for count in counts:
        seen = sample.first_views(count)
        starts = seen.starts("dlt")
        found["DLT"][count] = errors_of(seen, starts)
        found[PAPER][count] = source.paper_errors(seen, starts, f"{count} views")
        found[DEFAULT][count] = source.default_errors(seen, starts, f"{count} views")
    return found


def _findings(name: str, found: dict[int, Errors]) -> list[Finding]:
    figures = f"{name}: {', '.join(f'{e.mpjpe:.1f}' for e in found.values())} mm"
    last = max(found)
    out = [
        Finding(
            f"{last} views beat 4",
            quote(_LABEL, ("4", f"{last}")),
            f"{figures}; {last} − 4 views {difference(found[last], found[4])}",
            difference(found[last], found[4]).is_less,
        )
    ]
    if last < _COUNTS[-1]:
        return out
    six = found[6].mpjpe
    change = max(abs(found[k].mpjpe / six - 1) for k in (7, 8))
    slip = difference(found[6], found[7])
    return [
        *out,
        Finding(
            "6 views err at least a fifth less than 4",
            quote(_LABEL, ("4", "6")),
            f"{name}: {found[4].mpjpe:.1f}, {six:.1f} mm, {100 * (six / found[4].mpjpe - 1):+.0f} %",
            six <= _LARGE_GAIN * found[4].mpjpe,
        ),
        Finding(
            "Beyond 6 views little changes (at most 10 %)",
            quote(_LABEL, ("6", "7", "8")),
            f"{name}: 7 and 8 views within {100 * change:.0f} % of 6",
            change <= _SMALL_CHANGE,
        ),
        Finding(
            "The seventh camera makes it slightly worse (oblique, subject cropped)",
            quote(_LABEL, ("6", "7")),
            f"{name}: 6 − 7 views {slip}",
            slip.is_less,
        ),
    ]


ABLATION = Ablation("views", "Number of views", (_LABEL,), 72, _run)
