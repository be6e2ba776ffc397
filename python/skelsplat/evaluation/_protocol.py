"""The rules of a benchmark, and the cases that a data set becomes under them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat.datasets import Dataset, Take
from skelsplat.exceptions import DatasetError, InvalidInputError

Endpoint = int | tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A take as the protocol wants it."""

    take: Take  # cut to the views and frames that count
    column: str  # key of the column of per-action tables
    # Whether the absolute error counts; the root-relative and Procrustes errors always do.
    absolute: bool = True


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """Rules of one benchmark."""

    # name, text: The text goes under every table.
    name: str
    text: str
    # Keys of the columns in order, and their headers; empty: the takes' own, in their order.
    columns: Mapping[str, str] = field(default_factory=dict)
    aliases: Mapping[str, str] = field(default_factory=dict)  # other names of actions, to keys of columns
    subjects: tuple[str, ...] = ()  # those evaluated; empty: all
    every: int = 1  # one frame in so many, counted in frame numbers from the take's first
    # First and last frame numbers evaluated, both ends included; empty: all.
    ranges: tuple[tuple[int, int], ...] = ()
    # Keys of takes whose absolute error does not count.
    excluded: frozenset[str] = frozenset()
    # Number of views to the numbers of the cameras; an empty tuple: all that there are.
    view_sets: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    n_views: int | None = None  # which of `view_sets`; None: all cameras
    all_views_detected: bool = False  # drop frames in which a view has no detection at all
    mean_of_columns: bool = False  # rates (PCP) are averaged over the columns, not over all limbs
    min_visible_views: int = 0  # count only joints that so many views see unoccluded; 0: all
    # Limbs of the PCP; empty: the protocol has none.
    parts: tuple[tuple[Endpoint, Endpoint], ...] = ()
    root: tuple[int, ...] | None = None  # joints whose mean is the root; None: the layout's
    # Poses of the published evaluation: absolute, root-relative.
    expected_poses: tuple[int, int] | None = None
    # What the paper changes in its own settings on this benchmark.
    paper_fields: Mapping[str, Any] = field(default_factory=dict)
    paper_start: str = "dlt"  # "fusion" or "dlt": where the paper starts on this benchmark

    def with_options(
        self, *, n_views: int | None = None, every: int | None = None, counting: str = "all"
    ) -> Protocol:
        """Return the protocol with what a user may choose.

        Parameters
        ----------
        n_views : int or None
            Number of views; None keeps the protocol's.
        every : int or None
            One frame in so many; None keeps the protocol's.
        counting : {"all", "adafuse"}
            ``"adafuse"`` counts joints that at least two views see unoccluded.

        Raises `InvalidInputError` if the protocol has no such choice.
        """
        if counting not in ("all", "adafuse"):
            raise InvalidInputError(f"counting: expected all or adafuse, got {counting!r}")
        if every is not None and every < 1:
            raise InvalidInputError(f"every: expected an integer >= 1, got {every}")
        if n_views is not None and n_views not in self.view_sets:
            choices = ", ".join(map(str, self.view_sets)) or "no number (all views are used)"
            raise InvalidInputError(f"views: expected one of {choices} for {self.name}, got {n_views}")
        return replace(
            self,
            n_views=self.n_views if n_views is None else n_views,
            every=self.every if every is None else every,
            min_visible_views=2 if counting == "adafuse" else self.min_visible_views,
        )

    def cases(self, dataset: Dataset) -> tuple[Case, ...]:
        """Cut the data set to what counts, in the order of its takes.

        Raises `InvalidInputError` if nothing is left, or an action is none of the protocol's columns;
        `DatasetError` if a camera is missing, or the occlusion that the counting needs.
        """
        cases = []
        for take in dataset:
            if self.subjects and take.subject not in self.subjects:
                continue
            cut = self._cut(take)
            if len(cut):
                cases.append(Case(cut, self._column(take), take.key not in self.excluded))
        if not cases:
            asked = f" of {', '.join(self.subjects)}" if self.subjects else ""
            raise InvalidInputError(
                f"{dataset.name}: expected frames{asked} for the protocol {self.name}, got none"
            )
        return tuple(cases)

    def headers(self, cases: Sequence[Case]) -> dict[str, str]:
        """Return the columns that occur, key to header, in the protocol's order."""
        there = dict.fromkeys(case.column for case in cases)
        if not self.columns:
            return {key: key for key in there}
        return {key: header for key, header in self.columns.items() if key in there}

    def _column(self, take: Take) -> str:
        key = self.aliases.get(take.action, take.action)
        if self.columns and key not in self.columns:
            raise InvalidInputError(
                f"{take.key}: expected an action among {', '.join(self.columns)}, got {key!r}"
            )
        return key

    def _cut(self, take: Take) -> Take:
        views = self.view_sets.get(self.n_views, ()) if self.n_views is not None else ()
        if views:
            take = with_cameras(take, views)
        keep = np.zeros(len(take), dtype=np.bool_)
        keep[_first_of_each(take.frames, self.every)] = True
        if self.ranges:
            keep &= np.any([(take.frames >= a) & (take.frames <= b) for a, b in self.ranges], axis=0)
        if self.all_views_detected:
            keep &= _has_every_view(take)
        return take.select(keep)


def _first_of_each(frames: NDArray[np.int64], every: int) -> NDArray[np.intp]:
    """Find the first frame in each run of `every` frame numbers: of a whole take 0, every, 2·every and so on.

    A take that was thinned out before keeps what lies nearest behind those numbers.
    """
    if len(frames) == 0 or every == 1:
        return np.arange(len(frames))
    return np.unique((frames - frames[0]) // every, return_index=True)[1]


def with_cameras(take: Take, numbers: Sequence[int]) -> Take:
    """Return the take as cameras with these numbers see it, in this order.

    A camera's number is the one at the end of its name ("00_13" is 13).

    Raises `DatasetError` if a number is missing or two cameras have it.
    """
    ends = [re.search(r"(\d+)$", name) for name in take.rig.names]
    own = [int(end[1]) if end else None for end in ends]
    for number in numbers:
        if own.count(number) != 1:
            named = ", ".join(take.rig.names)
            raise DatasetError(take.key, "cameras", f"one camera with number {number}", named)
    return take.with_views([own.index(number) for number in numbers])


def _has_every_view(take: Take) -> NDArray[np.bool_]:
    """Whether every view detects some joint, (T,); True where the take has no detections."""
    if take.detections is None:
        return np.ones(len(take), dtype=np.bool_)
    seen = np.isfinite(take.detections[..., :2]).all(axis=-1) & (take.detections[..., 2] > 0)
    return np.asarray(seen.any(axis=-1).all(axis=-1))
