"""What an ablation is and gives, and the common kind: one setting, varied on the same poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skelsplat._arrays import Array
from skelsplat.evaluation.ablations._sample import Errors, Sample, difference, errors_of
from skelsplat.evaluation.ablations._source import PAPER, Kind, Source
from skelsplat.evaluation.reported import ReportedRow, reported
from skelsplat.evaluation.tables import Column, Row, Table
from skelsplat.exceptions import InvalidInputError

REPORTED = "SkelSplat (reported)"


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper, checked on the measured figures."""

    claim: str  # what the paper finds, in words
    # paper, measured: The figures of both.
    paper: str
    measured: str
    reproduced: bool  # whether the measured figures say the same
    ours: bool = False  # the claim is not the paper's but ours

    @property
    def verdict(self) -> str:
        """What became of it, in words."""
        if self.ours:
            return "holds" if self.reproduced else "does not hold"
        return "reproduced" if self.reproduced else "not reproduced"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Tables and claims of one ablation, and what to know about them."""

    tables: tuple[Table, ...]
    claims: tuple[Claim, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Ablation:
    """An ablation of the paper."""

    name: str  # on the command line
    title: str
    labels: tuple[str, ...]  # the paper's tables, as `skelsplat.evaluation.reported` calls them
    poses: int  # how many are taken unless told otherwise: so many that two cores are done within a minute
    run: Callable[[Source], Outcome]  # measures everything on a source of poses


def reported_rows(label: str, keys: Sequence[str]) -> tuple[Row, ...]:
    """Return the paper's rows with the columns `keys`; None in columns that the paper does not have."""
    rows = {
        ", ".join(_marks(row)): tuple(row.value(k) if k in row.keys else None for k in keys)
        for row in reported(label).select("SkelSplat")
    }
    return tuple(Row(REPORTED, values, "reported", data) for data, values in rows.items())


def quote(label: str, keys: Sequence[str], **setting: str) -> str:
    """Return the figures of the paper's rows in one line: ``metrabs 29.4, 26.7; resnet152 21.9, 20.3 mm``."""
    table = reported(label)
    parts = []
    for row in table.select("SkelSplat", **setting):
        figures = ", ".join(f"{row.value(key):{'g' if table.unit == 's' else '.1f'}}" for key in keys)
        parts.append(f"{' '.join(_marks(row, setting))} {figures}".strip())
    return f"{'; '.join(parts)} {table.unit}" if parts else "no figures for these data"


def _marks(row: ReportedRow, known: dict[str, str] | None = None) -> list[str]:
    marks = [value for name, value in row.setting.items() if name not in (known or {})]
    return [*marks, row.detector] if row.detector else marks


IN_THE_TEXT = "stated in the text, without figures"
MOST = "most"
"""In a `Check`: the largest value that was measured."""

Varied = Callable[[Any], tuple[Sample, list[Array]]]
"""A value of the setting → the poses and starts that it is measured on."""


@dataclass(frozen=True, slots=True)
class Line:
    """A row of the table."""

    name: str
    # Value → what it changes in the settings of the method; None for a value that is not measured. Without it
    # the starts themselves are measured.
    fields: Callable[[Any], Mapping[str, Any] | None] | None = None
    method: str = PAPER


@dataclass(frozen=True, slots=True)
class Check:
    """A claim about the errors of some values relative to those of others, in one row of the table.

    Without limits each of `values` has to err less than each of `others`, by more than twice the standard
    error of the paired difference.
    """

    text: str
    # values, others: Values of the sweep; the claim is left out if one was not measured.
    values: tuple[Any, ...]
    others: tuple[Any, ...]
    # low, high: Limits of the ratio of the errors.
    low: float = 0.0
    high: float = float("inf")
    within_mm: float | None = None  # limit of the mean difference
    row: str = PAPER
    paper: str = ""  # what the paper says; "" quotes its figures
    ours: bool = False  # the claim is not the paper's

    def claim(
        self, label: str, headers: Mapping[Any, str], sample: Sample, found: Mapping[Any, Errors]
    ) -> Claim | None:
        """Check it on errors by value; `label` names the paper's table, `headers` the values."""
        most = max(found, default=None) if MOST in self.values else None
        values = tuple(most if value == MOST else value for value in self.values)
        if not {*values, *self.others} <= set(found):
            return None
        pairs = [(a, b) for a in values for b in self.others]
        if self.low > 0.0 or self.high < float("inf"):
            ratios = [found[a].mpjpe / found[b].mpjpe for a, b in pairs]
            holds = all(self.low <= ratio <= self.high for ratio in ratios)
            changes = ", ".join(f"{100 * (ratio - 1):+.1f}" for ratio in ratios) + " %"
        else:
            apart = [difference(found[a], found[b]) for a, b in pairs]
            limit = self.within_mm
            holds = all(d.is_less if limit is None else abs(d.mean) <= limit for d in apart)
            changes = ", ".join(
                f"{headers[a]} − {headers[b]} {d}" for (a, b), d in zip(pairs, apart, strict=True)
            )
        shown = [value for value in found if value in (*values, *self.others)]
        figures = ", ".join(f"{found[value].mpjpe:.1f}" for value in shown)
        by_dataset = any("dataset" in row.setting for row in reported(label))
        setting = {"dataset": sample.dataset} if by_dataset else {}
        return Claim(
            ", ".join([self.text.format(most), *setting.values()]),
            self.paper or quote(label, [key(value) for value in shown], **setting),
            f"{self.row}, {sample.name}: {figures} mm; {changes}",
            holds,
            self.ours,
        )


