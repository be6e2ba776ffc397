"""``joint_angles``: flexion of the limbs, lean of trunk and pelvis, from poses, with error bars.

An angle is a function of a few directions between joints or the middles of joints: those of `_ANGLES`, which
the names of joints give, and a layout's own. Each kind of
function (`between`, `swing`, `aside`) returns its value and its gradients in these directions; first-order
propagation through them turns the covariances of the joints into the standard deviation of the angle.
docs/howto/angles.md defines every angle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import Array, Mask, numbers
from skelsplat._refine import Refinement
from skelsplat._skelsplat import Layout
from skelsplat.exceptions import InvalidInputError

# Lengths below this part of the coordinates, and sines below it, are rounding errors.
_TINY = 1e-9
# Sine of the angle between a limb and the axis through both sides of the body below which its swing is too
# uncertain to count turns from frame to frame: 20°.
_NEAR_AXIS = 0.34
TOES = ("foot_index", "toe")  # other names of the big toe

UP: Final = "up"
Point = tuple[str, ...]  # the middle of these joints
Direction = tuple[Point, Point] | str  # from, to; or `UP`
Gradients = tuple[Array, ...]
Kind = Callable[..., tuple[Array, Gradients, Array]]


@dataclass(frozen=True, slots=True)
class JointAngles:
    """What ``joint_angles`` returns. ``…`` is ``(T,)`` for a sequence and nothing for one pose.

    ``degrees`` (…, A) of the angles ``names`` are NaN where a joint is missing, two joints coincide or the
    angle is not defined. ``sigma`` (…, A) are standard deviations in degrees, to first order in the
    covariances of the joints; NaN where these are unknown.
    """

    names: tuple[str, ...]
    degrees: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the degrees (…) of one angle."""
        if name not in self.names:
            raise InvalidInputError(f"name: expected one of {', '.join(self.names)}, got {name!r}")
        return self.degrees[..., self.names.index(name)]


def joint_angles(
    pose: ArrayLike | Refinement,
    *,
    layout: str | Layout,
    uncertainty: ArrayLike | None = None,
    up: str | ArrayLike | None = "z",
) -> JointAngles:
    """Return the joint angles of one pose or of a sequence, with error bars.

    Knees and elbows have a flexion, hips and shoulders a flexion and an abduction, ankles a dorsiflexion if
    the layout has feet; trunk and pelvis lean against the vertical. All are 0 in upright standing with the
    arms hanging; the guide on joint angles defines each. Those whose joints the layout does not have are left
    out. The layout's own follow, in place of those with the same name.

    Parameters
    ----------
    pose : (…, N, 3), Refinement or SequenceRefinement
        Positions in any unit; NaN where unknown. The axis before N is taken for time: along it, angles that
        can exceed half a turn are continuous.
    layout : str or Layout
        What the N joints are, and its own angles. Joints are found by the names of the built-in layouts.
    uncertainty : (…, N, 3, 3), optional
        Covariances of the positions, unit². By default ``error_bar`` of a `Refinement`, and none for an
        array. The errors of different joints are taken for independent.
    up : "x", "y", "z", "-x", "-y", "-z", (3,) or None
        The vertical of the world. None leaves out the angles that need it: those of trunk and pelvis.
    """
    layout = Layout.by_name(layout) if isinstance(layout, str) else layout
    if isinstance(pose, Refinement):
        uncertainty = pose.error_bar if uncertainty is None else uncertainty
        pose = pose.pose
    points = numbers(pose, "pose")
    if points.shape[-2:] != (layout.n_joints, 3):
        raise InvalidInputError(f"pose: expected shape (…, {layout.n_joints}, 3), got {points.shape}")
    covariance = None if uncertainty is None else numbers(uncertainty, "uncertainty")
    if covariance is not None and covariance.shape != (*points.shape, 3):
        raise InvalidInputError(f"uncertainty: expected shape {(*points.shape, 3)}, got {covariance.shape}")
    return angles_of_joints(points, layout.joints, covariance, _vertical(up), own_angles(layout))


