"""report.json of several people: who is there when, errors, and the findings on each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Index
from skelsplat._json import plain
from skelsplat.run.people import limb_spread
from skelsplat.run.report import input_of, versions
from skelsplat.run.summary import finite_median

if TYPE_CHECKING:
    from skelsplat.findings import Finding
    from skelsplat.run._run import Run
    from skelsplat.run.job import Job
    from skelsplat.run.tracked import Everybody


def folder_of(identity: int) -> str:
    """Return the name of a person's folder."""
    return f"person_{identity}"


def build_people_report(
    everybody: Everybody, runs: Mapping[int, Run], findings: Sequence[Finding], job: Job
) -> dict[str, Any]:
    """Return the report as JSON values; ``findings`` are those on everybody."""
    report = {
        "versions": versions(),
        "input": {**input_of(everybody.whole, job), "person": None, "people": job.people},
        "settings": next(iter(runs.values())).outcome.config.to_dict(),
        "people": [_entry(identity, run) for identity, run in runs.items()],
        "detections": {
            "meaning": "people detected, over all frames, and how many of them are one of those above",
            "cameras": [
                {"name": name, "detected": int(detected), "assigned": int(assigned)}
                for name, detected, assigned in zip(
                    everybody.whole.rig.names,
                    everybody.detected.sum(axis=0),
                    everybody.assigned.sum(axis=0),
                    strict=True,
                )
            ],
        },
        "findings": [finding.to_dict() for finding in findings],
        "note": job.note or None,
        "files": [],
        "folders": [folder_of(identity) for identity in runs],
    }
    cleaned: dict[str, Any] = plain(report)
    return cleaned


def _entry(identity: int, run: Run) -> dict[str, Any]:
    """Return what the report says of one person."""
    seen = np.isfinite(run.detections[..., 0]).any(axis=-1)  # (F, M)
    views = seen.sum(axis=1)
    total = run.statistics.total
    return {
        "id": identity,
        "folder": folder_of(identity),
        "first_frame": run.frames[0],
        "last_frame": run.frames[-1],
        "frames": len(run.frames),
        "seen": spans(run.frames[views > 0]),
        "seen_by_two": int((views >= 2).sum()),
        "views_median": float(np.median(views)),
        "cameras": [
            {"name": name, "frames": int(count)}
            for name, count in zip(run.cameras.names, seen.sum(axis=0), strict=True)
        ],
        "median_error_px": total.after_px,
        "rejected_share": total.rejected_share,
        "error_bar_median_mm": finite_median(run.statistics.error_bar_mm),
        "limb_range": limb_range(run),
        "findings": [finding.to_dict() for finding in run.findings],
    }


def spans(frames: Index) -> list[list[int]]:
    """Return the first and the last of every stretch of successive frame numbers."""
    ends = np.flatnonzero(np.diff(frames) > 1)
    first, last = np.concatenate([[0], ends + 1]), np.concatenate([ends, [len(frames) - 1]])
    return [[int(frames[a]), int(frames[b])] for a, b in zip(first, last, strict=True)] if len(frames) else []


def limb_range(run: Run) -> float:
    """Return how far the lengths of arms and legs range frame by frame, 5th to 95th percentile.

    As a part of the length, median over the limbs; a body has the same length in all frames.
    """
    result = run.result
    in_time = isinstance(result, sk.SequenceRefinement)
    pose = np.asarray(result.init_pose if in_time else result.pose)
    known = (np.asarray(result.joint_status) == "ok") & np.isfinite(pose).all(axis=-1)
    limbs = [limb for pair in run.layout.symmetric_pairs(2) for limb in pair]
    return finite_median(limb_spread(pose, np.asarray(result.uncertainty), known, limbs).relative)
