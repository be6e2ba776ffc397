"""Strides of people who walk, ``strides.csv``: where feet are ahead of the pelvis most, and behind it most.

A foot strikes where its heel is furthest ahead of the pelvis, along the direction in which the pelvis faces,
and leaves the floor where its toes are furthest behind (Zeni, Richards and Higginson 2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skelsplat._angles import TOES
from skelsplat._arrays import Array, median
from skelsplat.findings import Finding, warn
from skelsplat.io.poses._csv import csv_text
from skelsplat.run.angles import vertical_of

if TYPE_CHECKING:
    from skelsplat.run._run import Run

FILE = "strides.csv"
_NUMBERS = ("start_s", "duration_s", "length_m", "speed_m_s", "stance_share")
_COLUMNS = ("side", "first_frame", "last_frame", *_NUMBERS)
_LEG = ("hip", "knee", "ankle")
_SHORTEST, _LONGEST = 0.6, 2.0  # s
# The foot swings against the pelvis by this part of the leg's length; the stride goes ahead, by its cosine.
_SWING, _AHEAD = 0.45, 0.8
# In stance, this part of the stride, the foot slips by less than so much of the stride's length.
_STANCE, _SLIP = (0.5, 0.8), 0.4


class Stride(NamedTuple):
    """One stride, from a strike of a foot to its next one: places in the recording."""

    side: str
    strike: int
    off: int  # where the foot leaves the floor
    next: int
    length: float  # of the foot's way over the floor, in the unit of the poses


def find_strides(pose: Array, joints: Sequence[str], up: Array, fps: float) -> list[Stride]:
    """Return the strides in poses (T, N, 3), left ones first; none without hips, knees and ankles."""
    place = {name: k for k, name in enumerate(joints)}
    if not {f"{side}_{joint}" for side in ("left", "right") for joint in _LEG} <= set(place):
        return []
    left, right = (pose[:, place[f"{side}_hip"]] for side in ("left", "right"))
    ahead = np.cross(left - right, up)
    with np.errstate(invalid="ignore"):
        ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    found = []
    for side in ("left", "right"):
        heel, toe = (
            pose[:, next(place[one] for one in (f"{side}_{name}" for name in names) if one in place)]
            for names in (("heel", "ankle"), ("big_toe", *TOES, "ankle"))
        )
        bones = np.diff(pose[:, [place[f"{side}_{joint}"] for joint in _LEG]], axis=1)
        swing = _SWING * median(np.linalg.norm(bones, axis=-1).sum(axis=1))
        level = heel - (heel @ up)[:, None] * up
        heel_at, toe_at = (np.einsum("ti,ti->t", foot - (left + right) / 2, ahead) for foot in (heel, toe))
        for strike, then in pairwise(_peaks(heel_at, round(_SHORTEST / 2 * fps))):
            way, within = level[then] - level[strike], slice(strike, then + 1)
            off, length = strike + int(toe_at[within].argmin()), float(np.linalg.norm(way))
            walks = (
                np.isfinite(heel_at[within] + toe_at[within]).all()
                and _SHORTEST <= (then - strike) / fps <= _LONGEST
                and np.ptp(heel_at[within]) >= swing
                and way @ ahead[within].mean(axis=0) >= _AHEAD * length
                and _STANCE[0] <= (off - strike) / (then - strike) <= _STANCE[1]
                and np.linalg.norm(level[off] - level[strike]) < _SLIP * length
            )
            if walks:
                found.append(Stride(side, strike, off, then, length))
    return found


def _peaks(values: Array, reach: int) -> list[int]:
    """Return where values (T,) are the largest of all within ``reach``, which are known."""
    around = ((k, values[k - reach : k + reach + 1]) for k in range(reach, len(values) - reach))
    return [k for k, part in around if part.argmax() == reach and np.isfinite(part).all()]


def strides_of(run: Run) -> str:
    """Return the strides of a run as csv; "", with a note that says why, without any."""
    poses, up = run.poses, vertical_of(run.cameras)
    if not run.layout.human:
        return _without("the layout is not of a person")
    if up is None or poses.frame_rate is None:
        return _without(f"{'which axis is vertical' if up is None else 'the frame rate'} is unknown")
    fps, metres = poses.frame_rate, run.cameras.mm_per_unit / 1000.0
    rows = []
    for one in find_strides(poses.pose, run.layout.joints, up, fps):
        first, last = (int(poses.frames[k]) for k in (one.strike, one.next))
        if last - first != one.next - one.strike:  # frames are missing
            continue
        duration, length = (last - first) / fps, one.length * metres
        stance = (one.off - one.strike) / (one.next - one.strike)
        numbers = ((first - int(poses.frames[0])) / fps, duration, length, length / duration, stance)
        rows.append([one.side, first, last, *(f"{number:.3f}" for number in numbers)])
    if rows:
        return csv_text([_COLUMNS, *rows])
    return _without("no foot strikes twice, with hip, knee and ankle in sight, in a walk straight ahead")


def _without(why: str) -> str:
    warn(Finding("no_strides", "note", sentence=f"{FILE} is not written: {why}."))
    return ""