def key(value: Any) -> str:
    """Return a value as the columns of published tables are named."""
    return value if isinstance(value, str) else f"{value:g}"


def as_in_the_paper(source: Source, sample: Sample) -> Varied:
    """Start where the paper does, at every value."""
    starts = source.starts(sample)
    return lambda _: (sample, starts)


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A setting that is varied."""

    label: str  # the paper's table
    # title, corner: Of our table, and what its columns are.
    title: str
    corner: str
    values: Mapping[Any, str]  # values, which are also the columns of the paper's table (`key`), to headers
    lines: tuple[Line, ...]
    checks: tuple[Check, ...]
    kinds: tuple[Kind, ...] = ("plain",)  # what of the source is measured
    notes: tuple[str, ...] = ()
    begin: Callable[[Source, Sample], Varied] = as_in_the_paper  # source and sample → `Varied`
    up_to_views: bool = False  # values are numbers of views: those above the sample's are left out
    steps: str = ""  # title of a second table, with the steps taken; "" is none
    more: Callable[[Source, Sequence[Sample]], Outcome] | None = None  # what else is measured, on all samples

    def __call__(self, source: Source) -> Outcome:
        """Measure every value on every sample, and check the claims."""
        samples = source.samples(*self.kinds)
        found = [(sample, self._measured(source, sample)) for sample in samples]
        columns = tuple(Column(header) for header in self.values.values())
        theirs = reported_rows(self.label, [key(value) for value in self.values])
        rows = [row for each in found for row in self._rows(*each, lambda errors: errors.mpjpe)]
        tables = [Table(self.title, self.corner, columns, (*rows, *theirs), unit="mm")]
        if self.steps:
            taken = tuple(row for each in found for row in self._rows(*each, lambda errors: errors.steps))
            whole = tuple(Column(header, 0) for header in self.values.values())
            tables.append(Table(self.steps, self.corner, whole, taken, unit="steps", chart=False))
        claims = [
            check.claim(self.label, self.values, sample, errors[check.row])
            for sample, errors in found
            for check in self.checks
        ]
        more = Outcome((), ()) if self.more is None else self.more(source, samples)
        return Outcome(
            (*tables, *more.tables),
            (*(claim for claim in claims if claim is not None), *more.claims),
            (*self.notes, *more.notes),
        )

    def _measured(self, source: Source, sample: Sample) -> dict[str, dict[Any, Errors]]:
        """Return errors by row and value."""
        values = [v for v in self.values if not (self.up_to_views and v > sample.n_views)]
        if len(values) < 2:
            expected = f"at least {sorted(self.values)[1]} cameras in {sample.name}"
            raise InvalidInputError(f"views: expected {expected}, got {sample.n_views}")
        varied = self.begin(source, sample)
        found: dict[str, dict[Any, Errors]] = {line.name: {} for line in self.lines}
        for value in values:
            poses, starts = varied(value)
            for line in self.lines:
                if line.fields is None:
                    found[line.name][value] = errors_of(poses, starts)
                elif (fields := line.fields(value)) is not None:
                    doing = f"{self.corner} {self.values[value]}"
                    found[line.name][value] = source.errors(line.method, poses, starts, doing, **fields)
        return found

    def _rows(
        self, sample: Sample, found: Mapping[str, Mapping[Any, Errors]], figure: Callable[[Errors], float]
    ) -> list[Row]:
        return [
            Row(name, tuple(figure(by[v]) if v in by else None for v in self.values), data=sample.name)
            for name, by in found.items()
        ]
