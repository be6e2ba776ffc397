"""What is counted where: views, frames, exclusions and columns of each benchmark.

A `Protocol` turns a data set into cases: takes cut to its views and frames, each with its column of the table
and whether its absolute error counts.

>>> from skelsplat.evaluation import protocols
>>> protocols.get("human36m").every
64
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from skelsplat.evaluation._protocol import Case, Endpoint, Protocol
from skelsplat.exceptions import InvalidInputError

__all__ = ["SIMULATED", "Case", "Protocol", "get", "names"]

HUMAN36M_COLUMNS: Mapping[str, str] = MappingProxyType(
    {
        "Directions": "Dir.",
        "Discussion": "Disc.",
        "Eating": "Eat",
        "Greeting": "Greet",
        "Phoning": "Phone",
        "Photo": "Photo",
        "Posing": "Pose",
        "Purchases": "Purch.",
        "Sitting": "Sit",
        "SittingDown": "SitD.",
        "Smoking": "Smoke",
        "Waiting": "Wait",
        "WalkDog": "WalkD.",
        "Walking": "Walk",
        "WalkTogether": "WalkT.",
    }
)
"""Actions in the order of the paper's table, and how it abbreviates them."""

_ALIASES = {"TakingPhoto": "Photo", "WalkingDog": "WalkDog", "WalkingTogether": "WalkTogether"}

# Damaged truth of S9, under the names of the original files and under those with a subaction behind a hyphen.
DAMAGED = frozenset(
    {"S9/SittingDown 1", "S9/Waiting 1", "S9/Greeting", "S9/SittingDown-2", "S9/Waiting-1", "S9/Greeting-2"}
)

# Limbs of the Shelf and Campus layout: nine pairs, and hip centre to bottom of the head.
SHELF_PARTS: tuple[tuple[Endpoint, Endpoint], ...] = (
    (0, 1),
    (1, 2),
    (3, 4),
    (4, 5),
    (6, 7),
    (7, 8),
    (9, 10),
    (10, 11),
    (12, 13),
    ((2, 3), 12),
)


PANOPTIC_ORDER = (1, 2, 10, 13, 3, 23, 19, 30)
"""HD cameras in the order in which the paper adds them."""


def _multi_person(name: str, frames: str, ranges: tuple[tuple[int, int], ...]) -> Protocol:
    return Protocol(
        name=name,
        text=(
            f"{frames}, actors 0 to 2. PCP: a part is correct if the mean error of its two ends is at most "
            "half its length; ten parts; the average is over actors."
        ),
        columns={f"actor{k}": f"Actor {k}" for k in range(3)},
        ranges=ranges,
        mean_of_columns=True,
        parts=SHELF_PARTS,
    )


_HUMAN36M = Protocol(
    name="human36m",
    text=(
        "Human3.6M: S9 and S11, every 64th frame of each activity. The absolute error leaves out S9 "
        "'SittingDown 1', 'Waiting 1' and 'Greeting' (damaged truth); the root-relative one, about joint 0, "
        "and PA-MPJPE count all. Averages over frames."
    ),
    columns=HUMAN36M_COLUMNS,
    aliases=_ALIASES,
    subjects=("S9", "S11"),
    every=64,
    excluded=DAMAGED,
    root=(0,),
    expected_poses=(2107, 2181),
    paper_start="fusion",
)

_ALL = (
    _HUMAN36M,
    replace(
        _HUMAN36M,
        name="human36m-occ",
        text=_HUMAN36M.text.replace("Human3.6M:", "Human3.6M-Occ, frames as Human3.6M:"),
        paper_fields={"occlusion_factor": 1.25},
    ),
    Protocol(
        name="panoptic",
        text=(
            "CMU Panoptic, single person: HD cameras 1, 2, 10, 13, then 3, 23, 19, 30; frames in which every "
            "view has a detection; all joints with truth."
        ),
        view_sets={n: PANOPTIC_ORDER[:n] for n in range(4, 9)},
        n_views=4,
        all_views_detected=True,
        paper_fields={"position_lr_mm": "camera_extent", "position_lr_factor": 10.0},
    ),
    Protocol(
        name="occlusion-person",
        text="Occlusion-Person: 8 cameras, or 4 (1, 3, 5, 7).",
        view_sets={4: (1, 3, 5, 7), 8: ()},
    ),
    _multi_person("shelf", "Shelf: frames 300 to 600", ((300, 600),)),
    _multi_person("campus", "Campus: frames 350 to 470 and 650 to 750", ((350, 470), (650, 750))),
)
_BY_NAME = {protocol.name: protocol for protocol in _ALL}

SIMULATED: Mapping[str, str] = MappingProxyType(
    {
        "human36m-like": "human36m",
        "human36m-like-occ-2": "human36m-occ",
        "human36m-like-occ-3": "human36m-occ",
        "human36m-like-occ-3-hard": "human36m-occ",
        "dome": "panoptic",
        "occlusion-person-like": "occlusion-person",
    }
)
"""Simulated data sets, and whose protocol they follow."""

names: tuple[str, ...] = tuple(_BY_NAME)


def get(name: str) -> Protocol:
    """Return the protocol of a data set: its own, or of a simulated one that of the data set it resembles.

    Raises
    ------
    InvalidInputError
        If there is none of that name; the message lists all.
    """
    name = SIMULATED.get(name, name)
    if name not in _BY_NAME:
        raise InvalidInputError(f"protocol: expected one of {', '.join(names)}, got {name!r}")
    return _BY_NAME[name]
