"""The vertical of a run, its joint angles, and their files ``angles.csv``, ``.npz`` and ``.mot``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import skelsplat as sk
from skelsplat._angles import Angle, angles_of_joints, known_angles, own_angles
from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write, atomic_write_text
from skelsplat.exceptions import InvalidInputError
from skelsplat.io.poses._csv import csv_text, times_of

if TYPE_CHECKING:
    from skelsplat.io import PoseData
    from skelsplat.run._run import Run

FILES = ("angles.csv", "angles.npz", "angles.mot")
_DECIMALS = 4  # of a degree
# Length of the cameras' mean upward direction below which they do not agree on a vertical: they look down.
_AGREED_UP = 0.3
# Cosine of the angle between that direction and the nearest axis, below which no axis is taken for vertical.
_NEAR_AXIS = 0.75


def check_angles(layout: sk.Layout) -> None:
    """Raise before the work if the layout has no angle."""
    if not known_angles(layout.joints, own_angles(layout)):
        expected = "a layout with angles, or with names such as left_hip, left_knee and left_ankle"
        raise InvalidInputError(f"angles: expected {expected}, got {layout.name}")


def world_up(rig: sk.CameraRig) -> Array:
    """Return the axis of the world nearest to the cameras' mean upward direction; z if they do not agree."""
    mean: Array = np.mean([-np.asarray(camera.R)[1] for camera in rig], axis=0)
    up = np.zeros(3)
    if np.linalg.norm(mean) < _AGREED_UP:
        up[2] = 1.0
        return up
    axis = int(np.argmax(np.abs(mean)))
    up[axis] = np.sign(mean[axis])
    return up


def vertical_of(rig: sk.CameraRig) -> Array | None:
    """Return the axis of the world that is up (3,); None if the cameras do not show it."""
    mean: Array = np.mean([-np.asarray(camera.R)[1] for camera in rig], axis=0)
    length = float(np.linalg.norm(mean))
    known = length >= _AGREED_UP and float(np.abs(mean).max()) >= _NEAR_AXIS * length
    return world_up(rig) if known else None


def angles_of_poses(
    poses: PoseData, up: Array | None, joints: Sequence[str], own: Sequence[Angle]
) -> sk.JointAngles:
    """Return the angles of poses; ``joints`` are names that replace those of the poses."""
    bars = poses.error_bar if poses.error_bar.size else None
    return angles_of_joints(poses.pose, joints, bars, up, own)


def angles_of(run: Run) -> sk.JointAngles:
    """Return the angles of a run's poses as they are written."""
    return angles_of_poses(run.poses, vertical_of(run.cameras), run.layout.joints, own_angles(run.layout))


def by_title(names: Sequence[str]) -> dict[str, list[tuple[str, int]]]:
    """Return by title, "Knee flexion", the sides ("left", "right" or "") and places of angles."""
    found: dict[str, list[tuple[str, int]]] = {}
    for k, name in enumerate(names):
        side, _, rest = name.partition("_")
        what, side = (rest, side) if side in ("left", "right") else (name, "")
        found.setdefault(what.replace("_", " ").capitalize(), []).append((side, k))
    return found


def write_angles(run: Run, folder: Path, frame_rate: float) -> None:
    """Write `FILES`; ``frame_rate`` gives the times in ``angles.mot`` if the run has none."""
    poses, up = run.poses, vertical_of(run.cameras)
    angles = angles_of(run)
    scatter = sk.joint_angles(poses.pose, layout=run.layout, uncertainty=poses.uncertainty, up=up).sigma
    stamps = zip(poses.frames, times_of(poses.frames, poses.frames[0], poses.frame_rate), strict=True)
    atomic_write_text(folder / FILES[0], _csv(angles, scatter, stamps))
    with atomic_write(folder / FILES[1]) as stream:
        np.savez_compressed(
            stream,
            names=np.array(angles.names, dtype=np.str_),
            degrees=angles.degrees,
            sigma=angles.sigma,
            scatter=scatter,
            frames=poses.frames,
            frame_rate=np.array(np.nan if poses.frame_rate is None else poses.frame_rate),
            up=np.full(3, np.nan) if up is None else up,
            version=np.array(sk.__version__),
        )
    times = (poses.frames - poses.frames[0]) / (poses.frame_rate or frame_rate)
    atomic_write_text(folder / FILES[2], mot_text(angles, times))


def _csv(angles: sk.JointAngles, scatter: Array, stamps: Iterable[tuple[int, Any]]) -> str:
    """Return a row per frame and time, with three columns per angle; a field without a number is empty."""
    ends = ("", "_sigma", "_scatter")
    values = np.stack([angles.degrees, angles.sigma, scatter], axis=-1).reshape(len(scatter), -1)
    rows = [["frame", "time", *(name + end for name in angles.names for end in ends)]]
    for stamp, row in zip(stamps, values.tolist(), strict=True):
        numbers = (f"{value:.{_DECIMALS}f}" if math.isfinite(value) else "" for value in row)
        rows.append([*map(str, stamp), *numbers])
    return csv_text(rows)


def mot_text(angles: sk.JointAngles, times: Array) -> str:
    """Return angles (T, A) at ``times`` in s as OpenSim stores motions; missing values are ``nan``."""
    header = ["Coordinates", "version=1", f"nRows={len(times)}", f"nColumns={len(angles.names) + 1}"]
    lines = [*header, "inDegrees=yes", "endheader", "\t".join(["time", *angles.names])]
    for time, row in zip(times.tolist(), angles.degrees.tolist(), strict=True):
        lines.append("\t".join([f"{time:.6f}", *(f"{value:.{_DECIMALS}f}" for value in row)]))
    return "\n".join(lines) + "\n"
