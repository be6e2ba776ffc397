"""What is counted where: views, frames, exclusions and columns of each benchmark.

A `Protocol` turns a data set into cases: takes cut to its views and frames, each with its column of the table
and whether its absolute error counts.

>>> from skelsplat.evaluation import protocols
>>> protocols.get("human36m").every
64
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skelsplat.datasets import Dataset, Take, occlusion_person, panoptic
from skelsplat.datasets.hourglass import LIMBS
from skelsplat.datasets.human36m import ACTIONS, ALIASES
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of

Endpoint = int | tuple[int, ...]
Parts = tuple[tuple[Endpoint, Endpoint], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A take as the protocol wants it."""

    take: Take  # cut to the views and frames that count
    column: str  # key of the column of per-action tables
    # Whether the absolute error counts; the root-relative and Procrustes errors always do.
    absolute: bool = True
    # All frames of the take, for methods over time, and which of them `take` has; None: it has all.
    recording: Take | None = None
    rows: NDArray[np.bool_] | None = None

    def given(self, over_time: bool) -> Take:
        """Return what a method takes: the frames that count, or over time the recording."""
        return self.recording if over_time and self.recording is not None else self.take


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """Rules of one benchmark."""

    name: str
    text: str  # goes under every table
    columns: Mapping[str, str] = field(default_factory=dict)  # key to header; empty: the takes' own
    subjects: tuple[str, ...] = ()  # those evaluated; empty: all
    every: int = 1  # one frame in so many, counted in frame numbers from the take's first
    ranges: tuple[tuple[int, int], ...] = ()  # first and last frame numbers evaluated; empty: all
    excluded: frozenset[str] = frozenset()  # keys of takes whose absolute error does not count
    view_sets: Mapping[int, tuple[int, ...]] = field(default_factory=dict)  # to camera numbers; empty: all
    n_views: int | None = None  # which of `view_sets`; None: all cameras
    all_views_detected: bool = False  # drop frames in which a view has no detection at all
    mean_of_columns: bool = False  # PCP is averaged over the columns, not over all limbs
    least_views: int = 0  # that detect a person who counts, of several; 0: everybody with a truth does
    parts: Parts = ()  # limbs of the PCP; empty: the protocol has none
    joints: tuple[str, ...] = ()  # that averages are of, where the truth has others besides; empty: all
    root: tuple[int, ...] | None = None  # joints whose mean is the root; None: the layout's
    expected_poses: tuple[int, int] | None = None  # of the published evaluation: absolute, root-relative
    # What the paper changes in its own settings on this benchmark, and where it starts.
    paper_fields: Mapping[str, Any] = field(default_factory=dict)
    paper_start: Literal["dlt", "fusion"] = "dlt"

    def with_options(self, *, n_views: int | None = None, every: int | None = None) -> Protocol:
        """Return the protocol with another number of views or another `every`, if it has the choice."""
        if every is not None and every < 1:
            raise InvalidInputError(f"every: expected an integer >= 1, got {every}")
        if n_views is not None and n_views not in self.view_sets:
            choices = ", ".join(map(str, self.view_sets)) or "no number (all views are used)"
            raise InvalidInputError(f"views: expected one of {choices} for {self.name}, got {n_views}")
        return replace(self, n_views=n_views or self.n_views, every=every or self.every)

    def cases(self, dataset: Dataset) -> tuple[Case, ...]:
        """Cut the data set to what counts, in the order of its takes.

        Raises `InvalidInputError` if nothing is left, or an action is none of the protocol's columns;
        `DatasetError` if a camera is missing.
        """
        cases = []
        views = () if self.n_views is None else self.view_sets[self.n_views]
        for take in dataset:
            if self.subjects and take.subject not in self.subjects:
                continue
            whole = _with_cameras(take, views) if views else take
            keep = self.counted(whole.frames)
            if self.all_views_detected and whole.detections is not None:
                found = np.isfinite(whole.detections[..., :2]).all(axis=-1) & (whole.detections[..., 2] > 0)
                keep &= found.any(axis=-1).all(axis=-1)
            if keep.any():
                column = ALIASES.get(take.action, take.action)
                if self.columns:
                    one_of(take.key, column, self.columns)
                cases.append(Case(whole.select(keep), column, take.key not in self.excluded, whole, keep))
        if not cases:
            asked = f"frames of {', '.join(self.subjects) or 'any subject'} for the protocol {self.name}"
            raise InvalidInputError(f"{dataset.name}: expected {asked}, got none")
        return tuple(cases)

    def headers(self, cases: Sequence[Case]) -> dict[str, str]:
        """Return the columns that occur, key to header, in the protocol's order."""
        there = dict.fromkeys(case.column for case in cases)
        return {key: self.columns.get(key, key) for key in self.columns or there if key in there}

    def counted(self, frames: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which frame numbers (T,) of a take are evaluated: of each `every` the first there is."""
        keep = np.full(len(frames), self.every == 1)
        if len(frames):
            keep[np.unique((frames - frames[0]) // self.every, return_index=True)[1]] = True
        if self.ranges:
            keep &= np.any([(frames >= a) & (frames <= b) for a, b in self.ranges], axis=0)
        return keep


def _with_cameras(take: Take, numbers: Sequence[int]) -> Take:
    """Return the take as cameras with these numbers at the end of their names see it, in this order."""
    ends = [re.search(r"(\d+)$", name) for name in take.rig.names]
    own = [int(end[1]) if end else None for end in ends]
    for number in numbers:
        if own.count(number) != 1:
            named = ", ".join(take.rig.names)
            raise DatasetError(take.key, "cameras", f"one camera with number {number}", named)
    return take.with_views([own.index(number) for number in numbers])


# How the paper's table abbreviates the actions.
_ABBREVIATIONS = (
    *("Dir.", "Disc.", "Eat", "Greet", "Phone", "Photo", "Pose", "Purch.", "Sit", "SitD.", "Smoke"),
    *("Wait", "WalkD.", "Walk", "WalkT."),
)

# Damaged truth of S9, under the names of the original files and under those with a subaction behind a hyphen.
_DAMAGED = ("SittingDown 1", "Waiting 1", "Greeting", "SittingDown-2", "Waiting-1", "Greeting-2")

# Limbs of the Shelf and Campus layout: nine pairs, and hip centre to bottom of the head.
_SHELF_PARTS: Parts = (
    *((0, 1), (1, 2), (3, 4), (4, 5)),  # legs
    *((6, 7), (7, 8), (9, 10), (10, 11)),  # arms
    *((12, 13), ((2, 3), 12)),  # head and trunk
)

# Limbs of `h36m17` in the same order of body parts.
_H36M_PARTS: Parts = (
    *((3, 2), (2, 1), (4, 5), (5, 6)),
    *((16, 15), (15, 14), (11, 12), (12, 13)),
    *((8, 10), ((1, 4), 8)),
)
_PCP = (
    "PCP: a part is correct if the mean error of its two ends is at most half its length; ten parts; the "
    "average is over"
)

_HUMAN36M = Protocol(
    name="human36m",
    text=(
        "Human3.6M: S9 and S11, every 64th frame of each activity. The absolute error leaves out S9 "
        "'SittingDown 1', 'Waiting 1' and 'Greeting' (damaged truth); the root-relative one, about joint 0, "
        "and PA-MPJPE count all. Averages over frames."
    ),
    columns=dict(zip(ACTIONS, _ABBREVIATIONS, strict=True)),
    subjects=("S9", "S11"),
    every=64,
    excluded=frozenset(f"S9/{name}" for name in _DAMAGED),
    root=(0,),
    expected_poses=(2107, 2181),
    paper_start="fusion",
)
_SHELF = Protocol(
    name="shelf",
    text=f"Shelf: frames 300 to 600, actors 0 to 2. {_PCP} actors.",
    columns={f"actor{k}": f"Actor {k}" for k in range(3)},
    ranges=((300, 600),),
    mean_of_columns=True,
    parts=_SHELF_PARTS,
)

_ALL = (
    _HUMAN36M,
    replace(
        _HUMAN36M,
        name="human36m-occ",
        text=_HUMAN36M.text.replace("Human3.6M:", "Human3.6M-Occ, frames as Human3.6M:"),
        paper_fields={"occlusion_factor": 1.25},
    ),
    replace(
        _HUMAN36M,
        name="human36m-hourglass",
        text=_HUMAN36M.text.replace(
            "Averages over frames.",
            "Averages are over frames and the twelve joints of arms and legs; 'all' has neck, pelvis and "
            "head besides. 'offsets out' is an oracle: from the errors of each joint of a person their mean "
            "in the body's frame is subtracted, which only the truth shows; what it takes off abs is what "
            "other definitions of joints cost. The reported rows have other, finer detections, 17 joints.",
        ),
        joints=LIMBS,
    ),
    Protocol(
        name="panoptic",
        text=(
            "CMU Panoptic, single person: HD cameras 1, 2, 10, 13, then 3, 23, 19, 30; frames in which every "
            "view has a detection; all joints with truth."
        ),
        view_sets={n: panoptic.CAMERAS[:n] for n in range(4, 9)},
        n_views=4,
        all_views_detected=True,
        paper_fields={"position_lr_mm": "camera_extent", "position_lr_factor": 10.0},
    ),
    Protocol(
        name="occlusion-person",
        text="Occlusion-Person: 8 cameras, or 4 (1, 3, 5, 7).",
        view_sets={4: occlusion_person.FOUR_CAMERAS, 8: ()},
    ),
    _SHELF,
    replace(
        _SHELF,
        name="campus",
        text=f"Campus: frames 350 to 470 and 650 to 750, actors 0 to 2. {_PCP} actors.",
        ranges=((350, 470), (650, 750)),
    ),
    Protocol(
        name="people",
        text=(
            "Simulated scenes of several people; a person counts in the frames in which at least two views "
            f"detect them. {_PCP} people."
        ),
        mean_of_columns=True,
        least_views=2,
        parts=_H36M_PARTS,
    ),
)
_BY_NAME = {protocol.name: protocol for protocol in _ALL}

SIMULATED = {
    "human36m-like": "human36m",
    **{f"human36m-like-occ-{variant}": "human36m-occ" for variant in ("2", "3", "3-hard")},
    "dome": "panoptic",
    "occlusion-person-like": "occlusion-person",
    "people": "people",
}
"""Simulated data sets, and whose protocol they follow."""

names: tuple[str, ...] = tuple(_BY_NAME)


def get(name: str) -> Protocol:
    """Return the protocol of a data set: its own, or of a simulated one that of the data set it resembles.

    Raises `InvalidInputError` if there is none of that name; the message lists all.
    """
    name = SIMULATED.get(name, name)
    one_of("protocol", name, names)
    return _BY_NAME[name]