def angles_of_joints(
    points: Array,
    joints: Sequence[str],
    covariance: Array | None,
    up: Array | None,
    own: Sequence[Angle] = (),
) -> JointAngles:
    """Return the angles of points (…, N, 3) with these names, and a layout's ``own``."""
    place = _places(joints)
    found = _angles_of(place, own, leaning=up is not None)
    if not found:
        expected = "angles, or joints of one, such as left_hip, left_knee and left_ankle"
        raise InvalidInputError(f"layout: expected {expected}, got {', '.join(joints[:4])}, …")
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        pairs = [_solve(angle, points, place, covariance, up) for angle in found]
    degrees, sigma = (np.stack(values, axis=-1) for values in zip(*pairs, strict=True))
    return JointAngles(tuple(angle.name for angle in found), degrees, sigma)


def own_angles(layout: Layout) -> tuple[Angle, ...]:
    """Return a layout's own angles."""
    found = []
    for name, places, sign, offset in layout.angles:
        a, b, c, d = ((layout.joints[k],) for k in (*places[:2], *places[-2:]))
        found.append(Angle(name, between, ((a, b), (c, d)), offset, sign))
    return tuple(found)


def known_angles(joints: Sequence[str], own: Sequence[Angle], *, leaning: bool = True) -> list[Angle]:
    """Return the angles that joints of these names have; without ``leaning``, those without a vertical."""
    return _angles_of(_places(joints), own, leaning=leaning)


def _places(joints: Sequence[str]) -> dict[str, int]:
    """Return the index of every joint; the big toes are found under other names as well."""
    place = {name: k for k, name in enumerate(joints)}
    for side, toe in product(("left", "right"), TOES):
        if f"{side}_{toe}" in place:
            place.setdefault(f"{side}_big_toe", place[f"{side}_{toe}"])
    return place


def _angles_of(place: dict[str, int], own: Sequence[Angle], *, leaning: bool) -> list[Angle]:
    replaced = {angle.name for angle in own}
    every = (*(angle for angle in _ANGLES if angle.name not in replaced), *own)
    return [angle for angle in every if angle.joints <= set(place) and (leaning or not angle.leans)]


@dataclass(frozen=True)
class Angle:
    """An angle in degrees: ``offset + sign · kind(directions)``."""

    name: str
    kind: Kind
    directions: tuple[Direction, ...]
    offset: float = 0.0
    sign: float = 1.0
    least: float | None = None  # the lowest value where no frame before says otherwise; None: never wraps

    @property
    def joints(self) -> set[str]:
        return {joint for ends in self.directions if ends != UP for point in ends for joint in point}

    @property
    def at(self) -> set[str]:
        """Joints at which it is: where its limb meets another direction, or begins; all if it leans."""
        limb, *others = ([set(point) for point in ends] for ends in self.directions if ends != UP)
        if self.leans:
            return limb[0] | limb[1]
        return (limb[0] | limb[1]) & set().union(*chain.from_iterable(others)) or limb[0]

    @property
    def leans(self) -> bool:
        return UP in self.directions


