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
from skelsplat.viz._body import Skeleton, reach, upright

# Around the joints, in mm; the start may lie outside them.
_MARGIN_MM = 1500.0
# Depth of a camera's pyramid as a part of its distance from the person, and its limits in mm.
_DEPTH, _DEPTH_MM = 0.09, (40.0, 600.0)
# Standard deviations at which a camera's ellipsoid may be drawn: those of good rigs are small.
_SIGMAS = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0)
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
    covariances: Array | None = None  # (M, 3, 3) of the positions, in mm², for ellipsoids

    @property
    def sigmas(self) -> float | None:
        """The standard deviations at which ellipsoids are drawn: the largest is as long as a pyramid."""
        if self.covariances is None:
            return None
        widest = np.abs(_roots(self.covariances)).max(initial=0.0, where=np.isfinite(self.covariances))
        depth = _depth(self.centres, self.centres.mean(axis=0))
        return max((one for one in _SIGMAS if one * widest <= depth), default=_SIGMAS[0])


@dataclass(frozen=True)
class Sequence3D(ArrayFields):
    """The sequence that the page plays."""

    # (T, N, 3) joint positions before and after, in mm; NaN where unknown; no start of those not refined
    start: Array | None
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
    floor_mm: float | None = None  # height of the floor along ``up``, where it is known
    on_floor: Sequence[int] = ()  # places of those whose lowest joint gives the floor; without any, of all

    @property
    def parts(self) -> list[tuple[str, slice]]:
        """Name and joints of each person; one without a name if they are not several."""
        size = len(self.joint_names) // max(len(self.people), 1)
        return [(name, slice(k * size, (k + 1) * size)) for k, name in enumerate(self.people or ("",))]

    @property
    def has_trajectory(self) -> bool:
        """Whether the position of a joint is drawn over time: of one person."""
        return not self.people and self.start is not None

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
    refined, parts = sequence.refined @ turn.T, sequence.parts
    corners = [reach(refined[:, own], _MARGIN_MM / 2) for _, own in parts]
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    origin, half = (low + high) / 2, float((high - low).max()) / 2 + _MARGIN_MM

    def positions(poses: Array | None) -> str | None:
        """Return poses as text, in the whole numbers of a grid; what is outside its box is missing."""
        if poses is None:
            return None
        away = poses[places] @ turn.T - origin
        inside = (np.abs(away) <= half).all(axis=-1, keepdims=True)  # False for NaN
        return _whole(away * (_LARGEST / half), inside)

    known = sequence.floor_mm
    standing = [parts[place][1] for place in sequence.on_floor or range(len(parts))]
    lowest = np.fmin.reduce(np.concatenate([refined[:, own, 2] for own in standing], axis=1), axis=1)
    lowest = lowest[np.isfinite(lowest)]
    statuses, codes = np.unique(sequence.status[places], return_inverse=True)
    return {
        "axes": axes,
        "frames": as_text(sequence.frames[places], "<f8"),  # time stamps exceed 32 bits
        "count": len(places),
        "frame_rate": sequence.frame_rate,
        "joints": list(sequence.joint_names),
        **_drawn_as(sequence),
        "grid": {"origin": origin.tolist(), "step_mm": half / _LARGEST},
        "start": positions(sequence.start),
        "grey": sequence.grey,
        "refined_name": sequence.refined_name,
        "alone": positions(sequence.alone),
        "speed": None if sequence.speed is None else _steps(sequence.speed[places], "step_mm_s"),
        "refined": positions(sequence.refined),
        "spread": _spreads(turn @ sequence.error_bar[places] @ turn.T),
        "status": {"names": statuses.tolist(), "numbers": as_text(codes, "<u1")},
        "reach": [low.tolist(), high.tolist()],
        "floor_mm": known
        if known is not None
        else float(np.median(lowest))
        if len(lowest)
        else float(low[2]),
        "floor_known": known is not None,
        "cameras": _cameras(shapes, turn, origin),
    }


def _drawn_as(sequence: Sequence3D) -> dict[str, Any]:
    """Return limbs, and the groups of limbs and joints that share a colour: body sides, or people."""
    skeleton, parts = sequence.skeleton, sequence.parts
    several, joints = bool(sequence.people), range(len(sequence.joint_names))
    return {
        "groups": [person_class(place) for place in range(len(parts))] if several else list(_style.SIDES),
        "people": [{"name": name, "from": own.start, "to": own.stop} for name, own in parts],
        "sides": [
            joint * len(parts) // len(joints) if several else _SIDES[skeleton.colour(joint)]
            for joint in joints
        ],
        "limbs": [
            [own.start + a, own.start + b, place if several else _SIDES[skeleton.limb_colour((a, b))]]
            for place, (_, own) in enumerate(parts)
            for a, b in skeleton.limbs
        ],
    }


def person_class(place: int) -> str:
    """Return the name of a person's colour in the page's style."""
    return f"person-{place % len(_style.PEOPLE)}"


def _cameras(shapes: CameraShapes, turn: Array, middle: Array) -> list[dict[str, Any]]:
    centres, corners = np.asarray(shapes.centres) @ turn.T, np.asarray(shapes.corners) @ turn.T
    depth = _depth(centres, middle)
    cameras = [
        {"name": name, "centre": centre.tolist(), "corners": (centre + depth * rays).tolist()}
        for name, centre, rays in zip(shapes.names, centres, corners, strict=True)
    ]
    if shapes.covariances is not None and shapes.sigmas is not None:
        for camera, root in zip(cameras, _roots(turn @ shapes.covariances @ turn.T), strict=True):
            camera["root"] = (shapes.sigmas * root).tolist() if np.isfinite(root).all() else None
    return cameras


def _depth(centres: Array, middle: Array) -> float:
    """Return the depth of the cameras' pyramids, in mm."""
    distance = float(np.median(np.linalg.norm(centres - middle, axis=1))) if len(centres) else 0.0
    return float(np.clip(_DEPTH * distance, *_DEPTH_MM))


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


def _spreads(covariances: Array) -> dict[str, Any]:
    """Return the symmetric roots of covariances (…, 3, 3) in mm²: xx, xy, xz, yy, yz, zz of each joint."""
    return _steps(_roots(covariances)[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]], "step_mm")


def _roots(covariances: Array) -> Array:
    """Return the symmetric roots (…, 3, 3), in mm, of covariances in mm²; NaN where unknown.

    A root turns the unit sphere into the ellipsoid of one standard deviation. None is wider than 2 m.
    """
    known = np.asarray(np.isfinite(covariances).all(axis=(-2, -1), keepdims=True))
    values, vectors = np.linalg.eigh(np.where(known, covariances, 0.0))
    widths = np.sqrt(np.clip(values, 0.0, _WIDEST_MM**2))
    roots: Array = np.where(known, (vectors * widths[..., None, :]) @ np.swapaxes(vectors, -2, -1), np.nan)
    return roots


def _steps(values: Array, unit: str) -> dict[str, Any]:
    """Return numbers as multiples of a step, which is called ``unit``; `MISSING` for NaN."""
    known = np.isfinite(values)
    step = max(float(np.abs(values).max(initial=0.0, where=known)), 1.0) / _LARGEST
    return {unit: step, "numbers": _whole(values / step, known)}


def _whole(values: Array, known: Mask) -> str:
    return as_text(np.where(known, np.rint(values), MISSING), "<i2")


def as_text(values: npt.NDArray[Any], kind: str) -> str:
    """Return the bytes of an array, as numbers of a kind such as ``"<f4"``, in base64."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
