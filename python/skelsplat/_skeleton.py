"""Skeletons with rotations: what animation programs take in place of joint positions.

A bone has a constant length, the median of the recording, and one rotation per frame. From the root outwards,
each part of the skeleton starts where its parent ends and is turned so that it points at where its joint was
seen (*swing*); the turn about its own axis (*twist*) comes from a second direction: the axis through both
hips, shoulders or ears, the plane in which a knee or an elbow is bent, the knuckles. With unit vectors u, v
of the two bones of a limb, u × v is normal to that plane and as long as the sine of the bend, so that

    u × v + ε S a

passes continuously to what the parent predicts where the limb is straight: its own axis a, turned by the
smallest rotation S that lets the limb point where it does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat.exceptions import InvalidInputError

# Weight of the predicted axis of a limb against the sine of its bend.
_PREDICTED = 0.2
# Two directions of a part below this sine are one.
_APART = 0.3
_TINY = 1e-9

Names = tuple[str, ...]
"""Joints; their middle counts."""
Vector = tuple[float, float, float]

# In the rest pose, y is up, the person looks along z and stretches the arms sideways.
_LEFT, _UP, _AHEAD = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_DOWN, _TO_TOES = (0.0, -1.0, 0.0), (0.0, -0.4, 0.9)


@dataclass(frozen=True)
class Way:
    """How a part is turned: two directions by joints, and both at rest.

    It points from the first to the second of ``along``, and ``aside`` turns it about this direction: by two
    joints likewise, or by the plane of three; without any, it turns with its parent. No joint stands for the
    place where the part begins.
    """

    along: tuple[Names, ...]
    aside: tuple[Names, ...]
    rest: tuple[Vector, Vector]

    @property
    def joints(self) -> set[str]:
        """All that it needs."""
        return {joint for names in (*self.along, *self.aside) for joint in names}


@dataclass(frozen=True)
class Part:
    """One joint of a skeleton, which carries the bones to its children.

    Of alternatives for where it begins, ``at``, and for its ``ways``, the first is taken whose joints are
    there; without a way, it turns with its parent. One that is ``free`` moves against its parent.
    """

    name: str
    parent: str | None
    at: tuple[Names, ...]
    ways: tuple[Way, ...] = ()
    free: bool = False

    def of(self, joints: Set[str]) -> Part:
        """Return the part with what these joints allow; nowhere if they do not have it."""
        at = [names for names in self.at if set(names) <= joints]
        ways = [way for way in self.ways if way.joints <= joints]
        return replace(self, at=tuple(at[:1]), ways=tuple(ways[:1]))


@dataclass(frozen=True)
class Skeleton:
    """Parts, parents first, and where each begins in the rest pose, seen from its parent.

    ``parents`` (K,) are places in ``names``, −1 of the root; ``offsets`` (K, 3) have y up, in the unit of the
    poses, and are 0 of parts that are free, as the root is.
    """

    names: tuple[str, ...]
    parents: Index
    offsets: Array

    def children(self, part: int) -> list[int]:
        """Return the parts that begin at the end of one."""
        return np.flatnonzero(self.parents == part).tolist()

    @property
    def tips(self) -> dict[int, Array]:
        """Ends (3,) of the parts without children, which no joint shows: a third of the bone before."""
        ends = [k for k in range(len(self.names)) if not self.children(k)]
        usual = np.array(_UP) * np.linalg.norm(self.offsets, axis=1).mean()  # of parts that are free
        return {k: (self.offsets[k] if self.offsets[k].any() else usual) / 3.0 for k in ends}


@dataclass(frozen=True)
class Animation:
    """A skeleton that moves: y is up.

    ``moves`` (T, 3) are the places of its root, 0, and of other free parts as seen from their parents, and
    ``turns`` (T, K, 3, 3) the rotations of all parts against their parents', from the rest pose.
    """

    skeleton: Skeleton
    moves: dict[int, Array]
    turns: Array
    frame_rate: float

    @property
    def places(self) -> Array:
        """Where the parts begin, (T, K, 3)."""
        places, turns = np.empty(self.turns.shape[:-1]), self.turns.copy()
        for k, parent in enumerate(self.skeleton.parents):
            if parent < 0:
                places[:, k] = self.moves[k]
                continue
            way = self.moves.get(k, self.skeleton.offsets[k])
            places[:, k] = places[:, parent] + (turns[:, parent] @ way[..., None])[..., 0]
            turns[:, k] = turns[:, parent] @ turns[:, k]
        return places


def animate(
    points: Array, joints: Sequence[str], bones: Sequence[tuple[int, int]], frame_rate: float
) -> tuple[Animation, Array]:
    """Return an animation of points (T, N, 3) with y up, and where each part was seen, (T, K, 3).

    People have the parts of `_PEOPLE`; other bodies, whose ``bones`` count, have their joints. Gaps in time
    are interpolated, seen from the root; parts that are never seen are left out with all that they carry.
    """
    seen = _Seen(points, joints)
    every = _PEOPLE if is_person(joints) else tuple(_tree(points, joints, bones))
    parts: dict[str, Part] = {}
    for part in (one.of(seen.joints) for one in every):
        carried = part.parent is None or part.parent in parts
        if part.at and carried and (part.parent is None or parts[part.parent].at != part.at):
            parts[part.name] = part
    if not parts:
        raise InvalidInputError("pose: expected the joints of a skeleton in some frame, got none")
    return _turned(tuple(parts.values()), seen, frame_rate)


def is_person(joints: Sequence[str]) -> bool:
    """Whether the joints are those of a person's trunk and limbs."""
    sides = [
        f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "shoulder", "wrist")
    ]
    return set(sides) <= set(joints)


