"""The paper's figures as rows of our tables and in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from skelsplat.evaluation.ablations._model import Row
from skelsplat.evaluation.reported import ReportedRow, reported

REPORTED = "SkelSplat (paper)"


def paper_rows(
    label: str, keys: Sequence[str], method: str | None = "SkelSplat", **setting: str
) -> tuple[Row, ...]:
    """Return the paper's rows with the columns `keys`; None in columns that the paper has not."""
    table = reported(label)
    return tuple(
        Row(
            REPORTED,
            ", ".join(_marks(row)),
            tuple(row.value(k) if k in row.keys else None for k in keys),
            "paper",
        )
        for row in table.select(method, **setting)
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
