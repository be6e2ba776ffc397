"""Whether the detections of all cameras are of other images, or of one another's cameras, or both.

Other images than the calibration's are resized, turned, mirrored, or have x and y exchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.findings import Finding, Subject
from skelsplat.rig_check._scene import Scene, gross_px, is_gross, judge, named, some_frames

Change = Callable[[Array, tuple[int, int]], Array]

# What is right leaves less than _BETTER of the disagreement; or less than _RATHER of it, if the exchanged
# cameras themselves lose half. A rival leaves little more.
_BETTER, _RATHER, _HALF, _CLEAR = 0.35, 0.7, 0.5, 1.5
# In a symmetric rig orders leave the same, but for noise.
_SAME = 1.05
# of so many cameras all orders are tried (24), of more those that exchange two
_ALL_ORDERS = 4
# In a ring of cameras mirrored images and cameras exchanged across leave the same; noise decides nothing.
_ALIKE = 1.05
_FACTORS = (1 / 4, 1 / 3, 3 / 8, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 8 / 3, 3.0, 4.0)


def _arranged(axes: tuple[int, int], flipped: tuple[bool, bool]) -> Change:
    """Return the change to x and y taken from these axes, counted from the image's other side if flipped."""

    def change(points: Array, size: tuple[int, int]) -> Array:
        taken = [points[..., axis] for axis in axes]
        ends = zip(taken, size, flipped, strict=True)
        return np.stack([length - 1.0 - value if flip else value for value, length, flip in ends], axis=-1)

    return change


def _fractions(points: Array, size: tuple[int, int]) -> Array:
    pixels: Array = points * np.array(size) - 0.5
    return pixels


# what the images are → how the detections become those of the calibration's images
CHANGES: dict[str, Change] = {
    "upside down": _arranged((0, 1), (True, True)),
    "mirrored": _arranged((0, 1), (True, False)),
    "turned clockwise by a quarter": _arranged((1, 0), (False, True)),
    "turned anticlockwise by a quarter": _arranged((1, 0), (True, False)),
}
_FOR_ALL: dict[str, Change] = {
    **CHANGES,
    "given with y before x": _arranged((1, 0), (False, False)),
    "given as parts of the image's width and height": _fractions,
}


@dataclass(frozen=True)
class Files:
    """What was found, the people (T, M, P, N, 2) with it corrected, and how far the cameras are off then.

    The error is in pixels of the detections as they were given: small images make small errors. It is
    infinite where nothing is compared with it.
    """

    findings: tuple[Finding, ...]
    people: Array
    error_px: float = float("inf")


