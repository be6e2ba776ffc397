"""Frames that a person should look at, and why, in words."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.run.summary import finite_median, frame_medians

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from skelsplat.run.read import Inputs
    from skelsplat.run.solve import Outcome
    from skelsplat.run.summary import Statistics

    Array = npt.NDArray[np.float64]
    Mask = npt.NDArray[np.bool_]

# What stands out of the recording: this multiple of the median over its frames,
_RATIO = 3.0
# of the share of rejected detections at least the first of these, and the second whatever the others are;
_SHARE, _HIGH_SHARE = 0.1, 1 / 3
# of a joint's error bar also this multiple of the median of all.
_BAR_RATIO = 2.0
# A way to stop that most frames share says nothing about one of them.
_MOSTLY = 0.5
_MOST_NAMES = 6

_WORDS = {
    "no_observations": "no detection could be used",
    "diverged": "diverged",
    "max_steps": "stopped at the step limit",
    "unobserved": "unobserved: {names}",
    "weak": "depth not fixed (weak): {names}",
    "filled": "filled over time: {names}",
    "swapped": "left and right exchanged in {names}",
    "rejected": "{value:.0f}% of the detections rejected",
    "error": "median reprojection error {value:.1f} px",
    "error_bar": "error bar far above the usual: {names}, {value:.0f} mm",
}


@dataclass(frozen=True)
class Reason:
    """Why a frame has a problem: a key of the table of words, the joints or cameras concerned, a number."""

    kind: str
    names: tuple[str, ...] = ()
    value: float = float("nan")

    @property
    def words(self) -> str:
        """The reason as a part of a sentence."""
        return _WORDS[self.kind].format(names=", ".join(self.names), value=self.value)


@dataclass(frozen=True)
class Problem:
    """A frame with a problem: its place in the sequence, its number and the reasons."""

    index: int
    frame: int
    reasons: tuple[Reason, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``report.json``."""
        return {"frame": self.frame, "reasons": [reason.words for reason in self.reasons]}


def find_problems(
    inputs: Inputs, outcome: Outcome, statistics: Statistics, status: npt.NDArray[np.str_]
) -> list[Problem]:
    """Return the frames in which something is missing, contradicted or far from the usual, in order.

    ``status`` (T, N) is that of the poses written, where joints may be filled over time. A joint that is
    unobserved in every frame, and a step limit that most frames reach, belong to the recording and not to a
    frame: `find_doubts` and the stop reasons tell them.
    """
    empty = np.asarray(outcome.result.stop_reason) == "no_observations"
    reasons: list[list[Reason]] = [[] for _ in inputs.frames]
    for t, reason in [
        *_stops(outcome),
        *_statuses(status, empty, inputs.layout.joints),
        *_swaps(statistics, np.asarray(outcome.result.swapped), inputs.rig.names),
        *_rejected(statistics),
        *_errors(statistics),
        *_error_bars(statistics, status, inputs.layout.joints),
    ]:
        reasons[t].append(reason)
    return [Problem(t, int(inputs.frames[t]), tuple(found)) for t, found in enumerate(reasons) if found]


def runs_in_words(problems: Sequence[Problem]) -> list[tuple[int, int, str]]:
    """Join frames that follow each other with the same reasons: (first frame, last frame, reasons).

    Numbers are then those of the frame in which they are largest.
    """

    def key(place: tuple[int, Problem]) -> Any:
        k, problem = place
        return problem.index - k, [(reason.kind, reason.names) for reason in problem.reasons]

    rows = []
    for _, places in groupby(enumerate(problems), key):
        run = [problem for _, problem in places]
        words = [
            max(same, key=lambda reason: reason.value).words
            for same in zip(*(problem.reasons for problem in run), strict=True)
        ]
        rows.append((run[0].frame, run[-1].frame, "; ".join(words)))
    return rows


def _stops(outcome: Outcome) -> Iterator[tuple[int, Reason]]:
    stops = np.asarray(outcome.result.stop_reason)
    for kind in ("no_observations", "diverged", "max_steps"):
        where = stops == kind
        if kind != "max_steps" or where.mean() <= _MOSTLY:
            yield from ((int(t), Reason(kind)) for t in np.flatnonzero(where))


def _statuses(
    status: npt.NDArray[np.str_], empty: Mask, joints: Sequence[str]
) -> Iterator[tuple[int, Reason]]:
    everywhere = (status == "unobserved").all(axis=0)
    yield from _named("unobserved", (status == "unobserved") & ~empty[:, None] & ~everywhere, joints)
    for kind in ("weak", "filled"):
        yield from _named(kind, status == kind, joints)


def _swaps(statistics: Statistics, swapped: Mask, cameras: Sequence[str]) -> Iterator[tuple[int, Reason]]:
    used = np.isfinite(statistics.error_after)
    yield from _named("swapped", np.asarray((swapped & used).any(axis=2)), cameras)


def _rejected(statistics: Statistics) -> Iterator[tuple[int, Reason]]:
    used = np.isfinite(statistics.error_after).sum(axis=(1, 2))
    share = statistics.rejected.sum(axis=(1, 2)) / np.maximum(used, 1)
    usual = float(np.median(share[used > 0])) if used.any() else 0.0
    where = (share >= _HIGH_SHARE) | (share >= max(_SHARE, _RATIO * usual))
    yield from ((int(t), Reason("rejected", value=100 * share[t])) for t in np.flatnonzero(where))


def _errors(statistics: Statistics) -> Iterator[tuple[int, Reason]]:
    median = frame_medians(statistics.error_after)
    where = median > _RATIO * finite_median(median)  # False for NaN
    yield from ((int(t), Reason("error", value=float(median[t]))) for t in np.flatnonzero(where))


def _error_bars(
    statistics: Statistics, status: npt.NDArray[np.str_], joints: Sequence[str]
) -> Iterator[tuple[int, Reason]]:
    """Name joints whose error bar is far above their own median; weak ones are named as such already."""
    bars = np.where(status == "ok", statistics.error_bar_mm, np.nan)
    usual = np.array([finite_median(bar) for bar in bars.T])
    where = bars > np.maximum(_RATIO * usual, _BAR_RATIO * finite_median(bars))
    for t, reason in _named("error_bar", where, joints):
        yield t, Reason("error_bar", reason.names, float(bars[t][where[t]].max()))


def _named(kind: str, where: Mask, names: Sequence[str]) -> Iterator[tuple[int, Reason]]:
    """Yield a reason with the names of every frame's True; of many, with their number."""
    for t in np.flatnonzero(where.any(axis=1)):
        named = tuple(names[int(k)] for k in np.flatnonzero(where[t]))
        yield int(t), Reason(kind, named if len(named) <= _MOST_NAMES else (f"{len(named)} of {len(names)}",))
