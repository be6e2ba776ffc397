"""What to give to ``skelsplat refine`` for what was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from skelsplat.findings import Remedy

if TYPE_CHECKING:
    from skelsplat.findings import Finding
    from skelsplat.rig_check._report import CameraRow, RigReport


@dataclass(frozen=True)
class ReadAs:
    """How the detections were read from files, which their remedies depend on.

    Attributes
    ----------
    labels : tuple of str or None
        The folder, file or place in the file of each camera, as ``--order`` takes it.
    offsets : mapping of str to int
        By camera, frames that were added to its numbers.
    uneven : bool
        Cameras have different frames in the files.
    """

    labels: tuple[str | None, ...] = ()
    offsets: Mapping[str, int] = field(default_factory=dict)
    uneven: bool = False


def with_remedies(report: RigReport, read_as: ReadAs) -> RigReport:
    """Return the report with remedies for exchanged cameras and frame offsets."""
    owners: Mapping[str, str] = {}
    for finding in report.findings:
        if finding.kind == "cameras_exchanged":
            owners = finding.numbers["folders"]

    def given(camera: str) -> int:
        """Return the offset with which the detections that belong to a camera were read."""
        return read_as.offsets.get(owners.get(camera, camera), 0)

    rows = tuple(
        replace(row, offset_option=given(row.name) - row.best_offset if row.best_offset else None)
        for row in report.cameras
    )
    options = {row.name: row.offset_option for row in rows if row.offset_option is not None}
    findings = []
    for finding in report.findings:
        remedy: list[Remedy] = []
        if finding.kind == "cameras_exchanged":
            moved = {name: given(name) for name in finding.subject.cameras if name not in options}
            remedy = _order(finding, rows, read_as, moved)
        elif finding.kind == "frame_offset":
            (name,) = finding.subject.cameras
            remedy = [Remedy("offset", f"{name}={options[name]}")]
            remedy += [Remedy("frames", "intersection")] if read_as.uneven else []
        findings.append(replace(finding, remedy=tuple(remedy)))
    return replace(report, findings=tuple(findings), cameras=rows)


def _order(
    finding: Finding, rows: tuple[CameraRow, ...], read_as: ReadAs, moved: Mapping[str, int]
) -> list[Remedy]:
    """Return --order with the labels that belong to the cameras, and the offsets that move with them."""
    if not read_as.labels:
        return []
    label = dict(zip((row.name for row in rows), read_as.labels, strict=True))
    labels = [label[owner] or "" for owner in finding.numbers["folders"].values()]
    if any(text != text.strip() or not text or "," in text for text in labels):
        return []  # the option has no way to write it
    offsets = [
        Remedy("offset", f"{name}={frames}")
        for name, frames in moved.items()
        if frames != read_as.offsets.get(name, 0)
    ]
    return [Remedy("order", ",".join(labels)), *offsets]
