"""Whom to judge the cameras by, and whether folders of detections are exchanged between cameras."""

from __future__ import annotations

from itertools import combinations, permutations
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.association import choose_person, extents
from skelsplat.rig_check._findings import Finding
from skelsplat.rig_check._scene import Array, Index, Scene, named, scene_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_FRAMES = 30
# Cameras that miss each other's joints by more than this share of the diagonal (20 px at 1700 px) are worth
# a search. The right order must leave less than a third of that; or less than most of it, if the exchanged
# cameras themselves lose half. A rival leaves little more.
_GROSS, _BETTER, _RATHER, _HALF, CLEAR = 0.012, 0.35, 0.7, 0.5, 1.5
# In a symmetric rig orders leave the same, but for noise.
_SAME = 1.05
# of so many cameras all orders are tried (24), of more those that exchange two
ALL_ORDERS = 4
# A camera in which the chosen person is found in fewer frames is judged by whoever stands there.
_LOST = 0.2


def some_frames(count: int) -> Index:
    """Places of a few frames, spread over the recording."""
    return np.unique(np.linspace(0, count - 1, min(_FRAMES, count)).round().astype(np.int64))


def is_gross(scene: Scene) -> bool:
    """Whether the cameras disagree by more than poor detections do."""
    return bool(scene.disagreement > _limit(scene))


def _limit(scene: Scene) -> float:
    return _GROSS * float(np.mean([np.hypot(*camera.size) for camera in scene.cameras]))


def find_exchange(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, tuple[int, ...]]:
    """Say which folder of detections belongs to which camera, if not its own.

    Returns the finding (None: they are in order) and the order: camera i has the detections order[i].
    """
    some = people[some_frames(len(people))]
    given = tuple(range(len(cameras)))
    before = judge(cameras, some, layout)
    if not is_gross(before):
        return None, given

    suspects = np.flatnonzero(~(before.left_out <= _limit(before))).tolist()
    orders = list(_orders(suspects, len(cameras)))
    tried = [judge(cameras, some[:, list(order)], layout) for order in orders]
    least = min((scene.disagreement for scene in tried), default=float("inf"))

    def rank(k: int) -> tuple[bool, int, float]:
        """Orders that leave the same are told apart by how many cameras they exchange."""
        moved = sum(i != folder for i, folder in enumerate(orders[k]))
        same = tried[k].disagreement <= _SAME * least
        return (not same, moved if same else 0, tried[k].disagreement)

    ranked = sorted(range(len(tried)), key=rank)
    if not ranked or not _is_right(before, tried[ranked[0]], orders[ranked[0]]):
        return None, given
    best, after = orders[ranked[0]], tried[ranked[0]].disagreement
    rivals = [orders[k] for k in ranked[1:] if tried[k].disagreement < CLEAR * after]
    return _finding(named(cameras), best, rivals, (before.disagreement, after)), best


def _is_right(before: Scene, after: Scene, order: tuple[int, ...]) -> bool:
    """Whether an order sets everything right, or at least all the cameras that it exchanges."""
    if after.disagreement < _BETTER * before.disagreement:
        return True
    moved = [i for i, folder in enumerate(order) if folder != i]
    return bool(
        after.disagreement < min(_RATHER * before.disagreement, 2 * _limit(before))
        and (after.left_out[moved] < _HALF * before.left_out[moved]).all()
    )


def _orders(suspects: list[int], count: int) -> Iterator[tuple[int, ...]]:
    """Orders other than the given one: all of few cameras, of more the exchanges of two that disagree."""
    if count <= ALL_ORDERS:
        yield from list(permutations(range(count)))[1:]
        return
    for i, j in combinations(suspects, 2):
        order = list(range(count))
        order[i], order[j] = j, i
        yield tuple(order)


def _finding(
    names: list[str], best: tuple[int, ...], rivals: list[tuple[int, ...]], miss: tuple[float, float]
) -> Finding:
    moved = [i for i, folder in enumerate(best) if folder != i]
    how = _words(names, best)
    text = (
        f"{how}: set right, the cameras are {miss[1]:.1f} px off what the others say, as it is "
        f"{f'{miss[0]:.0f} px' if np.isfinite(miss[0]) else 'nowhere near it'}."
    )
    if rivals:
        text += f" {_words(names, rivals[0])} would fit almost as well."
    numbers = {
        "folders": {names[i]: names[folder] for i, folder in enumerate(best)},
        "before_px": miss[0],
        "after_px": miss[1],
    }
    return Finding("exchanged", tuple(names[i] for i in moved), text, numbers)


def _words(names: list[str], order: tuple[int, ...]) -> str:
    moved = [i for i, folder in enumerate(order) if folder != i]
    if len(moved) == 2:
        pair = f"{names[moved[0]]} and {names[moved[1]]}"
        return f"The detections of {pair} are exchanged (or their calibrations)"
    each = ", ".join(f"those of {names[order[i]]} belong to {names[i]}" for i in moved)
    return f"The detections of {len(moved)} cameras are exchanged (or their calibrations): {each}"


def judge(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Scene:
    """Return the scene of the person that is followed."""
    return scene_of(cameras, follow(cameras, people, layout), np.arange(len(people)))


def follow(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Array:
    """Return one person's detections (T, M, N, 2), also in a view that no other view agrees with.

    A camera in which the person is almost never found, although people stand there, may be wrong; the largest
    person of each of its images then stands in.
    """
    if people.shape[2] == 1 or len(cameras) < 2:
        return people[:, :, 0, :, :2]
    chosen, index = choose_person(people, cameras, layout=layout)
    places = extents(people).argmax(axis=2)
    there = np.isfinite(people[..., 0]).any(axis=(2, 3))
    found = (index >= 0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    fallback = np.take_along_axis(people, places[:, :, None, None, None], axis=2)[:, :, 0]
    lost = found < _LOST
    followed: Array = np.where(lost[None, :, None, None], fallback, chosen)[..., :2]
    return followed
