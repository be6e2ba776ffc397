"""What an ablation is and gives: tables with the published rows next to the measured ones, and claims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from skelsplat.evaluation.reported import ReportedRow, reported

if TYPE_CHECKING:
    from skelsplat.evaluation.ablations._source import Source

REPORTED = "SkelSplat (reported)"


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table."""

    # method, data: What was run, or who reports it; on what.
    method: str
    data: str
    values: tuple[float | None, ...]  # one per column; None where there is none
    origin: Literal["measured", "paper", "theory"] = "measured"


@dataclass(frozen=True, slots=True)
class Table:
    """Figures of one unit."""

    title: str
    corner: str  # what the columns are
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    unit: str = "mm"  # ``"mm"``, ``"%"``, ``"ms"``, …
    digits: int = 1  # after the point, when shown
    chart: bool = True  # whether it belongs into the chart


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
    return tuple(
        Row(
            REPORTED,
            ", ".join(_marks(row)),
            tuple(row.value(k) if k in row.keys else None for k in keys),
            "paper",
        )
        for row in reported(label).select("SkelSplat")
    )


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