def correct_files(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Files:
    """Find other images and exchanged cameras, and correct what leaves less disagreement.

    Exchanged cameras may agree better by chance if the images are taken to be of another size, and in a
    symmetric rig they look nearly like turned or mirrored images. So an exchange alone is tried next to the
    images, and what fits nearly as well is mentioned. Not so with more cameras than all orders are tried of:
    the exchange of two of them looks like nothing else.
    """
    images, upright, factor = find_images(cameras, people, layout)
    exchange, order = find_exchange(cameras, upright, layout)
    findings = tuple(finding for finding in (images, exchange) if finding is not None)
    corrected = upright[:, list(order)]
    if images is None or len(cameras) > _ALL_ORDERS:
        return Files(findings, corrected)
    exchange, order = find_exchange(cameras, people, layout)
    if exchange is None:
        return Files(findings, corrected)
    error = judge(cameras, corrected[some_frames(len(people))], layout).disagreement / factor
    alone = Files((exchange,), people[:, list(order)], exchange.numbers["after_px"])
    return _better(Files(findings, corrected, error), alone)


def _better(images: Files, exchange: Files) -> Files:
    """Return what leaves less, images where both leave as much; the other is mentioned if it is near."""
    pair = (images, exchange) if images.error_px <= _ALIKE * exchange.error_px else (exchange, images)
    best, rival = pair
    if rival.error_px >= _CLEAR * best.error_px:
        return best
    first, *rest = best.findings
    shown = ("images", "folders")
    other = [
        {"kind": finding.kind, **{key: value for key, value in finding.numbers.items() if key in shown}}
        for finding in rival.findings
    ]
    numbers = {**first.numbers, "rivals": [*first.numbers.get("rivals", []), other]}
    return replace(best, findings=(replace(first, numbers=numbers), *rest))


def find_images(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, Array, float]:
    """Say whether the detections of all cameras are of other images.

    Returns the finding (None: they are not), the people corrected, and the factor on lengths in that.
    """
    some = people[some_frames(len(people))]
    before = judge(cameras, some, layout)
    if not is_gross(before):
        return None, people, 1.0

    def disagreement(tried: tuple[str, Change, float]) -> float:
        """Return it in pixels of the detections as they are: small images make small errors."""
        return judge(cameras, _applied(some, cameras, tried[1]), layout).disagreement / tried[2]

    best = min(_tries(), key=disagreement)
    after = disagreement(best)
    if not after < _BETTER * before.disagreement:
        return None, people, 1.0
    numbers = {"images": best[0], "before_px": before.disagreement, "after_px": after}
    return Finding("images_changed", "error", numbers=numbers), _applied(people, cameras, best[1]), best[2]


def _tries() -> Iterator[tuple[str, Change, float]]:
    """Yield what the images may be, the change that undoes it, and the factor on lengths in it."""
    for words, change in _FOR_ALL.items():
        yield words, change, 1.0
    for factor in _FACTORS:
        yield f"of images {1 / factor:.3g} times as large", resizer(factor), factor


def resizer(factor: float) -> Change:
    """Return the change that undoes resizing by 1 / factor."""
    # integers are pixel centres
    return lambda points, size: (points + 0.5) * factor - 0.5  # noqa: ARG005


def _applied(people: Array, cameras: Sequence[sk.Camera], change: Change) -> Array:
    changed = people.copy()
    for i, camera in enumerate(cameras):
        changed[:, i, ..., :2] = change(people[:, i, ..., :2], camera.size)
    return changed


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

    suspects = np.flatnonzero(~(before.left_out <= gross_px(before))).tolist()
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
    rivals = [orders[k] for k in ranked[1:] if tried[k].disagreement < _CLEAR * after]
    names = named(cameras)
    numbers = {"folders": _folders(names, best), "before_px": before.disagreement, "after_px": after}
    if rivals:
        numbers["rivals"] = [[{"kind": "cameras_exchanged", "folders": _folders(names, rivals[0])}]]
    moved = tuple(names[i] for i, folder in enumerate(best) if folder != i)
    return Finding("cameras_exchanged", "error", Subject(cameras=moved), numbers), best


def _is_right(before: Scene, after: Scene, order: tuple[int, ...]) -> bool:
    """Whether an order sets everything right, or at least all the cameras that it exchanges.

    In a symmetric rig, cameras exchanged in turn agree as well as before, but for one that sees strangers.
    """
    moved = [i for i, folder in enumerate(order) if folder != i]
    old, new = before.left_out[moved], after.left_out[moved]
    if after.disagreement < _BETTER * before.disagreement:
        return not (new >= _RATHER * old).any()  # NaN, a camera that saw nobody, does not count
    allowed = min(_RATHER * before.disagreement, 2 * gross_px(before))
    return bool(after.disagreement < allowed and (new < _HALF * old).all())


def _orders(suspects: list[int], count: int) -> Iterator[tuple[int, ...]]:
    """Orders other than the given one: all of few cameras, of more the exchanges of two that disagree."""
    if count <= _ALL_ORDERS:
        yield from list(permutations(range(count)))[1:]
        return
    for i, j in combinations(suspects, 2):
        order = list(range(count))
        order[i], order[j] = j, i
        yield tuple(order)


def _folders(names: list[str], order: tuple[int, ...]) -> dict[str, str]:
    """By camera, the one whose folder has its detections."""
    return {names[i]: names[folder] for i, folder in enumerate(order)}
