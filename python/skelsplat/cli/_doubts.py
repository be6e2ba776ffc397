"""What a person should look at before trusting a run, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skelsplat.cli._pipeline import Inputs, Outcome
    from skelsplat.cli._statistics import Group, Statistics

# A camera or joint is worth a word when at least this share of its detections is poor.
_MOSTLY = 0.5
_MOST_FRAMES = 6
# Equal limbs cost some hundredths of a pixel; a wrong layout or calibration costs more than this factor.
_FURTHER = 1.25


def find_doubts(inputs: Inputs, outcome: Outcome, statistics: Statistics) -> list[str]:
    """Return sentences on cameras that disagree and on joints that fit nowhere or are not well seen."""
    return [
        *_whole(statistics),
        *_cameras(statistics),
        *_joints(statistics),
        *_statuses(inputs, outcome),
    ]


def _mostly_poor(group: Group) -> bool:
    return group.used > 0 and group.poor >= _MOSTLY * group.used


def _whole(statistics: Statistics) -> Iterator[str]:
    total = statistics.total
    if total.used == 0:
        yield "No detection could be used: are they pixels of these cameras' images (not 0 to 1), x before y?"
    elif total.after_px > _FURTHER * total.before_px:
        yield (
            "The refined pose lies further from the detections than its start (median "
            f"{total.before_px:.1f} to {total.after_px:.1f} px): check the layout (body25 and body25b both "
            "have 25 joints), the unit and the calibration."
        )


def _cameras(statistics: Statistics) -> Iterator[str]:
    if _mostly_poor(statistics.total):
        return  # then it is not a single camera
    for group in statistics.cameras:
        if _mostly_poor(group):
            yield (
                f"{group.name}: the pose follows the other cameras and not this one (median "
                f"{group.after_px:.1f} px): check its calibration and timing."
            )


def _joints(statistics: Statistics) -> Iterator[str]:
    names = [group.name for group in statistics.joints if _mostly_poor(group)]
    if names:
        yield f"Most detections are poor for {', '.join(names)}: is the layout right?"


def _statuses(inputs: Inputs, outcome: Outcome) -> Iterator[str]:
    status = np.asarray(outcome.result.joint_status)
    for label, meaning in (
        ("weak", "meets its detections in fewer than two views, so its depth is not fixed"),
        ("unobserved", "has no usable detection and keeps its start, if it has one"),
    ):
        where = status == label
        parts = [
            f"{name} ({_frames(inputs.frames[where[:, j]])})"
            for j, name in enumerate(inputs.layout.joints)
            if where[:, j].any()
        ]
        if parts:
            yield f"{label}, that is, {meaning}: {', '.join(parts)}."


def _frames(numbers: np.ndarray) -> str:
    if len(numbers) > _MOST_FRAMES:
        return f"{len(numbers)} frames"
    return f"frame{'s' * (len(numbers) > 1)} {', '.join(str(int(n)) for n in numbers)}"
