"""Findings on single frames: what is missing, contradictory or unusual there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Mask
from skelsplat._sentences.run import named
from skelsplat.findings import Finding, Subject
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
# A stop reason that most frames share is not a finding on one of them.
_MOSTLY = 0.5


def find_in_frames(
    inputs: Inputs, outcome: Outcome, statistics: Statistics, status: npt.NDArray[np.str_]
) -> list[Finding]:
    """Return what is unusual in single frames: a finding per kind and names, with its frames in order.

    Numbers are lists, one per frame. ``status`` (T, N) is that of the poses written, where joints may be
    filled over time. A joint that is unobserved in every frame, and a step limit that most frames reach,
    concern the recording and not a frame: see `find_findings` and the stop reasons.
    """
    empty = np.asarray(outcome.result.stop_reason) == "no_observations"
    swapped = np.isfinite(statistics.error_after) & np.asarray(outcome.result.swapped)
    found: dict[tuple[str, Subject], list[tuple[int, dict[str, Any]]]] = {}
    for frame, kind, subject, numbers in (
        *_stops(outcome),
        *_statuses(status, empty, inputs.layout.joints),
        *_named("frame_swapped", np.asarray(swapped.any(axis=2)), "cameras", inputs.rig.names),
        *_rejected(statistics),
        *_errors(statistics),
        *_scatter(statistics, status, inputs.layout.joints),
    ):
        found.setdefault((kind, subject), []).append((int(inputs.frames[frame]), numbers))
    findings = []
    for (kind, subject), cases in found.items():
        numbers = {
            name: value if name == "of" else [own[name] for _, own in cases]
            for name, value in cases[0][1].items()
        }
        named_frames = replace(subject, frames=tuple(frame for frame, _ in cases))
        findings.append(Finding(kind, "note", named_frames, numbers))
    return findings


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
        return k - count, [(finding.kind, named(finding)) for finding, _ in by_frame[frame]]

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
    return replace(first, numbers=numbers).text


def _stops(outcome: Outcome) -> Iterator[Case]:
    stops = np.asarray(outcome.result.stop_reason)
    for reason, kind in (
        ("no_observations", "frame_empty"),
        ("diverged", "frame_diverged"),
        ("max_steps", "frame_max_steps"),
    ):
        where = stops == reason
        if reason != "max_steps" or where.mean() <= _MOSTLY:
            yield from ((int(t), kind, Subject(), {}) for t in np.flatnonzero(where))


def _statuses(status: npt.NDArray[np.str_], empty: Mask, joints: Sequence[str]) -> Iterator[Case]:
    everywhere = (status == "unobserved").all(axis=0)
    unobserved = (status == "unobserved") & ~empty[:, None] & ~everywhere
    yield from _named("frame_unobserved", unobserved, "joints", joints)
    for kind in ("inferred", "weak", "filled"):
        yield from _named(f"frame_{kind}", status == kind, "joints", joints)


def _rejected(statistics: Statistics) -> Iterator[Case]:
    used = np.isfinite(statistics.error_after).sum(axis=(1, 2))
    share = statistics.rejected.sum(axis=(1, 2)) / np.maximum(used, 1)
    usual = float(np.median(share[used > 0])) if used.any() else 0.0
    where = (share >= _HIGH_SHARE) | (share >= max(_SHARE, _RATIO * usual))
    for t in np.flatnonzero(where):
        yield int(t), "frame_rejected", Subject(), {"percent": float(100 * share[t])}


def _errors(statistics: Statistics) -> Iterator[Case]:
    median = frame_medians(statistics.error_after)
    where = median > _RATIO * finite_median(median)  # False for NaN
    for t in np.flatnonzero(where):
        yield int(t), "frame_error", Subject(), {"median_px": float(median[t])}


def _scatter(statistics: Statistics, status: npt.NDArray[np.str_], joints: Sequence[str]) -> Iterator[Case]:
    """Yield joints whose scatter is far above their own median; weak ones have their own case."""
    scatter = np.where(status == "ok", statistics.scatter_mm, np.nan)
    usual = np.array([finite_median(joint) for joint in scatter.T])
    where = scatter > np.maximum(_RATIO * usual, _BAR_RATIO * finite_median(scatter))
    for t, kind, subject, numbers in _named("frame_scatter", where, "joints", joints):
        yield t, kind, subject, {**numbers, "scatter_mm": float(scatter[t][where[t]].max())}


def _named(kind: str, where: Mask, part: str, names: Sequence[str]) -> Iterator[Case]:
    """Yield a case for every frame with a True; its subject's ``part`` are the names of these."""
    for t in np.flatnonzero(where.any(axis=1)):
        chosen = tuple(names[int(i)] for i in np.flatnonzero(where[t]))
        subject = Subject(joints=chosen) if part == "joints" else Subject(cameras=chosen)
        yield int(t), kind, subject, {"of": len(names)}
