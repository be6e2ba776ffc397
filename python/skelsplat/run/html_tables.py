"""The tables of ``report.html``: cameras and joints."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.run.report import MEANINGS
from skelsplat.run.summary import DOWN_WEIGHTED, finite_max, finite_median

if TYPE_CHECKING:
    from skelsplat.run.read import Inputs
    from skelsplat.run.summary import Group, Statistics
    from skelsplat.viz import report as page

_SHARED = (
    ("median [px]", "median reprojection error, start → refined"),
    ("90th percentile [px]", "of the reprojection error, start → refined"),
    ("used", "detections used"),
    ("missing", "no detection of the followed person"),
    ("not chosen", "of the missing: no person detected in this view matches the other cameras"),
    ("left out", "detections below the minimum confidence, or of a joint without a position"),
    ("down-weighted", f"detections used with a weight below {DOWN_WEIGHTED:g}, including the rejected ones"),
    (
        "rejected",
        f"detections used with a weight below {sk.REJECTED_WEIGHT:g}, which hardly affect the pose",
    ),
    ("weight", MEANINGS["mean_weight"]),
    ("swapped", MEANINGS["swapped"]),
)
_OF_JOINTS = (
    ("views used", "views with a detection that is used and not rejected: median over the frames (lowest)"),
    ("error bar [mm]", "standard deviation of the joint per axis: median over the frames (largest)"),
    ("moved [mm]", "median distance of the refined joint from its start"),
)


def camera_table(statistics: Statistics) -> page.Table:
    """Return a row per camera, and one for all."""
    from skelsplat.viz.report import Column, Table  # matplotlib takes long to load

    return Table(
        columns=[Column("camera"), *(Column(*column) for column in _SHARED)],
        rows=[_cells(group) for group in statistics.cameras],
        total=_cells(statistics.total),
    )


def joint_table(inputs: Inputs, statistics: Statistics) -> page.Table:
    """Return a row per joint."""
    from skelsplat.viz.report import Column, Table  # matplotlib takes long to load

    rows = []
    for j, group in enumerate(statistics.joints):
        views, bars = statistics.views_used[:, j], statistics.error_bar_mm[:, j]
        own = [
            f"{np.median(views):g} ({views.min()})",
            f"{number(finite_median(bars))} ({number(finite_max(bars), 0)})",
            number(finite_median(statistics.moved_mm[:, j])),
        ]
        rows.append([*_cells(group), *own])
    columns = [Column("joint"), *(Column(*column) for column in (*_SHARED, *_OF_JOINTS))]
    columns[-3] = Column(f"views used, of {len(inputs.rig)}", columns[-3].meaning)
    return Table(columns, rows)


def _cells(group: Group) -> list[str]:
    return [
        group.name,
        f"{number(group.before_px)} → {number(group.after_px)}",
        f"{number(group.p90_before_px)} → {number(group.p90_after_px)}",
        f"{group.used:,}",
        f"{group.missing:,}",
        f"{group.not_chosen:,}",
        f"{group.left_out:,}",
        share(group.down_weighted, group.used),
        share(group.rejected, group.used),
        number(group.mean_weight, 2),
        f"{group.swapped:,}",
    ]


def share(count: int, of: int) -> str:
    """Return a part as a percentage, a dash if it is a part of nothing."""
    return f"{100 * count / of:.1f}%" if of else "–"


def number(value: float, digits: int = 1) -> str:
    """Return a number as text, a dash if there is none."""
    return f"{value:,.{digits}f}" if math.isfinite(value) else "–"
