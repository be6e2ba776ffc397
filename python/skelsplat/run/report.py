"""``report.json``: everything about a run, for programs to read."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._json import plain
from skelsplat._words import ordinal
from skelsplat.run.bones import lengths_mm, percentiles
from skelsplat.run.read import Inputs
from skelsplat.run.solve import ALONE, Outcome, default_threads
from skelsplat.run.summary import DOWN_WEIGHTED, POOR_SHARE, Statistics, finite_median

if TYPE_CHECKING:
    from skelsplat.findings import Finding
    from skelsplat.run._run import Run
    from skelsplat.run.tracked import Everybody

_OF_FILES = ("calibration", "calibration_format", "detections", "format", "init", "mapping", "offsets")
MEANINGS = {
    "missing": "no detection of the followed person: not detected, or not_chosen",
    "not_chosen": "missing although people are detected in this view: none of them matches the other cameras",
    "left_out": "detections below the minimum confidence, or of a joint without a position",
    "mean_weight": "mean weight k of the detections used: how much each is trusted, from 0 to 1",
    "down_weighted": f"detections used with a weight below {DOWN_WEIGHTED:g}, including the rejected ones",
    "rejected": f"detections used with a weight below {sk.REJECTED_WEIGHT:g}, which hardly affect the pose",
    "swapped": "detections assigned to the joint on the other side of the body",
    "views_used": "views per frame with a detection of the joint that is used and not rejected",
    "noise": "standard deviation of the detections' noise, estimated, median over the frames",
    "error_bar": "standard deviation from an anatomical joint, root mean square over the axes: scatter, and "
    "what detectors err by in all views and frames (settings.joint_bias_mm; null: by joint), and what "
    "cameras found from people add",
    "scatter": "standard deviation between recordings of the same pose by the same detector, likewise",
    "start": "what before_px and moved are measured from: the initial pose if one was given, else DLT",
    "frame_findings": "unusual single frames: their numbers are the frames of the subject; lists among the "
    "numbers have a value for each of them",
    "reprojection_error": "distance of the pose's projection from the detection in px of the original image, "
    "over the detections used: agreement with the detections, not accuracy",
}


def build_report(
    inputs: Inputs, outcome: Outcome, statistics: Statistics, remarks: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the report as JSON values, with further ``remarks``; a number that does not exist is None.

    Lengths carry their unit in the key (``_mm``, ``_px``, ``_s``, ``_ms``).
    """
    steps = outcome.result.n_iter
    errors = {
        "down_weighted_below": DOWN_WEIGHTED,
        "rejected_below": sk.REJECTED_WEIGHT,
        "poor_share_of_diagonal": POOR_SHARE,
        "all": statistics.total,
        "cameras": statistics.cameras,
        "joints": statistics.joints,
    }
    timing = {
        "refine_s": outcome.seconds,
        "ms_per_frame": 1000 * outcome.seconds / len(inputs.in_all),
        "threads": default_threads(outcome.config),
    }
    own = {
        "input": input_of(inputs),
        "start": outcome.start_name,
        "solution": _solution(inputs, outcome, statistics),
        "ground_truth": None,
        "meanings": MEANINGS,
        "reprojection_error": errors,
        "noise": {"median_mm": statistics.noise_mm, "median_px": statistics.noise_px},
        "joint_statuses": statistics.statuses,
        "stop_reasons": statistics.stop_reasons,
        "iterations": {"median": float(np.median(steps)), "max": int(np.max(steps))},
        "timing": timing,
    }
    return _of_run(inputs, outcome, {**own, **remarks})


def _of_run(inputs: Inputs, outcome: Outcome, own: Mapping[str, Any]) -> dict[str, Any]:
    """Return a report with what those of one person and of several share."""
    adjusted = {"cameras_adjusted": list(inputs.adjusted)} if inputs.adjusted else {}
    shared = {"versions": versions(), "settings": outcome.config.to_dict(), "note": inputs.note or None}
    cleaned: dict[str, Any] = plain({**shared, **adjusted, "files": [], **own})
    return cleaned


def versions() -> dict[str, str]:
    """Return what the run was made with."""
    return {
        "skelsplat": sk.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "platform": platform.platform(),
    }


def _solution(inputs: Inputs, outcome: Outcome, statistics: Statistics) -> dict[str, Any]:
    """Return how the frames were solved, and the lengths of the bones if over time."""
    if outcome.sequence is None:
        return {"method": "frame by frame", "reason": outcome.alone or None}
    joints = inputs.layout.joints
    bones = [
        {"joints": [joints[a], joints[b]], "length_mm": length, "sigma_mm": sigma}
        for a, b, length, sigma in outcome.bones_mm(inputs)
    ]
    inferred = statistics.statuses.get("inferred", 0)
    rate = {"fps": inputs.fps, "fps_from": inputs.fps_source or None}
    return {"method": "over time", **rate, "inferred": inferred, "bones": bones}


