"""Findings on single frames: what is missing, contradictory or unusual there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, Index, Mask
from skelsplat._words import length
from skelsplat.findings import Finding, Subject
from skelsplat.run.joints import MOST_NAMES
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import Statistics, finite_median, frame_medians

# What is found in a frame: its index, the kind, whom it concerns, and numbers.
Case = tuple[int, str, Subject, dict[str, Any]]

# Unusual for the recording: this multiple of the median over its frames,
_RATIO = 3.0
# of the share of rejected detections at least the first of these, and the second whatever the others are;
_SHARE, _HIGH_SHARE = 0.1, 1 / 3
# of a joint's scatter also this multiple of the median of all.
_BAR_RATIO = 2.0
# In words, by kind, with the joints or cameras concerned; of one origin in this order, and of the same kind
# that of the first frame comes first.
_WORDS: dict[str, Callable[[str, Mapping[str, Any]], str]] = {
    "frame_empty": lambda _, __: "no detection could be used",
    "frame_diverged": lambda _, __: "diverged",
    "frame_max_steps": lambda _, __: "stopped at the step limit",
    "frame_unobserved": lambda names, _: f"unobserved: {names}",
    "frame_inferred": lambda names, _: f"inferred: {names}",
    "frame_weak": lambda names, _: f"weak: {names}",
    "frame_filled": lambda names, _: f"filled over time: {names}",
    "frame_swapped": lambda names, _: f"left–right swap in {names}",
    "frame_rejected": lambda _, n: f"{max(n['percent']):.0f}% of the detections rejected",
    "frame_error": lambda _, n: f"median reprojection error {max(n['median_px']):.1f} px",
    "frame_scatter": lambda names, n: (
        f"scatter far above normal: {names}, {length(max(n['scatter_mm']), 0)} mm"
    ),
}
_RANKS = {kind: rank for rank, kind in enumerate(_WORDS)}
# A stop reason that most frames share is not a finding on one of them.
_MOSTLY = 0.5


@dataclass(frozen=True)
class FrameFacts:
    """What single frames are judged from, of T frames, M cameras and N joints."""

    frames: Index  # (T,) their numbers
    stops: npt.NDArray[np.str_]  # (T,) the stop reasons
    status: npt.NDArray[np.str_]  # (T, N) of the poses written, where joints may be filled over time
    swapped: Mask  # (T, M) a camera's detections are swapped and used
    used: Index  # (T,) detections
    rejected: Index  # (T,) detections
    error_px: Array  # (T,) median over the detections
    scatter_mm: Array  # (T, N) of joints that are ok, else NaN

    @classmethod
    def of(
        cls, inputs: Inputs, outcome: Outcome, statistics: Statistics, status: npt.NDArray[np.str_]
    ) -> FrameFacts:
        """Return the facts of a run."""
        used = np.isfinite(statistics.error_after)
        return cls(
            inputs.frames,
            np.asarray(outcome.result.stop_reason),
            status,
            np.asarray((used & np.asarray(outcome.result.swapped)).any(axis=2)),
            used.sum(axis=(1, 2)),
            statistics.rejected.sum(axis=(1, 2)),
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
    def of(cls, facts: FrameFacts, statistics: Statistics, every: Iterable[FrameFacts]) -> Usual:
        """Return what is usual in these frames; ``every`` and the counts are of the whole recording."""
        there = facts.used > 0
        scatter = np.array([finite_median(joint) for joint in facts.scatter_mm.T])
        stops = statistics.stop_reasons
        return cls(
            float(np.median(_share(facts)[there])) if there.any() else 0.0,
            finite_median(facts.error_px),
            np.maximum(_RATIO * scatter, _BAR_RATIO * finite_median(facts.scatter_mm)),
            np.logical_and.reduce([(part.status == "unobserved").all(axis=0) for part in every]),
            stops.get("max_steps", 0) > _MOSTLY * sum(stops.values()),
        )


def find_in_frames(
    facts: Iterable[FrameFacts],
    usual: Usual,
    joints: Sequence[str],
    cameras: Sequence[str],
    most: int | None = None,
) -> tuple[list[Finding], int]:
    """Return what is unusual in single frames: a finding per kind and names, with its frames in order.

    Numbers are lists, one per frame. A joint that is unobserved in every frame, and a step limit that most
    frames reach, concern the recording and not a frame: see `find_findings` and the stop reasons. Of more
    than ``most`` the first ones are named; the number of those left out comes with the findings.
    """
    found: dict[tuple[int, str, Subject], list[tuple[int, dict[str, Any]]]] = {}
    count = 0
    for part in facts:
        for rank, cases in enumerate(
            (
                _stops(part, usual),
                _statuses(part, usual, joints),
                _named("frame_swapped", part.swapped, "cameras", cameras),
                _rejected(part, usual),
                _errors(part, usual),
                _scatter(part, usual, joints),
            )
        ):
            for frame, kind, subject, numbers in cases:
                count += 1
                if most is None or count <= most:
                    key = (rank, kind, subject)
                    found.setdefault(key, []).append((int(part.frames[frame]), numbers))
    findings = [
        _finding(kind, subject, found[rank, kind, subject])
        for rank, kind, subject in sorted(found, key=lambda key: (key[0], _RANKS.get(key[1], 0)))
    ]
    return findings, 0 if most is None else max(0, count - most)


def _finding(kind: str, subject: Subject, cases: Sequence[tuple[int, dict[str, Any]]]) -> Finding:
    first = cases[0][1].items()
    numbers = {name: value if name == "of" else [own[name] for _, own in cases] for name, value in first}
    subject = replace(subject, frames=tuple(frame for frame, _ in cases))
    return Finding(kind, "note", subject, numbers, sentence=_words(kind, subject, numbers))


def _words(kind: str, subject: Subject, numbers: Mapping[str, Any]) -> str:
    return _WORDS[kind](named(subject, numbers), numbers)


def named(subject: Subject, numbers: Mapping[str, Any]) -> str:
    """Return the joints or cameras of a frame's finding; of many, their number."""
    names = subject.joints or subject.cameras
    return ", ".join(names) if len(names) <= MOST_NAMES else f"{len(names)} of {numbers['of']}"