class _Seen:
    """Where joints are, without gaps in time; those that are never seen are not among ``joints``."""

    def __init__(self, points: Array, joints: Sequence[str]) -> None:
        known = _known(points).sum(axis=0) > 0
        centre = _filled(_middle(points[:, known])) if known.any() else np.zeros((len(points), 3))
        self._paths = {
            name: centre + _filled(points[:, j] - centre) for j, name in enumerate(joints) if known[j]
        }

    @property
    def joints(self) -> Set[str]:
        return self._paths.keys()

    def at(self, names: Names) -> Array:
        """Return the middle (T, 3) of joints."""
        middle: Array = np.mean([self._paths[name] for name in names], axis=0)
        return middle


def _middle(points: Array) -> Array:
    """Return the middle (T, 3) of the joints that are there, which shifts little where one is missing."""
    known = _known(points)
    typical = np.array([np.median(points[own, j], axis=0) for j, own in enumerate(known.T)])
    count = known.sum(axis=1)[:, None]
    apart = np.where(known[..., None], points - typical, 0.0).sum(axis=1)
    middle: Array = np.divide(apart, count, out=np.full(apart.shape, np.nan), where=count > 0)
    return middle


def _known(points: Array) -> Mask:
    known: Mask = np.isfinite(points.sum(axis=2))
    return known


def _filled(path: Array) -> Array:
    """Return a path (T, 3) with gaps interpolated in time, and held before and after; 0 if there is none."""
    known, times = np.isfinite(path).all(axis=1), np.arange(len(path))
    if not known.any():
        return np.zeros(path.shape)
    return np.stack([np.interp(times, times[known], path[known, k]) for k in range(3)], axis=1)


def _turned(parts: Sequence[Part], seen: _Seen, frame_rate: float) -> tuple[Animation, Array]:
    """Turn the parts from the root outwards."""
    order = {part.name: k for k, part in enumerate(parts)}
    there = np.stack([seen.at(part.at[0]) for part in parts], axis=1)
    parents = np.array([-1 if part.parent is None else order[part.parent] for part in parts])
    begins, offsets = np.empty(there.shape), np.zeros((len(parts), 3))
    turns, whole = np.empty((2, *there.shape, 3))  # against the parent, and the world
    moves = {0: there[:, 0]}
    for k, (part, parent) in enumerate(zip(parts, parents, strict=True)):
        above = np.broadcast_to(np.eye(3), whole[:, 0].shape) if parent < 0 else whole[:, parent]
        begins[:, k] = there[:, k]
        if parent >= 0:
            apart = np.einsum("tji,tj->ti", above, there[:, k] - begins[:, parent])
            if part.free:
                moves[k] = apart
            else:
                offsets[k] = np.median(apart, axis=0)
                begins[:, k] = begins[:, parent] + above @ offsets[k]
        whole[:, k] = _turn(part, begins[:, k], above, seen)
        turns[:, k] = above.swapaxes(-1, -2) @ whole[:, k]
    skeleton = Skeleton(tuple(order), parents, offsets)
    return Animation(skeleton, moves, turns, frame_rate), there