def solved_in_words(report: dict[str, Any]) -> list[str]:
    """Return how the frames were solved, in sentences; none where nothing else was possible."""
    solution = report["solution"]
    if solution["method"] == "frame by frame":
        return [*filter(None, [ALONE.get(solution["reason"])])]
    rate = "" if solution["fps"] is None else f" at {solution['fps']:g} frames per second"
    source = solution.get("fps_from")
    bones = bool(solution["bones"])
    stated = f", as the {source} state" if source else f": {'constant bone lengths, ' * bones}smooth motion"
    found = [f"Solved over time{rate}{stated}."]
    if count := solution["inferred"]:
        what = "1 joint position is" if count == 1 else f"{count:,} joint positions are"
        found.append(f"{what} inferred from {'bones and ' * bones}neighbouring frames.")
    return found


def thinned_in_words(inputs: Inputs) -> list[str]:
    """Return what of a long recording is from a part of its frames, in a sentence; none of any other."""
    if not inputs.every:
        return []
    every, drawn = ordinal(inputs.every), len(inputs.frames)
    return [
        "A long recording: medians, largest values, figures and findings on cameras and people are from "
        f"every {every} frame ({drawn:,}); counts, findings on single frames and the pose files are from all."
    ]


def input_of(inputs: Inputs) -> dict[str, Any]:
    """Return the files, how they were read, and the recording; None for files where there are none."""
    return {
        **dict.fromkeys(_OF_FILES),
        **inputs.source,
        "unit": inputs.rig.unit,
        "layout": inputs.layout.name,
        "person": inputs.person,
        "frames": len(inputs.in_all),
        "first_frame": int(inputs.in_all[0]),
        "last_frame": int(inputs.in_all[-1]),
        "frame_rate_hz": inputs.fps,
        **({"thinned": {"every": inputs.every}} if inputs.every else {}),
    }


def build_people_report(
    everybody: Everybody, runs: Mapping[int, Run], findings: Sequence[Finding], people: str | int | None
) -> dict[str, Any]:
    """Return the report as JSON values; ``findings`` are those on everybody."""
    whole, names = everybody.whole, everybody.whole.rig.names
    counts = zip(names, everybody.detected.sum(axis=0), everybody.assigned.sum(axis=0), strict=True)
    detections = {
        "meaning": "people detected, over all frames, and how many of them are one of those above",
        "cameras": [
            {"name": name, "detected": int(seen), "assigned": int(own)} for name, seen, own in counts
        ],
    }
    own = {
        "input": {**input_of(whole), "person": None, "people": people},
        "people": [_entry(identity, run) for identity, run in runs.items()],
        "detections": detections,
        "findings": [finding.to_dict() for finding in findings],
        "folders": [folder_of(identity) for identity in runs],
    }
    return _of_run(whole, next(iter(runs.values())).outcome, own)


def folder_of(identity: int) -> str:
    """Return the name of a person's folder."""
    return f"person_{identity}"


def _entry(identity: int, run: Run) -> dict[str, Any]:
    """Return what the report says of one person."""
    seen = np.isfinite(run.detections[..., 0]).any(axis=-1)  # (F, M)
    views, cameras = seen.sum(axis=1), zip(run.cameras.names, seen.sum(axis=0), strict=True)
    there, total = run.frames[views > 0], run.statistics.total
    stretches = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
    return {
        "id": identity,
        "folder": folder_of(identity),
        "first_frame": run.frames[0],
        "last_frame": run.frames[-1],
        "frames": len(run.frames),
        "seen": [[int(own[0]), int(own[-1])] for own in stretches if len(own)],
        "seen_by_two": int((views >= 2).sum()),
        "views_median": float(np.median(views)),
        "cameras": [{"name": name, "frames": int(count)} for name, count in cameras],
        "median_error_px": total["after_px"],
        "rejected_share": total["rejected_share"],
        "error_bar_median_mm": finite_median(run.statistics.error_bar_mm),
        "limb_range": _limb_range(run),
        "findings": [finding.to_dict() for finding in run.findings],
    }


def _limb_range(run: Run) -> float:
    """Return how far the lengths of arms and legs range frame by frame, as a part of them."""
    limbs = [limb for pair in run.layout.symmetric_pairs(2) for limb in pair]
    pose = None if run.outcome.sequence is None else run.result.init_pose
    _, (low, median, high) = percentiles(lengths_mm(run.result, limbs, 1.0, pose)[0], 5, 50, 95)
    return finite_median((high - low) / median)
