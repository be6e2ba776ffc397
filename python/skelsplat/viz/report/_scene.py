"""Sequence, cameras and floor as the page's 3D view reads them: short text, thinned out if long."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, ArrayFields, Index, Mask
from skelsplat.viz import _style
from skelsplat.viz._skeleton import Skeleton

# Around the joints, in mm; the start may lie outside them.
_MARGIN_MM = 1500.0
_MOST = (1.0, 99.0)
# Depth of a camera's pyramid as a part of its distance from the person, and its limits in mm.
_DEPTH, _DEPTH_MM = 0.09, (40.0, 600.0)
_SIDES = {_style.LEFT: 0, _style.RIGHT: 1, _style.MIDDLE: 2}
# Joint positions that a page holds, 33 bytes each with their ellipsoids: 2.5 MB.
MOST_POSITIONS = 75_000
# Part of them that frames with a problem may take.
_FOR_PROBLEMS = 0.25
MISSING = -32768
_LARGEST = 32767
# Ellipsoids are drawn up to this standard deviation, in mm: a body's height.
_WIDEST_MM = 2000.0


@dataclass(frozen=True)
class CameraShapes(ArrayFields):
    """The cameras as they are drawn."""

    names: Sequence[str]  # M names
    centres: Array  # (M, 3) their positions, in mm
    # (M, 4, 3) from the centre to the image's corners (top left, top right, bottom right, bottom left),
    # at depth 1
    corners: Array


@dataclass(frozen=True)
class Sequence3D(ArrayFields):
    """The sequence that the page plays."""

    # (T, N, 3) joint positions before and after, in mm; NaN where unknown
    start: Array
    refined: Array
    error_bar: Array  # (T, N, 3, 3) covariances of the refined joints, in mm²; NaN where unknown
    status: npt.NDArray[np.str_]  # (T, N) joints whose status is not ``"ok"`` are drawn hollow
    frames: Index  # (T,) frame numbers
    frame_rate: float | None  # frames per second; None if unknown
    joint_names: Sequence[str]  # N names
    skeleton: Skeleton  # limbs and sides
    up: Array  # (3,) the vertical: an axis of the world or its opposite
    start_name: str  # what ``start`` is, in words
    # if solved over time: (T, N, 3) the joint positions of each frame alone in mm, and (T, N) the speeds in
    # mm/s, NaN where unknown
    alone: Array | None = None
    speed: Array | None = None
    # of several people: their names; they share the joints in equal parts, and have a colour each
    people: Sequence[str] = ()
    on_floor: Sequence[int] = ()  # places of those whose lowest joint gives the floor; without any, of all

    @property
    def parts(self) -> list[tuple[str, slice]]:
        """Name and joints of each person; one without a name if they are not several."""
        size = len(self.joint_names) // max(len(self.people), 1)
        return [(name, slice(k * size, (k + 1) * size)) for k, name in enumerate(self.people or ("",))]

    @property
    def refined_name(self) -> str:
        """What ``refined`` is, in words."""
        return "refined" if self.alone is None else "over time"

    @property
    def grey(self) -> str:
        """What is drawn in grey next to it."""
        return self.start_name if self.alone is None else "frame by frame"


def pack_scene(sequence: Sequence3D, shapes: CameraShapes, places: Index) -> dict[str, Any]:
    """Return the sequence at ``places`` for the page: axes turned so that the third points up."""
    turn, axes = upright(sequence.up)
    refined = sequence.refined[places] @ turn.T
    corners = [reach(sequence.refined[:, own] @ turn.T, _MARGIN_MM / 2) for _, own in sequence.parts]
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    grid = Grid.over(low - _MARGIN_MM, high + _MARGIN_MM)
    return {
        "axes": axes,
        "frames": as_text(sequence.frames[places], "<f8"),  # time stamps exceed 32 bits
        "count": len(places),
        "frame_rate": sequence.frame_rate,
        "joints": list(sequence.joint_names),
        **_drawn_as(sequence),
        "grid": {"origin": grid.origin.tolist(), "step_mm": grid.step},
        "start": grid.pack(sequence.start[places] @ turn.T),
        "grey": sequence.grey,
        "refined_name": sequence.refined_name,
        "alone": None if sequence.alone is None else grid.pack(sequence.alone[places] @ turn.T),
        "speed": None if sequence.speed is None else pack_speeds(sequence.speed[places]),
        "refined": grid.pack(refined),
        "spread": pack_spreads(turn @ sequence.error_bar[places] @ turn.T),
        "status": pack_labels(sequence.status[places]),
        "reach": [low.tolist(), high.tolist()],
        "floor_mm": _floor(sequence.refined[:, _on_floor(sequence)] @ turn.T, float(low[2])),
        "cameras": _cameras(shapes, turn, (low + high) / 2),
    }


def _drawn_as(sequence: Sequence3D) -> dict[str, Any]:
    """Return limbs, and the groups of limbs and joints that share a colour: body sides, or people."""
    skeleton, joints = sequence.skeleton, range(len(sequence.joint_names))
    parts = [{"name": name, "from": own.start, "to": own.stop} for name, own in sequence.parts]
    if not sequence.people:
        return {
            "groups": list(_style.SIDES),
            "people": parts,
            "sides": [_SIDES[skeleton.colour(joint)] for joint in joints],
            "limbs": [[a, b, _SIDES[skeleton.limb_colour((a, b))]] for a, b in skeleton.limbs],
        }
    return {
        "groups": [person_class(place) for place in range(len(parts))],
        "people": parts,
        "sides": [joint * len(parts) // len(joints) for joint in joints],
        "limbs": [
            [own.start + a, own.start + b, place]
            for place, (_, own) in enumerate(sequence.parts)
            for a, b in skeleton.limbs
        ],
    }


def person_class(place: int) -> str:
    """Return the name of a person's colour in the page's style."""
    return f"person-{place % len(_style.PEOPLE)}"


def upright(up: Array) -> tuple[Array, list[str]]:
    """Return the rotation (3, 3) that turns ``up``, an axis of the world, into z, and the axes' names.

    The rows are axes of the world or their opposites, so that coordinates stay those of the world up to sign.
    """
    third = np.rint(np.asarray(up, dtype=np.float64))
    first = np.zeros(3)
    first[(int(np.argmax(np.abs(third))) + 1) % 3] = 1.0
    turn = np.stack([first, np.cross(third, first), third])
    names = [("−" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in turn]
    return turn, names


def reach(places: Array, margin: float) -> tuple[Array, Array]:
    """Return the corners (D,) of the box of places (…, D); 1 m about 0 without any.

    Places beyond the percentiles `_MOST` may be stray, and do not widen it by more than the margin, nor by
    more than its own half size.
    """
    known = places[np.isfinite(places).all(axis=-1)]
    if not len(known):
        return np.full(places.shape[-1], -500.0), np.full(places.shape[-1], 500.0)
    low, high = np.percentile(known, _MOST, axis=0)
    margin = min(margin, float((high - low).max()) / 2)
    return np.maximum(known.min(axis=0), low - margin), np.minimum(known.max(axis=0), high + margin)


def _on_floor(sequence: Sequence3D) -> Index:
    """Return the joints of the people who stand on the floor."""
    own = [np.arange(len(sequence.joint_names))[part] for _, part in sequence.parts]
    return np.concatenate([own[place] for place in sequence.on_floor or range(len(own))])


def _floor(poses: Array, low: float) -> float:
    """Return the median height of a frame's lowest joint, and ``low`` if there is none."""
    lowest = np.fmin.reduce(poses[..., 2], axis=1)
    known = lowest[np.isfinite(lowest)]
    return float(np.median(known)) if len(known) else low