def _solve(
    angle: Angle, points: Array, place: dict[str, int], covariance: Array | None, up: Array | None
) -> tuple[Array, Array]:
    """Return an angle and its standard deviation in degrees, both (…)."""
    ends: list[Array] = []
    for direction in angle.directions:
        if isinstance(direction, str):
            ends.append(np.broadcast_to(np.asarray(up), (*points.shape[:-2], 3)))
            continue
        start, end = (points[..., [place[joint] for joint in point], :].mean(axis=-2) for point in direction)
        scale = np.maximum(np.abs(start), np.abs(end)).max(axis=-1)
        vector = end - start
        ends.append(np.where((_norm(vector) > _TINY * scale)[..., None], vector, np.nan))
    value, gradients, clear = angle.kind(*ends)
    degrees = angle.offset + angle.sign * np.degrees(value)
    if angle.least is not None:
        degrees = _continuous(degrees, clear > _NEAR_AXIS, angle.least)
    if covariance is None:
        return degrees, np.full(degrees.shape, np.nan)
    by_joint: dict[str, Array] = {}
    for direction, gradient in zip(angle.directions, gradients, strict=True):
        if not isinstance(direction, str):
            for point, sign in zip(direction, (-1.0, 1.0), strict=True):
                for joint in point:
                    by_joint[joint] = by_joint.get(joint, 0.0) + sign / len(point) * gradient
    variance = sum(
        _dot(gradient, np.einsum("...ij,...j->...i", covariance[..., place[joint], :, :], gradient))
        for joint, gradient in by_joint.items()
    )
    return degrees, np.degrees(np.sqrt(np.maximum(variance, 0.0)))


def between(a: Array, b: Array) -> tuple[Array, Gradients, Array]:
    """Return the angle between two directions (…, 3), 0 to π, its gradients in them, and 1.

    At 0 and π, where it is not differentiable, the gradients are those of one of the planes through both.
    """
    axis = np.cross(a, b)
    value = np.arctan2(_norm(axis), _dot(a, b))
    straight = _norm(axis) <= _TINY * _norm(a) * _norm(b)
    axis = _unit(np.where(straight[..., None], np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=-1)]), axis))
    in_a, in_b = (np.cross(axis, _unit(v)) / _norm(v)[..., None] for v in (a, b))
    return value, (-in_a, in_b), np.ones(value.shape)


def swing(limb: Array, up: Array, left: Array) -> tuple[Array, Gradients, Array]:
    """Return how far a limb is swung forward from hanging down, −π to π.

    It is the angle of the limb's projection onto the plane through ``up`` and the forward direction, which is
    perpendicular to ``up`` and ``left``. Also the gradients, and the length of the projection as a part of
    the limb's: where it is 0 the angle is not defined.
    """
    forward = np.cross(left, up)
    ahead, along = _unit(forward), _unit(up)
    x, y = -_dot(limb, along), _dot(limb, ahead)
    square = x**2 + y**2
    clear = np.sqrt(square) / _norm(limb)
    defined = (_norm(forward) > _TINY * _norm(left) * _norm(up)) & (clear > _TINY)
    # d(value) = (x dy − y dx) / (x² + y²)
    by_y, by_x = ((part / square)[..., None] for part in (x, -y))
    by_forward = by_y * (limb - y[..., None] * ahead) / _norm(forward)[..., None]
    by_up = -by_x * (limb + x[..., None] * along) / _norm(up)[..., None] + np.cross(by_forward, left)
    gradients = (by_y * ahead - by_x * along, by_up, np.cross(up, by_forward))
    return np.where(defined, np.arctan2(y, x), np.nan), gradients, clear


def aside(limb: Array, up: Array, left: Array) -> tuple[Array, Gradients, Array]:
    """Return the angle of a limb with the part of ``left`` that is perpendicular to ``up``, and gradients."""
    along, length = _unit(up), _norm(up)[..., None]
    part = _dot(left, along)[..., None]
    sideways = left - part * along
    degenerate = _norm(sideways) <= _TINY * _norm(left)
    value, (by_limb, by_side), ones = between(limb, np.where(degenerate[..., None], np.nan, sideways))
    by_left = by_side - _dot(by_side, along)[..., None] * along
    by_up = -(part * by_left + _dot(by_side, along)[..., None] * sideways) / length
    return value, (by_limb, by_up, by_left), ones