def _turn(part: Part, begin: Array, above: Array, seen: _Seen) -> Array:
    """Return the rotations (T, 3, 3) of a part that begins there, whose parent has those ``above``."""
    if not part.ways:
        return above
    (way,) = part.ways
    start, end, *_ = (seen.at(names) if names else begin for names in way.along)
    along, (first, second) = _unit(end - start), _unit(np.array(way.rest))
    aside = np.einsum("tij,tj->ti", _swing(above @ first, along), above @ second)
    if way.aside:
        ends = [seen.at(names) if names else begin for names in way.aside]
        one, *others = (_unit(b - a) for a, b in pairwise(ends))
        aside = np.cross(one, others[0]) + _PREDICTED * aside if others else one + _TINY * aside
    turn: Array = _axes(along, aside) @ _axes(first, second).T
    return turn


def _axes(along: Array, aside: Array) -> Array:
    """Return the axes (T, 3, 3), columns, of which one is a direction and another near a second one."""
    second = _unit(aside - (aside * along).sum(axis=-1, keepdims=True) * along)
    return np.stack([along, second, np.cross(along, second)], axis=-1)


def _swing(before: Array, after: Array) -> Array:
    """Return the smallest rotations (T, 3, 3) between unit vectors (T, 3), I + [w] + [w]² / (1 + c)."""
    axis, cosine = np.cross(before, after), (before * after).sum(axis=-1)
    x, y, z = axis.T
    zero = np.zeros(len(x))
    crossed = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    turn: Array = np.eye(3) + crossed + crossed @ crossed / np.maximum(1.0 + cosine, _TINY)[:, None, None]
    return turn


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), _TINY)
    return unit


def _tree(points: Array, joints: Sequence[str], bones: Sequence[tuple[int, int]]) -> Iterator[Part]:
    """Yield the joints of any body as parts; it rests as it is in the frame of the most usual lengths."""
    ends = np.array(bones).reshape(-1, 2)
    lengths = np.linalg.norm(points[:, ends[:, 0]] - points[:, ends[:, 1]], axis=2)
    unusual = np.nan_to_num(np.abs(lengths / np.nanmedian(lengths, axis=0) - 1.0), nan=1.0).sum(axis=1)
    rest = points[int(unusual.argmin())]
    for joint, parent, children in _branches(len(joints), bones):
        name, above = joints[joint], None if parent is None else joints[parent]
        free = not {(joint, parent), (parent, joint)} & {*bones}
        yield Part(name, above, ((name,),), _pointing(rest, joints, joint, children), free)


def _branches(count: int, bones: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int | None, list[int]]]:
    """Yield every joint with its parent and children, from the joint with most bones; parents come first."""
    near: list[list[int]] = [[] for _ in range(count)]
    for a, b in bones:
        near[a].append(b)
        near[b].append(a)
    first = max(range(count), key=lambda j: len(near[j]))
    parent: dict[int, int | None] = {first: None}
    order, waiting = [first], sorted(range(count), key=lambda j: -len(near[j]))
    for joint in order:
        for other in near[joint]:
            if other not in parent:
                parent[other] = joint
                order.append(other)
        if joint == order[-1]:  # a piece that no bone connects is carried by the first joint
            piece = next((j for j in waiting if j not in parent), None)
            if piece is not None:
                parent[piece] = first
                order.append(piece)
    for joint in order:
        yield joint, parent[joint], [j for j in near[joint] if parent[j] == joint]


def _pointing(rest: Array, joints: Sequence[str], joint: int, children: Sequence[int]) -> tuple[Way, ...]:
    """Return how a joint is turned: to the farthest child, and about it by the one most to the side."""
    unit = {j: _unit(rest[j] - rest[joint]) for j in children if np.isfinite(rest[[j, joint]]).all()}
    if not unit:
        return ()
    far = max(unit, key=lambda j: float(np.linalg.norm(rest[j] - rest[joint])))
    along = unit[far]
    sines = {j: float(np.linalg.norm(np.cross(along, one))) for j, one in unit.items()}
    aside = max(sines, key=sines.__getitem__)
    shown = sines[aside] > _APART
    second = unit[aside] if shown else np.eye(3)[int(np.abs(along).argmin())]
    pairs: list[tuple[Names, ...]] = [((), (joints[j],)) for j in (far, aside)]
    return (Way(pairs[0], pairs[1] if shown else (), (tuple(along), tuple(second))),)


