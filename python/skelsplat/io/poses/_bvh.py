"""BVH, the text file of animation: a tree of bones at rest, then one row of angles per frame."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import chain

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write_text
from skelsplat._skeleton import Animation, Skeleton
from skelsplat.io.poses._animation import Bones, animated
from skelsplat.io.poses._pose_data import Poses

_TURNS = "Zrotation Xrotation Yrotation"


def write_bvh(
    path: str | os.PathLike[str],
    data: Poses,
    *,
    frame_rate: float | None = None,
    unit: str = "cm",
    up: npt.ArrayLike | None = None,
    limbs: Bones | None = None,
) -> None:
    """Write the poses as a skeleton with joint rotations.

    Bones have constant lengths, so joints are off by what theirs vary, which a finding states; gaps in time
    are interpolated. At rest a person looks along z, y is up, and the arms are stretched sideways. Angles
    turn about z, then the new x and y, in degrees, and are continuous.

    ``frame_rate`` is by default that of `data`, ``unit`` ``"m"``, ``"cm"`` or ``"mm"``; ``up`` (3,) is the
    axis of the poses' world that is up, with its sign, by default z. ``limbs`` are the pairs of joints that
    bones of an animal connect, by default those of `data` or of the built-in layout with its joints.
    """
    animation = animated(data, "BVH", frame_rate, unit, up, limbs)
    angles = _angles(animation.turns)
    order = _order(animation.skeleton, 0)
    parts = [part for k in order for part in (animation.moves.get(k), angles[:, k]) if part is not None]
    rows = np.concatenate(parts, axis=1)
    lines = ["HIERARCHY", *_tree(animation, 0, 0), "MOTION", f"Frames: {len(rows)}"]
    lines.append(f"Frame Time: {1.0 / animation.frame_rate:.8f}")
    moves = (" ".join(f"{value:.5f}" for value in row.tolist()) for row in rows)
    atomic_write_text(path, (f"{line}\n" for line in chain(lines, moves)))


def _order(skeleton: Skeleton, part: int) -> Iterator[int]:
    """Yield a part and all that it carries, depth first, as `_tree` writes them."""
    yield part
    for child in skeleton.children(part):
        yield from _order(skeleton, child)


def _tree(animation: Animation, part: int, depth: int) -> Iterator[str]:
    """Yield the lines of a part and of what it carries, depth first."""
    skeleton = animation.skeleton
    indent, inner = "\t" * depth, "\t" * (depth + 1)
    x, y, z = skeleton.offsets[part]
    yield f"{indent}{'JOINT' if depth else 'ROOT'} {'_'.join(skeleton.names[part].split())}"
    yield f"{indent}{{"
    yield f"{inner}OFFSET {x:.5f} {y:.5f} {z:.5f}"
    free = part in animation.moves
    yield f"{inner}CHANNELS {f'6 Xposition Yposition Zposition {_TURNS}' if free else f'3 {_TURNS}'}"
    for child in skeleton.children(part):
        yield from _tree(animation, child, depth + 1)
    if part in skeleton.tips:
        x, y, z = skeleton.tips[part]
        yield f"{inner}End Site"
        yield f"{inner}{{"
        yield f"{inner}\tOFFSET {x:.5f} {y:.5f} {z:.5f}"
        yield f"{inner}}}"
    yield f"{indent}}}"


def _angles(turns: Array) -> Array:
    """Return the angles (T, K, 3) about z, x and y of rotations (T, K, 3, 3) R = Z X Y, continuous in time.

    Two sets of angles turn alike, (a, b, c) and (a + 180°, 180° − b, c + 180°): the one nearer to the last.
    """
    x = np.arcsin(np.clip(turns[..., 2, 1], -1.0, 1.0))
    z = np.arctan2(-turns[..., 0, 1], turns[..., 1, 1])
    y = np.arctan2(-turns[..., 2, 0], turns[..., 2, 2])
    angles: Array = np.degrees(np.stack([z, x, y], axis=-1))
    other = angles * [1.0, -1.0, 1.0] + 180.0
    for t in range(1, len(angles)):
        near = [one - 360.0 * np.round((one - angles[t - 1]) / 360.0) for one in (angles[t], other[t])]
        off = [np.abs(one - angles[t - 1]).sum(axis=-1, keepdims=True) for one in near]
        angles[t] = np.where(off[0] <= off[1], *near)
    return angles
