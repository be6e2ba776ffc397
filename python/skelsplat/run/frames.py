"""Findings on joints, and on single frames: what is rejected, missing, contradictory or unusual there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, Index, Mask
from skelsplat._words import decimals, length, number
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import Statistics, finite_median, frame_medians

# Unusual for the recording: this multiple of the median over its frames,
_RATIO = 3.0
# of the share of rejected detections at least the first of these, and the second whatever the others are;
_SHARE, _HIGH_SHARE = 0.1, 1 / 3
# of a joint's scatter also, and of its median always, this multiple of the median of all.
_BAR_RATIO = 2.0
# Most: at least this share.
MOSTLY = 0.5
# Cases that are named, of all together.
_MOST = 50_000
# Names and frame numbers that a sentence lists; the rest are counted.
MOST_NAMES = 6
# What is said of joints that are not determined, by kind of finding.
_STATUS = {
    "weak_joints": "Weak joints, which are written as usual (fewer than two views agree, or equally many "
    "agree on another position)",
    "unobserved_joints": "Unobserved joints (no usable detection, or one view only; they keep their initial "
    "position, if any)",
}
# Frames by kind and joint.
JointFrames = dict[tuple[str, int], list[int]]
# What is said of a frame, before the names of joints or cameras if there are any, by kind of finding.
_WORDS = {
    "frame_stopped": ("no detection could be used", "diverged", "stopped at the step limit"),
    "frame_joints": ("unobserved", "weak", "filled over time"),
    "frame_inferred": ("inferred",),
    "frame_swapped": ("left–right swap",),
    "frame_unusual": ("many detections rejected", "large reprojection error", "scatter far above normal"),
}
_KINDS = {words: kind for kind, every in _WORDS.items() for words in every}
_Texts = npt.NDArray[np.str_]
# What is said, in which frames (T,) or of which joints or cameras of them (T, K), their K names, and numbers
# of every frame, each (T,).
_Case = tuple[str, Mask, Sequence[str], dict[str, Array]]


def some(joints: Sequence[str]) -> str:
    """Return the joints, the first of many and the number of the others."""
    more = len(joints) - MOST_NAMES
    return ", ".join(joints) if more <= 1 else f"{', '.join(joints[:MOST_NAMES])} and {more} more joints"


def frames_in_words(numbers: Sequence[int], count: int | None = None) -> str:
    """Return the numbers of frames, of many how many they are; ``count`` if not all are named."""
    count = len(numbers) if count is None else count
    if count > MOST_NAMES:
        return f"{count} frames"
    return f"frame{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"


def find_joints(alone: Statistics, statistics: Statistics) -> Iterator[Finding]:
    """Yield findings on joints that most views reject, frame by frame, and on uncertain ones."""
    rejected = tuple(group["name"] for group in alone.joints if group["rejected_share"] >= MOSTLY)
    if 0 < len(rejected) <= MOSTLY * len(alone.joints):  # of more, the whole recording is in doubt
        words = f"Most detections are rejected for {some(rejected)}."
        yield Finding("many_rejected", "warning", Subject(joints=rejected), sentence=words)
    typical = finite_median(statistics.scatter_mm)
    names = [group["name"] for group in statistics.joints]
    wide = {name: finite_median(mm) for name, mm in zip(names, statistics.scatter_mm.T, strict=True)}
    wide = {name: mm for name, mm in wide.items() if mm > _BAR_RATIO * typical}
    if wide:
        sizes = some([f"{name} ({number(mm, decimals(typical, 0))} mm)" for name, mm in wide.items()])
        words = f"Scatter far above the median of {length(typical, 0)} mm: {sizes}."
        numbers = {"median_scatter_mm": typical, "scatter_mm": [*wide.values()]}
        yield Finding("joints_uncertain", "warning", Subject(joints=tuple(wide)), numbers, sentence=words)


def joint_frames(inputs: Inputs, outcome: Outcome, written: _Texts) -> JointFrames:
    """Return the frames in which joints are weak, or unobserved: without a position of their own.

    Not those declared missing, nor those ``written`` (T, N) as filled over time.
    """
    status, placed = np.asarray(outcome.result.joint_status), np.isfinite(outcome.result.pose).all(axis=-1)
    asked = np.array([joint not in inputs.lacking for joint in inputs.layout.joints])
    left, weak = asked & (written != "filled"), status == "weak"
    found: JointFrames = {}
    unobserved = (status == "unobserved") | (weak & ~placed)
    for kind, where in (("weak_joints", left & weak & placed), ("unobserved_joints", left & unobserved)):
        for j in np.flatnonzero(where.any(axis=0)).tolist():
            found[kind, j] = inputs.frames[where[:, j]].tolist()
    return found


def find_statuses(
    inputs: Inputs, found: JointFrames, counts: Mapping[tuple[str, int], int]
) -> Iterator[Finding]:
    """Yield findings on weak and unobserved joints; ``counts`` are of the frames, ``found`` has the first."""
    names, gaps = inputs.layout.joints, Remedy("fill_gaps", None)
    for kind, label in _STATUS.items():
        by_joint = {j: frames for (own, j), frames in sorted(found.items()) if own == kind}
        if not by_joint:
            continue
        in_all = {j: counts.get((kind, j), len(frames)) for j, frames in by_joint.items()}
        numbers: dict[str, Any] = {"frames": [*by_joint.values()]}
        if any(in_all[j] > len(frames) for j, frames in by_joint.items()):
            numbers["frames_in_all"] = [*in_all.values()]
        told = some([f"{names[j]} ({frames_in_words(own, in_all[j])})" for j, own in by_joint.items()])
        remedy = [gaps, Remedy("fill_weak")] if kind == "weak_joints" else [gaps]
        remedy = remedy if any(_has_gaps(own, inputs.in_all) for own in by_joint.values()) else []
        subject = Subject(joints=tuple(names[j] for j in by_joint))
        yield Finding(kind, "warning", subject, numbers, tuple(remedy), sentence=f"{label}: {told}.")


def _has_gaps(missing: Sequence[int], every: Index) -> bool:
    """Whether some missing frames lie between others: beyond these there is nothing to fill from."""
    known = np.setdiff1d(every, missing)
    return any(known[0] < frame < known[-1] for frame in missing) if len(known) else False


@dataclass(frozen=True)
class FrameFacts:
    """What single frames are judged from, of T frames, M cameras and N joints."""

    frames: Index  # (T,) their numbers
    stops: _Texts  # (T,) the stop reasons
    status: _Texts  # (T, N) of the poses written, where joints may be filled over time
    swapped: Mask  # (T, M) a camera's detections are swapped and used
    rejected: Array  # (T,) share of the detections used, NaN without any
    error_px: Array  # (T,) median over the detections
    scatter_mm: Array  # (T, N) of joints that are ok, else NaN

    @classmethod
    def of(cls, inputs: Inputs, outcome: Outcome, statistics: Statistics, status: _Texts) -> FrameFacts:
        """Return the facts of a run."""
        used = np.isfinite(statistics.error_after)
        count, rejected = used.sum(axis=(1, 2)), statistics.rejected.sum(axis=(1, 2))
        return cls(
            inputs.frames,
            np.asarray(outcome.result.stop_reason),
            status,
            np.asarray((used & np.asarray(outcome.result.swapped)).any(axis=2)),
            np.where(count, rejected / np.maximum(count, 1), np.nan),
            frame_medians(statistics.error_after),
            np.where(status == "ok", statistics.scatter_mm, np.nan),
        )


@dataclass(frozen=True)
class Usual:
    """What is usual in a recording, against which single frames are judged."""

    rejected: float  # median share of the detections that are rejected
    error_px: float
    scatter_mm: Array  # (N,) beyond which a joint's scatter is unusual
    unobserved: Mask  # (N,) joints in every frame
    at_step_limit: bool  # most frames reach it

    @classmethod
    def of(cls, facts: FrameFacts, statistics: Statistics) -> Usual:
        """Return what is usual in these frames; the counts are of the whole recording."""
        scatter = np.array([finite_median(joint) for joint in facts.scatter_mm.T])
        stops = statistics.stop_reasons
        return cls(
            np.nan_to_num(finite_median(facts.rejected)),
            finite_median(facts.error_px),
            np.maximum(_RATIO * scatter, _BAR_RATIO * finite_median(facts.scatter_mm)),
            (facts.status == "unobserved").all(axis=0),
            stops.get("max_steps", 0) > MOSTLY * sum(stops.values()),
        )


def find_in_frames(
    facts: Iterable[FrameFacts], usual: Usual, joints: Sequence[str], cameras: Sequence[str]
) -> tuple[list[Finding], int]:
    """Return what is unusual in single frames: a finding per kind and names, with its frames in order.

    Numbers are lists, one per frame. A joint that is unobserved in every frame, and a step limit that most
    frames reach, concern the recording. Of very many the first are named; the rest is counted.
    """
    found: dict[tuple[int, str, tuple[str, ...]], dict[str, list[Any]]] = {}
    count = 0
    for part in facts:
        for rank, (words, where, names, numbers) in enumerate(_cases(part, usual, joints, cameras)):
            for t in np.flatnonzero(where if where.ndim == 1 else where.any(axis=1)):
                count += 1
                if count <= _MOST:
                    chosen = tuple(names[i] for i in np.flatnonzero(where[t]).tolist()) if names else ()
                    own = found.setdefault(
                        (rank, words, chosen), {"frames": [], **{key: [] for key in numbers}}
                    )
                    own["frames"].append(int(part.frames[t]))
                    for key, values in numbers.items():
                        own[key].append(float(values[t]))
    findings = []
    for (_, words, chosen), own in sorted(found.items(), key=lambda item: item[0][0]):
        kind, frames = _KINDS[words], tuple(own.pop("frames"))
        subject, names = Subject(frames=frames, joints=chosen), joints
        if kind == "frame_swapped":
            subject, names = Subject(frames=frames, cameras=chosen), cameras
        if not chosen:
            findings.append(Finding(kind, "note", subject, own, sentence=words))
            continue
        counted = {"of": len(names), **own}
        short = ", ".join(chosen) if len(chosen) <= MOST_NAMES else f"{len(chosen)} of {len(names)}"
        findings.append(Finding(kind, "note", subject, counted, sentence=f"{words}: {short}"))
    return findings, max(0, count - _MOST)


def _cases(facts: FrameFacts, usual: Usual, joints: Sequence[str], cameras: Sequence[str]) -> Iterator[_Case]:
    stops, status, share = facts.stops, facts.status, np.nan_to_num(facts.rejected)
    empty = stops == "no_observations"
    yield "no detection could be used", empty, (), {}
    yield "diverged", stops == "diverged", (), {}
    yield "stopped at the step limit", (stops == "max_steps") & (not usual.at_step_limit), (), {}
    unobserved = (status == "unobserved") & ~empty[:, None] & ~usual.unobserved
    yield "unobserved", unobserved, joints, {}
    for words in ("inferred", "weak"):
        yield words, status == words, joints, {}
    yield "filled over time", status == "filled", joints, {}
    yield "left–right swap", facts.swapped, cameras, {}
    many = (share >= _HIGH_SHARE) | (share >= max(_SHARE, _RATIO * usual.rejected))
    yield "many detections rejected", many, (), {"percent": 100 * share}
    large = facts.error_px > _RATIO * usual.error_px  # False for NaN
    yield "large reprojection error", large, (), {"median_px": facts.error_px}
    wide = facts.scatter_mm > usual.scatter_mm
    largest = np.where(wide, facts.scatter_mm, 0.0).max(axis=1)
    yield "scatter far above normal", wide, joints, {"scatter_mm": largest}


def problems_of(findings: Sequence[Finding]) -> list[Finding]:
    """Return what makes a frame a problem: all but inferred joints, which the rest of the body places."""
    return [finding for finding in findings if finding.kind != "frame_inferred"]


def rows_of(findings: Sequence[Finding], frames: Sequence[int]) -> list[tuple[int, int, str]]:
    """Join frames that follow each other with the same findings: (first frame, last frame, their words).

    ``frames`` are the numbers of all frames of the recording.
    """
    texts: dict[int, list[str]] = {}
    for finding in findings:
        for frame in finding.subject.frames:
            texts.setdefault(frame, []).append(finding.text)
    there = [(k, int(frame), "; ".join(texts[frame])) for k, frame in enumerate(frames) if frame in texts]
    rows = []
    for _, group in groupby(enumerate(there), lambda item: (item[1][0] - item[0], item[1][2])):
        run = [place for _, place in group]
        rows.append((run[0][1], run[-1][1], run[0][2]))
    return rows
