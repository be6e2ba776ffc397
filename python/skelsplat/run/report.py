"""``report.json``: everything about a run, for programs to read."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Index
from skelsplat._json import plain
from skelsplat._words import ordinal
from skelsplat.run.job import Job
from skelsplat.run.people import limb_spread
from skelsplat.run.read import Inputs
from skelsplat.run.solve import ASKED, NO_RATE, PAPER, PRIOR, SPARSE, Outcome, default_threads
from skelsplat.run.summary import DOWN_WEIGHTED, POOR_SHARE, Group, Statistics, finite_max, finite_median

if TYPE_CHECKING:
    from skelsplat.findings import Finding
    from skelsplat.run._run import Run
    from skelsplat.run.tracked import Everybody

MEANINGS = {
    "missing": "no detection of the followed person: not detected, or not_chosen",
    "not_chosen": "missing although people are detected in this view: none of them matches the other cameras",
    "mean_weight": "mean weight k of the detections used: how much each is trusted, from 0 to 1",
    "down_weighted": "detections used with a weight below down_weighted_below, including the rejected ones",
    "rejected": "detections used with a weight below rejected_below, which hardly affect the pose",
    "swapped": "detections assigned to the joint on the other side of the body",
    "views_used": "views per frame with a detection of the joint that is used and not rejected",
    "noise": "standard deviation of the detections' noise, estimated, median over the frames",
    "error_bar": "standard deviation from an anatomical joint, root mean square over the axes: scatter, and "
    "what detectors err by in all views and frames (settings.joint_bias_mm; null: published figures)",
    "scatter": "standard deviation between recordings of the same pose by the same detector, likewise",
    "solution": "over time: all frames together, with constant bones and smooth motion; or frame by frame",
    "inferred": "joint positions that bones and neighbouring frames determine, not two views of their frame",
    "start": "what before_px and moved are measured from: the initial pose if one was given, else DLT",
    "findings": "what to check before trusting the run",
    "frame_findings": "unusual single frames: their numbers are the frames of the subject; lists among the "
    "numbers have a value for each of them",
}
_ALONE = {
    ASKED: "Solved frame by frame, as asked.",
    PAPER: "Solved frame by frame, as always with the method paper.",
    PRIOR: "Solved frame by frame: a prior of the start (init_sigma_mm) is for single frames.",
    NO_RATE: "Solved frame by frame, as the frame rate (fps) is unknown.",
    SPARSE: "Solved frame by frame: most frames are missing.",
}
THINNED = (
    "a long recording: medians, largest and smallest values, and findings on cameras, people and limbs are "
    "from every so many-th frame; counts, means, findings on single frames and the pose files are from all"
)
_MEANING = (
    "distance of the pose's projection from the detection in px of the original image, over the detections "
    "used: agreement with the detections, not accuracy"
)


def build_report(
    inputs: Inputs, outcome: Outcome, statistics: Statistics, job: Job | None, remarks: dict[str, Any]
) -> dict[str, Any]:
    """Return the report as JSON values; a number that does not exist is None.

    ``job`` is None where the inputs were arrays; ``remarks`` are further entries, such as the findings.
    Lengths carry their unit in the key (``_mm``, ``_px``, ``_s``, ``_ms``); settings are those of
    `skelsplat.RefineConfig`.
    """
    report = {
        "versions": versions(),
        "input": input_of(inputs, job),
        "start": outcome.start_name,
        "solution": _solution(inputs, outcome, statistics),
        "settings": outcome.config.to_dict(),
        "ground_truth": None,
        "meanings": MEANINGS,
        "reprojection_error": _errors(statistics),
        "noise": {"median_mm": statistics.noise_mm, "median_px": statistics.noise_px},
        "joint_statuses": statistics.statuses,
        "stop_reasons": statistics.stop_reasons,
        "iterations": {
            "median": float(np.median(outcome.result.n_iter)),
            "max": int(np.max(outcome.result.n_iter)),
        },
        "timing": {
            "refine_s": outcome.seconds,
            "ms_per_frame": 1000 * outcome.seconds / inputs.n_frames,
            "threads": default_threads(outcome.config),
        },
        "note": None if job is None else job.note or None,
        **({"cameras_adjusted": list(inputs.adjusted)} if inputs.adjusted else {}),
        **remarks,
    }
    cleaned: dict[str, Any] = plain(report)
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
    found, joints, mm = outcome.sequence, inputs.layout.joints, inputs.rig.mm_per_unit
    if found is None:
        return {"method": "frame by frame", "reason": outcome.alone or None}
    lengths = zip(found.bones.tolist(), found.bone_lengths, found.bone_length_sigma, strict=True)
    bones = [
        {"joints": [joints[a], joints[b]], "length_mm": length * mm, "sigma_mm": sigma * mm}
        for (a, b), length, sigma in lengths
    ]
    inferred = statistics.statuses.get("inferred", 0)
    rate = {"fps": inputs.fps, "fps_from": inputs.fps_source or None}
    return {"method": "over time", **rate, "inferred": inferred, "bones": bones}


def solved_in_words(report: dict[str, Any]) -> list[str]:
    """Return how the frames were solved, in sentences; none where nothing else was possible."""
    solution = report["solution"]
    if solution["method"] == "frame by frame":
        return [_ALONE[solution["reason"]]] if solution["reason"] in _ALONE else []
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
    if inputs.thinned is None:
        return []
    every, drawn = ordinal(inputs.thinned.every), len(inputs.frames)
    return [
        "A long recording: medians, largest values, figures and findings on cameras and people are from "
        f"every {every} frame ({drawn:,}); counts, findings on single frames and the pose files are from all."
    ]


def input_of(inputs: Inputs, job: Job | None) -> dict[str, Any]:
    """Return the files, how they were read, and the recording; None for files without a job."""
    thinned = inputs.thinned
    options = ("order", "mapping", "sequence", "init", "init_sigma_mm")
    given = {name: getattr(job, name, None) for name in ("calibration", "detections", *options)}
    given |= {
        name: str(given[name]) for name in ("calibration", "detections", "init") if given[name] is not None
    }
    return {
        "calibration": given.pop("calibration"),
        "calibration_format": inputs.calibration_format,
        "detections": given.pop("detections"),
        "format": inputs.format,
        "offsets": dict(inputs.read_as.offsets),
        "without": list(inputs.without),
        "adjust_cameras": job is not None and job.adjust_cameras,
        **given,
        "unit": inputs.rig.unit,
        "layout": inputs.layout.name,
        "person": inputs.person,
        "frame_mode": None if job is None else job.frames,
        "frames": inputs.n_frames,
        "first_frame": inputs.span[0],
        "last_frame": inputs.span[1],
        "frame_rate_hz": inputs.fps,
        **({} if thinned is None else {"thinned": {"every": thinned.every, "meaning": THINNED}}),
    }


def _errors(statistics: Statistics) -> dict[str, Any]:
    return {
        "meaning": _MEANING,
        "down_weighted_below": DOWN_WEIGHTED,
        "rejected_below": sk.REJECTED_WEIGHT,
        "poor_share_of_diagonal": POOR_SHARE,
        "all": _group(statistics.total),
        "cameras": [
            {**_group(group), "poor_above_px": float(limit)}
            for group, limit in zip(statistics.cameras, statistics.poor_px, strict=True)
        ],
        "joints": _joints(statistics),
    }


def _joints(statistics: Statistics) -> list[dict[str, Any]]:
    return [
        {
            **_group(group),
            "views_used_median": float(np.median(statistics.views_used[:, j])),
            "views_used_min": int(statistics.views_used[:, j].min()),
            "moved_median_mm": finite_median(statistics.moved_mm[:, j]),
            "error_bar_median_mm": finite_median(statistics.error_bar_mm[:, j]),
            "error_bar_max_mm": finite_max(statistics.error_bar_mm[:, j]),
            "scatter_median_mm": finite_median(statistics.scatter_mm[:, j]),
            "scatter_max_mm": finite_max(statistics.scatter_mm[:, j]),
        }
        for j, group in enumerate(statistics.joints)
    ]


def _group(group: Group) -> dict[str, Any]:
    """Return the counts of a group, and as shares of the detections used; None without any."""
    shares = {"down_weighted_share": group.down_weighted_share, "rejected_share": group.rejected_share}
    return {**asdict(group), **(shares if group.used else dict.fromkeys(shares))}


def folder_of(identity: int) -> str:
    """Return the name of a person's folder."""
    return f"person_{identity}"


def build_people_report(
    everybody: Everybody, runs: Mapping[int, Run], findings: Sequence[Finding], job: Job
) -> dict[str, Any]:
    """Return the report as JSON values; ``findings`` are those on everybody."""
    whole = everybody.whole
    report = {
        "versions": versions(),
        "input": {**input_of(whole, job), "person": None, "people": job.people},
        "settings": next(iter(runs.values())).outcome.config.to_dict(),
        "people": [_entry(identity, run) for identity, run in runs.items()],
        "detections": {
            "meaning": "people detected, over all frames, and how many of them are one of those above",
            "cameras": [
                {"name": name, "detected": int(detected), "assigned": int(assigned)}
                for name, detected, assigned in zip(
                    whole.rig.names,
                    everybody.detected.sum(axis=0),
                    everybody.assigned.sum(axis=0),
                    strict=True,
                )
            ],
        },
        "findings": [finding.to_dict() for finding in findings],
        "note": job.note or None,
        **({"cameras_adjusted": list(whole.adjusted)} if whole.adjusted else {}),
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