def _side(side: str, sign: float) -> Iterator[Part]:
    """Yield the parts of a leg, an arm and a hand, under the names of Mixamo, which most programs know."""

    def own(*joints: str) -> Names:
        return tuple(f"{side}_{joint}" for joint in joints)

    hip, knee, ankle, heel, toe, index = map(own, ("hip", "knee", "ankle", "heel", "big_toe", "foot_index"))
    shoulder, elbow, wrist = map(own, ("shoulder", "elbow", "wrist"))
    called, outward = side.capitalize(), (sign, 0.0, 0.0)
    leg, arm = (_DOWN, _LEFT), (outward, (0.0, -sign, 0.0))
    bent, folded = (hip, knee, ankle), (shoulder, elbow, wrist)
    foot = [
        *(Way((heel, tip), (), (_AHEAD, _LEFT)) for tip in (toe, index)),
        *(Way(((), tip), (), (_TO_TOES, _LEFT)) for tip in (toe, index)),
    ]
    yield Part(f"{called}UpLeg", "Hips", (hip,), (Way(((), knee), bent, leg),))
    yield Part(f"{called}Leg", f"{called}UpLeg", (knee,), (Way(((), ankle), bent, leg),))
    yield Part(f"{called}Foot", f"{called}Leg", (ankle,), tuple(foot))
    yield Part(f"{called}ToeBase", f"{called}Foot", (toe, index))
    yield Part(f"{called}Heel", f"{called}Foot", (heel,))
    yield Part(f"{called}Shoulder", "Spine", (_SHOULDERS,), (Way(((), shoulder), (), (outward, _UP)),))
    yield Part(f"{called}Arm", f"{called}Shoulder", (shoulder,), (Way(((), elbow), folded, arm),))
    yield Part(f"{called}ForeArm", f"{called}Arm", (elbow,), (Way(((), wrist), folded, arm),))
    hand, knuckles = f"{called}Hand", own("pinky", "index")
    palms = (
        Way(((), own("middle_finger1")), (own("pinky_finger1"), own("forefinger1")), (outward, _AHEAD)),
        Way(((), knuckles), (knuckles[:1], knuckles[1:]), (outward, _AHEAD)),
    )
    yield Part(hand, f"{called}ForeArm", (wrist,), palms)
    for name, joint, alone in _FINGERS:
        pointing = ((sign, 0.0, float(name == "Thumb")), _UP)
        for k in range(1, 5):
            above, at = hand if k == 1 else f"{hand}{name}{k - 1}", own(f"{joint}{k}")
            ways = (Way(((), own(f"{joint}{k + 1}")), (), pointing),)
            yield Part(f"{hand}{name}{k}", above, (at, own(alone)) if k == 1 else (at,), ways)


_HIPS, _SHOULDERS = ("left_hip", "right_hip"), ("left_shoulder", "right_shoulder")
_EARS, _NOSE, _TOP = ("left_ear", "right_ear"), ("nose",), ("head",)
_FINGERS = (
    ("Thumb", "thumb", "thumb"),
    ("Index", "forefinger", "index"),
    ("Middle", "middle_finger", "middle"),
    ("Ring", "ring_finger", "ring"),
    ("Pinky", "pinky_finger", "pinky"),
)
_PEOPLE: tuple[Part, ...] = (
    Part("Hips", None, (_HIPS,), (Way((_HIPS[1:], _HIPS[:1]), (_HIPS, _SHOULDERS), (_LEFT, _UP)),)),
    # a fifth of the trunk turns with the pelvis
    Part(
        "Spine",
        "Hips",
        (4 * _HIPS + _SHOULDERS,),
        (Way(((), _SHOULDERS), (_SHOULDERS[1:], _SHOULDERS[:1]), (_UP, _LEFT)),),
    ),
    Part(
        "Neck",
        "Spine",
        (_SHOULDERS,),
        (
            Way(((), _EARS), (_EARS[1:], _EARS[:1]), (_UP, _LEFT)),
            Way(((), _TOP), ((), _NOSE), (_UP, _AHEAD)),
            Way(((), _TOP), (), (_UP, _LEFT)),
            Way(((), _NOSE), (), ((0.0, 0.8, 0.6), _LEFT)),
        ),
    ),
    Part("Head", "Neck", (_EARS, _TOP, _NOSE), (Way((_EARS[1:], _EARS[:1]), ((), _NOSE), (_LEFT, _AHEAD)),)),
    Part("Nose", "Head", (_NOSE,)),
    Part("HeadTop", "Head", (_TOP,)),
    *(
        Part(f"{side.capitalize()}{name.capitalize()}", "Head", ((f"{side}_{name}",),))
        for name in ("eye", "ear")
        for side in ("left", "right")
    ),
    *_side("left", 1.0),
    *_side("right", -1.0),
)