def _cameras(shapes: CameraShapes, turn: Array, middle: Array) -> list[dict[str, Any]]:
    centres = np.asarray(shapes.centres) @ turn.T
    corners = np.asarray(shapes.corners) @ turn.T
    distance = float(np.median(np.linalg.norm(centres - middle, axis=1))) if len(centres) else 0.0
    depth = float(np.clip(_DEPTH * distance, *_DEPTH_MM))
    return [
        {"name": name, "centre": centre.tolist(), "corners": (centre + depth * rays).tolist()}
        for name, centre, rays in zip(shapes.names, centres, corners, strict=True)
    ]


def frames_to_show(frames: Index, joints: int, wanted: Sequence[int]) -> tuple[Index, int]:
    """Return the places of the frames to show and k: every k-th frame is shown, and the numbers ``wanted``.

    All frames while they hold at most `MOST_POSITIONS` joint positions.
    """
    count, most = len(frames), max(MOST_POSITIONS // max(joints, 1), 8)
    if count <= most:
        return np.arange(count), 1
    some = np.unique(np.asarray(wanted, dtype=np.int64))
    beside = int(_FOR_PROBLEMS * most)
    some = some[np.linspace(0, len(some) - 1, beside).astype(int)] if len(some) > beside else some
    every = -(-count // (most - beside))
    kept = np.arange(count) % every == 0
    return np.flatnonzero(kept | np.isin(frames, some)), every


def thin_line(values: Array, places: Index, *, peaks: bool) -> Array:
    """Return the values at ``places``, or with ``peaks`` the largest from each place to the next."""
    if not peaks or not len(places):
        return values[places]
    return np.fmax.reduceat(values, places)


@dataclass(frozen=True)
class Grid:
    """Whole numbers for positions: position = origin + step · number, in mm."""

    origin: Array
    step: float

    @classmethod
    def over(cls, low: Array, high: Array) -> Grid:
        """Return the finest grid of 16-bit numbers that covers a box."""
        return cls((low + high) / 2, max(float((high - low).max()), 1.0) / (2 * _LARGEST))

    def pack(self, positions: Array) -> str:
        """Return positions (…, 3) as text; what is NaN or outside the box becomes `MISSING`."""
        numbers = np.rint((positions - self.origin) / self.step)
        inside = (np.abs(numbers) <= _LARGEST).all(axis=-1, keepdims=True)  # False for NaN
        return as_text(np.where(inside, numbers, MISSING), "<i2")


def pack_spreads(covariances: Array) -> dict[str, Any]:
    """Return the symmetric roots of covariances (…, 3, 3) in mm²: xx, xy, xz, yy, yz, zz of each joint.

    A root turns the unit sphere into the ellipsoid of one standard deviation. None is wider than 2 m.
    """
    known = np.asarray(np.isfinite(covariances).all(axis=(-2, -1)))
    values, vectors = np.linalg.eigh(np.where(known[..., None, None], covariances, 0.0))
    widths = np.sqrt(np.clip(values, 0.0, _WIDEST_MM**2))
    roots = (vectors * widths[..., None, :]) @ np.swapaxes(vectors, -2, -1)
    six = roots[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    return _packed(six, known[..., None], "step_mm")


def pack_speeds(speeds: Array) -> dict[str, Any]:
    """Return speeds (T, N) in mm/s as whole numbers."""
    return _packed(speeds, np.isfinite(speeds), "step_mm_s")


def _packed(values: Array, known: Mask, unit: str) -> dict[str, Any]:
    """Return numbers as multiples of a step, which is called ``unit``; `MISSING` where they are not known."""
    step = max(float(np.abs(values).max(initial=0.0, where=known)), 1.0) / _LARGEST
    return {unit: step, "numbers": as_text(np.where(known, np.rint(values / step), MISSING), "<i2")}


def pack_labels(labels: npt.NDArray[np.str_]) -> dict[str, Any]:
    """Return labels as one byte each, with the list that the bytes count from."""
    names, places = np.unique(labels, return_inverse=True)
    return {"names": names.tolist(), "numbers": as_text(places, "<u1")}


def as_text(values: npt.NDArray[Any], kind: str) -> str:
    """Return the bytes of an array, as numbers of a kind such as ``"<f4"``, in base64."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