def _continuous(degrees: Array, clear: Mask, least: float) -> Array:
    """Return angles (…, T) from ``least`` to ``least + 360`` at first, then continuous in time.

    After a frame without a value, or where it is too uncertain to count turns, they begin anew.
    """
    base: Array = (degrees - least) % 360.0 + least
    if not base.ndim:
        return base
    known = clear & np.isfinite(base)
    linked = known[..., 1:] & known[..., :-1]
    turns = np.zeros(base.shape)
    turns[..., 1:] = np.where(linked, -np.round(np.nan_to_num(np.diff(base)) / 360.0), 0.0)
    turns = np.cumsum(turns, axis=-1)
    begins = np.ones(base.shape, dtype=np.bool_)
    begins[..., 1:] = ~linked
    last = np.maximum.accumulate(np.where(begins, np.arange(base.shape[-1]), 0), axis=-1)
    result: Array = base + 360.0 * (turns - np.take_along_axis(turns, last, axis=-1))
    return result


def _vertical(up: str | ArrayLike | None) -> Array | None:
    """Return the vertical (3,) that ``up`` names."""
    if up is None:
        return None
    expected = "up: expected x, y, z, -x, -y, -z, a direction (3,) or None, got"
    if isinstance(up, str):
        if up.removeprefix("-") not in ("x", "y", "z"):
            raise InvalidInputError(f"{expected} {up!r}")
        return np.array([float(up == axis) - float(up == f"-{axis}") for axis in "xyz"])
    vector = numbers(up, "up")
    if vector.shape != (3,) or not 0 < _norm(vector) < np.inf:
        raise InvalidInputError(f"{expected} {vector.tolist()}")
    return vector


def _dot(a: Array, b: Array) -> Array:
    result: Array = np.einsum("...i,...i->...", a, b)
    return result


def _norm(vector: Array) -> Array:
    return np.sqrt(_dot(vector, vector))


def _unit(vector: Array) -> Array:
    return vector / _norm(vector)[..., None]


_HIPS: Point = ("left_hip", "right_hip")
_SHOULDERS: Point = ("left_shoulder", "right_shoulder")
_TRUNK = (_HIPS, _SHOULDERS)
_PELVIS = (("right_hip",), ("left_hip",))
_GIRDLE = (("right_shoulder",), ("left_shoulder",))


def _of_side(side: str, right: float) -> list[Angle]:
    def ends(a: str, b: str) -> Direction:
        return (f"{side}_{a}",), (f"{side}_{b}",)

    thigh, arm, foot = ends("hip", "knee"), ends("shoulder", "elbow"), ends("heel", "big_toe")
    outward = (-90.0 * right, right)
    return [
        Angle(f"{side}_hip_flexion", swing, (thigh, _TRUNK, _PELVIS), least=-90.0),
        Angle(f"{side}_hip_abduction", aside, (thigh, _TRUNK, _PELVIS), *outward),
        Angle(f"{side}_knee_flexion", between, (thigh, ends("knee", "ankle"))),
        Angle(f"{side}_ankle_dorsiflexion", between, (ends("ankle", "knee"), foot), 90.0, -1.0),
        Angle(f"{side}_shoulder_flexion", swing, (arm, _TRUNK, _GIRDLE), least=-90.0),
        Angle(f"{side}_shoulder_abduction", aside, (arm, _TRUNK, _GIRDLE), *outward),
        Angle(f"{side}_elbow_flexion", between, (arm, ends("elbow", "wrist"))),
    ]


_ANGLES: tuple[Angle, ...] = (
    *chain.from_iterable(zip(_of_side("left", -1.0), _of_side("right", 1.0), strict=True)),
    Angle("trunk_inclination", between, (_TRUNK, UP)),
    Angle("trunk_forward_lean", swing, ((_SHOULDERS, _HIPS), UP, _PELVIS), 0.0, -1.0, least=-180.0),
    Angle("trunk_side_lean", aside, (_TRUNK, UP, _PELVIS), 90.0, -1.0),
    Angle("pelvis_obliquity", between, (_PELVIS, UP), 90.0, -1.0),
)
