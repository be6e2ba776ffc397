"""What a check returns: findings in words, and the numbers of every camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class Finding:
    """Something that is wrong, or most likely wrong.

    Attributes
    ----------
    kind : str
        ``"unit"``, ``"images"``, ``"exchanged"``, ``"offset"``, ``"resized"``, ``"turned"``, ``"moved"``,
        ``"disagrees"``, ``"recording"``, ``"geometry"`` or ``"detections"``.
    cameras : tuple of str
        The cameras it concerns; empty for all.
    text : str
        One or two sentences.
    numbers : dict
        What the sentences quote.
    """

    kind: str
    cameras: tuple[str, ...]
    text: str
    numbers: dict[str, Any] = field(default_factory=dict)


def once_right(findings: Sequence[Finding], camera: str) -> str:
    """Return a clause: a number of the camera holds once these findings are put right; empty without any."""
    if not findings:
        return ""
    names = list(dict.fromkeys(name for finding in findings for name in finding.cameras))
    if camera in names or not all(finding.cameras for finding in findings):
        return " once what stands above is put right"
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f" once {listed} {'is' if len(names) == 1 else 'are'} put right"


@dataclass(frozen=True)
class CameraRow:
    """Agreement of one camera with the others, as the files have it. Pixels of the original image.

    Attributes
    ----------
    name : str
    used : int
        Detections of the person.
    dlt_px, robust_px : float
        Median reprojection error of plain triangulation and of the robust solver from all cameras.
    weight : float
        Mean weight of its detections in the robust solver, 0 to 1.
    rejected : float
        Share of its detections that the robust solver rejects.
    left_out_px : float
        Median distance from where the *other* cameras say that the joints are; NaN with two cameras.
    best_offset : int
        By how many frames the camera's numbers are too high, as a finding says: its frame f + best_offset
        belongs to frame f of the others, so `--offset` takes the negative. 0 without such a finding.
    best_offset_px : float
        The median distance from what the others say when all that was found is put right.
    """

    name: str
    used: int
    dlt_px: float
    robust_px: float
    weight: float
    rejected: float
    left_out_px: float
    best_offset: int
    best_offset_px: float


@dataclass(frozen=True)
class RigReport:
    """All findings, gravest first, and a row for every camera (none without detections)."""

    findings: tuple[Finding, ...]
    cameras: tuple[CameraRow, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing was found."""
        return not self.findings