def problems_of(findings: Sequence[Finding]) -> list[Finding]:
    """Return what makes a frame a problem: all but inferred joints, which the rest of the body places."""
    return [finding for finding in findings if finding.kind != "frame_inferred"]


def rows_of(findings: Sequence[Finding], frames: Sequence[int]) -> list[tuple[int, int, str]]:
    """Join frames that follow each other with the same findings: (first frame, last frame, their words).

    ``frames`` are the numbers of all frames of the recording. Of numbers, the largest of the frames counts.
    """
    by_frame: dict[int, list[tuple[Finding, int]]] = {}
    for finding in findings:
        for place, frame in enumerate(finding.subject.frames):
            by_frame.setdefault(frame, []).append((finding, place))
    there = [(k, int(frame)) for k, frame in enumerate(frames) if int(frame) in by_frame]

    def key(place: tuple[int, tuple[int, int]]) -> Any:
        count, (k, frame) = place
        return k - count, [
            (finding.kind, named(finding.subject, finding.numbers)) for finding, _ in by_frame[frame]
        ]

    rows = []
    for _, places in groupby(enumerate(there), key):
        run = [frame for _, (_, frame) in places]
        words = [_in_frames(same) for same in zip(*(by_frame[frame] for frame in run), strict=True)]
        rows.append((run[0], run[-1], "; ".join(words)))
    return rows


def _in_frames(places: Sequence[tuple[Finding, int]]) -> str:
    """Return the words of findings of one kind, each at one of its frames, with the largest number."""
    first, _ = places[0]
    numbers = {
        name: [finding.numbers[name][k] for finding, k in places] if isinstance(values, list) else values
        for name, values in first.numbers.items()
    }
    return _words(first.kind, first.subject, numbers)


def _stops(facts: FrameFacts, usual: Usual) -> Iterator[Case]:
    kinds = {"no_observations": "frame_empty", "diverged": "frame_diverged", "max_steps": "frame_max_steps"}
    for reason, kind in kinds.items():
        if reason != "max_steps" or not usual.at_step_limit:
            yield from ((int(t), kind, Subject(), {}) for t in np.flatnonzero(facts.stops == reason))


def _statuses(facts: FrameFacts, usual: Usual, joints: Sequence[str]) -> Iterator[Case]:
    empty = facts.stops == "no_observations"
    unobserved = (facts.status == "unobserved") & ~empty[:, None] & ~usual.unobserved
    yield from _named("frame_unobserved", unobserved, "joints", joints)
    for kind in ("inferred", "weak", "filled"):
        yield from _named(f"frame_{kind}", facts.status == kind, "joints", joints)


def _share(facts: FrameFacts) -> Array:
    return np.asarray(facts.rejected / np.maximum(facts.used, 1))


def _rejected(facts: FrameFacts, usual: Usual) -> Iterator[Case]:
    share = _share(facts)
    where = (share >= _HIGH_SHARE) | (share >= max(_SHARE, _RATIO * usual.rejected))
    for t in np.flatnonzero(where):
        yield int(t), "frame_rejected", Subject(), {"percent": float(100 * share[t])}


def _errors(facts: FrameFacts, usual: Usual) -> Iterator[Case]:
    where = facts.error_px > _RATIO * usual.error_px  # False for NaN
    for t in np.flatnonzero(where):
        yield int(t), "frame_error", Subject(), {"median_px": float(facts.error_px[t])}


def _scatter(facts: FrameFacts, usual: Usual, joints: Sequence[str]) -> Iterator[Case]:
    """Yield joints whose scatter is far above their own median; weak ones have their own case."""
    where = facts.scatter_mm > usual.scatter_mm
    for t, kind, subject, numbers in _named("frame_scatter", where, "joints", joints):
        yield t, kind, subject, {**numbers, "scatter_mm": float(facts.scatter_mm[t][where[t]].max())}


def _named(kind: str, where: Mask, part: str, names: Sequence[str]) -> Iterator[Case]:
    """Yield a case for every frame with a True; its subject's ``part`` are the names of these."""
    for t in np.flatnonzero(where.any(axis=1)):
        chosen = tuple(names[int(i)] for i in np.flatnonzero(where[t]))
        subject = Subject(joints=chosen) if part == "joints" else Subject(cameras=chosen)
        yield int(t), kind, subject, {"of": len(names)}
