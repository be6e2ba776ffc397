"""The sequence, the cameras and the floor as the page's 3D view reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.viz import _style
from skelsplat.viz.report._pack import Grid, as_text, pack_labels, pack_spreads

if TYPE_CHECKING:
    import numpy.typing as npt

    from skelsplat.viz.report._data import CameraShapes, Sequence3D

    Array = npt.NDArray[np.float64]

# Around the joints, in mm; the start may lie outside them.
_MARGIN_MM = 1500.0
# Joints beyond these percentiles may be stray, and do not widen the space by more than the margin.
_MOST = (1.0, 99.0)
# Depth of a camera's pyramid as a part of its distance from the person, and its limits in mm.
_DEPTH, _DEPTH_MM = 0.09, (40.0, 600.0)
_SIDES = {_style.LEFT: 0, _style.RIGHT: 1, _style.MIDDLE: 2}


def pack_scene(sequence: Sequence3D, shapes: CameraShapes, places: npt.NDArray[np.int64]) -> dict[str, Any]:
    """Return the sequence at ``places`` for the page: axes turned so that the third points up."""
    turn, axes = upright(sequence.up)
    refined = sequence.refined[places] @ turn.T
    low, high = reach(sequence.refined @ turn.T)
    grid = Grid.over(low - _MARGIN_MM, high + _MARGIN_MM)
    skeleton, joints = sequence.skeleton, range(len(sequence.joint_names))
    return {
        "axes": axes,
        "frames": as_text(sequence.frames[places], "<f8"),  # time stamps exceed 32 bits
        "count": len(places),
        "frame_rate": sequence.frame_rate,
        "joints": list(sequence.joint_names),
        "sides": [_SIDES[skeleton.colour(joint)] for joint in joints],
        "limbs": [[a, b, _SIDES[skeleton.limb_colour((a, b))]] for a, b in skeleton.limbs],
        "grid": {"origin": grid.origin.tolist(), "step_mm": grid.step},
        "start": grid.pack(sequence.start[places] @ turn.T),
        "start_name": sequence.start_name,
        "refined": grid.pack(refined),
        "spread": pack_spreads(turn @ sequence.uncertainty[places] @ turn.T),
        "status": pack_labels(sequence.status[places]),
        "reach": [low.tolist(), high.tolist()],
        "floor_mm": _floor(sequence.refined @ turn.T, float(low[2])),
        "cameras": _cameras(shapes, turn, (low + high) / 2),
    }


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


def reach(poses: Array) -> tuple[Array, Array]:
    """Return the corners of the box of the joints of (T, N, 3), but for stray ones; 1 m without any."""
    known = poses[np.isfinite(poses).all(axis=-1)]
    if not len(known):
        return np.full(3, -500.0), np.full(3, 500.0)
    low, high = np.percentile(known, _MOST, axis=0)
    return (
        np.maximum(known.min(axis=0), low - _MARGIN_MM / 2),
        np.minimum(known.max(axis=0), high + _MARGIN_MM / 2),
    )


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
