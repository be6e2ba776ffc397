"""What an ablation gives: tables with the paper's rows beside ours, and what became of its findings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from skelsplat.evaluation.ablations._source import Source

Progress = Callable[[str, int, int], None]
"""Called with what is being measured, poses done and poses in all."""


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table.

    Attributes
    ----------
    method, data : str
        What was run, or who reports it; on what.
    values : tuple of float or None
        One per column; None where there is none.
    origin : {"measured", "paper", "theory"}
    """

    method: str
    data: str
    values: tuple[float | None, ...]
    origin: Literal["measured", "paper", "theory"] = "measured"


@dataclass(frozen=True, slots=True)
class Table:
    """Figures of one unit.

    Attributes
    ----------
    title : str
    corner : str
        What the columns are.
    columns : tuple of str
    rows : tuple of Row
    unit : str
        ``"mm"``, ``"%"``, ``"ms"``, …
    digits : int
        After the point, when shown.
    chart : bool
        Whether it belongs into the chart.
    """

    title: str
    corner: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    unit: str = "mm"
    digits: int = 1
    chart: bool = True


@dataclass(frozen=True, slots=True)
class Finding:
    """A statement of the paper, tried on the measured figures.

    Attributes
    ----------
    claim : str
        What the paper finds, in words.
    paper, measured : str
        The figures of both.
    reproduced : bool
        Whether the measured figures say the same.
    ours : bool
        The claim is not the paper's but ours.
    """

    claim: str
    paper: str
    measured: str
    reproduced: bool
    ours: bool = False

    @property
    def verdict(self) -> str:
        """What became of it, in words."""
        if self.ours:
            return "holds" if self.reproduced else "does not hold"
        return "reproduced" if self.reproduced else "not reproduced"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Tables and findings of one ablation, and what to know about them."""

    tables: tuple[Table, ...]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Ablation:
    """An ablation of the paper.

    Attributes
    ----------
    name : str
        On the command line.
    title : str
    labels : tuple of str
        The paper's tables, as `skelsplat.evaluation.reported` calls them.
    poses : int
        How many are taken unless told otherwise: so many that two cores are done within a minute.
    run : callable
        Measures everything on a source of poses.
    """

    name: str
    title: str
    labels: tuple[str, ...]
    poses: int
    run: Callable[[Source], Outcome]
