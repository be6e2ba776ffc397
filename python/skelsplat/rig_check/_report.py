"""What a check returns: findings with settings that correct them, and every camera's numbers."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

import skelsplat as sk
from skelsplat._arrays import median
from skelsplat._clocks import rounded
from skelsplat.findings import Finding, Remedy
from skelsplat.rig_check._scene import Scene

# Errors before whose correction `skelsplat.adjust_cameras` would fit nonsense.
_OF_FILES = (
    *("unit_wrong", "pose_convention", "images_changed", "cameras_exchanged", "recording_other"),
    *("detections_same", "sides_swapped", "no_detections"),
)


Reported = TypeVar("Reported", sk.CalibratedCamera, sk.CameraAdjustment)


@dataclass(frozen=True)
class CameraRow:
    """Agreement of one camera with the others, as the files have it: medians, px of the original image."""

    name: str
    used: int  # detections of the person
    dlt_px: float  # reprojection error of plain triangulation from all cameras
    robust_px: float  # that of the robust solver
    weight: float  # mean weight of its detections in the robust solver, 0 to 1
    rejected: float  # the share of them that is rejected
    left_out_px: float  # distance from where the *other* cameras place the joints; NaN with two cameras
    best_offset: int  # its frame f + best_offset is frame f of the others; 0 without such a finding
    best_offset_px: float  # ``left_out_px`` when all that was found is corrected
    offset_option: float | None = None  # setting ``offsets`` that corrects it, including the one given


@dataclass(frozen=True)
class ReadAs:
    """How the detections were read from files, which their remedies depend on."""

    labels: tuple[str | None, ...] = ()  # folder, file or place in it of each camera, as of ``order``
    offsets: Mapping[str, float] = field(default_factory=dict)  # by camera, frames added to its numbers
    uneven: bool = False  # cameras have different frames in the files
    paces: Mapping[str, float] = field(default_factory=dict)  # by camera, its frames in one of the recording

    def in_files(self, report: Iterable[Reported], step: int) -> list[Reported]:
        """Return cameras with clocks in their own frames, not in every so many-th of the recording."""
        own = []
        for one in report:
            pace = step * self.paces.get(one.name, 1.0)
            own.append(replace(one, clock=one.clock * pace, clock_sigma=one.clock_sigma * pace))
        return own

    def offset_remedy(self, camera: str, offset: float) -> tuple[Remedy, ...]:
        """Return what corrects the clock of a camera: its offset, and the frames that all then have."""
        frames = (Remedy("frames", "intersection"),) if self.uneven else ()
        return (Remedy("offset", f"{camera}={offset}"), *frames)


@dataclass(frozen=True)
class RigReport:
    """All findings, gravest first, and a row for every camera (none without detections)."""

    findings: tuple[Finding, ...]
    cameras: tuple[CameraRow, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing was found, or notes alone, which are for information."""
        return all(finding.severity == "note" for finding in self.findings)

    @property
    def before_places(self) -> tuple[Finding, ...]:
        """What has to be corrected before cameras can be adjusted: faults of the files, not of places."""
        return tuple(one for one in self.findings if one.severity == "error" and one.kind in _OF_FILES)

    @property
    def misplaced(self) -> tuple[str, ...]:
        """The cameras that adjusting may set right, if nothing else has to be corrected before."""
        found = [] if self.before_places else [one for one in self.findings if one.kind == "camera_moved"]
        return tuple(name for finding in found for name in finding.subject.cameras)


def solved(scene: Scene, layout: sk.Layout | None = None) -> sk.Refinement:
    """Refine the judged frames; with a layout also where left and right are swapped."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a unit doubt, which has been looked at
        return sk.refine(None, scene.judged_detections, list(scene.cameras), layout=layout)


def rows_of(scene: Scene, corrected: Scene) -> list[CameraRow]:
    """Return the numbers of every camera in ``scene``; offsets are those of the ``corrected`` one."""
    detections, rig, result = scene.judged_detections, list(scene.cameras), solved(scene)
    plain = np.asarray(sk.triangulate(detections, rig, method="dlt"))
    rows = []
    for i, name in enumerate(scene.names):
        there = np.isfinite(detections[:, i, :, 0])
        weight = result.view_weights[:, i][there]
        weight = weight[np.isfinite(weight)]
        row = CameraRow(
            name=name,
            used=int(there.sum()),
            dlt_px=median(scene.distances(i, plain)),
            robust_px=median(np.asarray(result.reprojection_error)[:, i]),
            weight=float(weight.mean()) if weight.size else float("nan"),
            rejected=float((weight < sk.REJECTED_WEIGHT).mean()) if weight.size else float("nan"),
            left_out_px=float(scene.left_out[i]) if len(rig) > 2 else float("nan"),
            best_offset=corrected.shifts[i],
            best_offset_px=float(corrected.left_out[i]),
        )
        rows.append(row)
    return rows


def with_remedies(report: RigReport, read_as: ReadAs) -> RigReport:
    """Return the report with remedies for exchanged and misplaced cameras and frame offsets."""
    exchanged = [one.numbers["folders"] for one in report.findings if one.kind == "cameras_exchanged"]
    owners: Mapping[str, str] = exchanged[-1] if exchanged else {}
    # the offsets with which the detections that belong to a camera were read
    given = {row.name: read_as.offsets.get(owners.get(row.name, row.name), 0) for row in report.cameras}
    paces = {row.name: read_as.paces.get(owners.get(row.name, row.name), 1) for row in report.cameras}
    options = {
        row.name: rounded(given[row.name] - paces[row.name] * row.best_offset)
        for row in report.cameras
        if row.best_offset
    }
    findings = []
    for finding in report.findings:
        remedy: tuple[Remedy, ...] = ()
        names = finding.subject.cameras
        if finding.kind == "cameras_exchanged":
            moved = {name: rounded(given[name]) for name in names if name not in options}
            remedy = _order(list(owners.values()), list(owners), read_as, moved)
        elif finding.kind == "frame_offset":
            remedy = read_as.offset_remedy(names[0], options[names[0]])
        elif finding.kind == "camera_moved" and report.misplaced:
            remedy = (Remedy("adjust_cameras"),)
        elif finding.kind == "unit_wrong" and finding.numbers["likely"]:
            remedy = (Remedy("unit", finding.numbers["likely"]),)
        elif finding.kind == "sides_swapped" and len(report.cameras) > 2:
            remedy = (Remedy("without", *names),)
        findings.append(replace(finding, remedy=remedy))
    rows = (replace(row, offset_option=options.get(row.name)) for row in report.cameras)
    return RigReport(tuple(findings), tuple(rows))


def _order(
    owners: list[str], cameras: list[str], read_as: ReadAs, moved: Mapping[str, float]
) -> tuple[Remedy, ...]:
    """Return the order of the labels that belong to the cameras, and the offsets that move with them."""
    if not read_as.labels:
        return ()
    label = dict(zip(cameras, read_as.labels, strict=True))
    labels = [label[owner] or "" for owner in owners]
    if any(text != text.strip() or not text or "," in text for text in labels):
        return ()  # the option has no way to write it
    changed = {name: frames for name, frames in moved.items() if frames != read_as.offsets.get(name, 0)}
    offsets = (Remedy("offset", f"{name}={frames}") for name, frames in changed.items())
    return (Remedy("order", ",".join(labels)), *offsets)
