"""What the pose writers write: refined poses with names and units, in memory or part by part."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import FARTHEST, Array, Index, Mask, flags, numbers, positive, whole_numbers
from skelsplat._budget import within_memory
from skelsplat._fields import FRAME_LIMIT
from skelsplat._skelsplat import JOINT_STATUS
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io._arrays import FRAME_RATES, RowFile

_LENGTHS = ("pose", "init_pose", "joint_bias", "noise", "velocity", "bone_lengths", "bone_length_sigma")
_SQUARES = ("covariance", "uncertainty", "velocity_uncertainty")
_STATUSES = (*JOINT_STATUS, "filled")
_WITH_POSITION = ("ok", "inferred", "filled")  # statuses
_TEXT = np.dtype("U16")  # of `PoseParts`: room for every status and stop reason
_READ: dict[type[np.generic], Callable[[Any, str], npt.NDArray[Any]]] = {
    np.float64: numbers,
    np.int64: whole_numbers,
    np.bool_: flags,
    np.str_: lambda value, _: np.asarray(value, dtype=np.str_),
}


def _array(axes: str, kind: type[np.generic] = np.float64) -> Any:
    """Return the field of an array with these axes: T frames, M cameras, N joints, B bones; else numbers."""
    empty = [int(axis) if axis.isdigit() else 0 for axis in axes.split()]
    return field(default_factory=lambda: np.empty(empty, kind), metadata={"array": (axes, kind)})


@dataclass(frozen=True)
class PoseData:
    """A sequence of poses of one person.

    Everything after `unit` may be left out; it is then empty (length 0 along the first axis).

    Attributes
    ----------
    pose : (T, N, 3)
        Joint positions in `unit`; NaN where a joint has none.
    joint_names : tuple of str, N
    frames : (T,) int
        Frame numbers of the source.
    unit : "mm", "cm" or "m"
    camera_names : tuple of str, M
    init_pose, covariance, uncertainty, joint_bias, error_bar, noise
        As of `skelsplat.Refinement`, in `unit` or `unit` squared. ``error_bar`` is derived: without
        ``joint_bias`` it is the ``uncertainty``.
    view_weights, swapped, reprojection_error, loss, n_iter, stop_reason
        As of `skelsplat.Refinement`.
    joint_status : (T, N) str
        As of `skelsplat.Refinement`, or "filled": interpolated over a gap in time.
    velocity, velocity_uncertainty, bones, bone_lengths, bone_length_sigma
        As of `skelsplat.SequenceRefinement`; empty for poses refined frame by frame.
    frame_rate : float or None
        Frames per second; None if unknown.
    processing : tuple of str
        What was done to `pose` over time, a sentence each: gaps filled, filters. The other arrays stay those
        of the refinement.

    An array that does not fit, an unknown unit or a joint that is "ok", "inferred" or "filled" and has no
    position is an `InvalidInputError`.
    """

    pose: Array
    joint_names: tuple[str, ...]
    frames: Index
    unit: str
    camera_names: tuple[str, ...] = ()
    init_pose: Array = _array("T N 3")
    uncertainty: Array = _array("T N 3 3")
    joint_bias: Array = _array("T N")
    covariance: Array = _array("T N 3 3")
    joint_status: npt.NDArray[np.str_] = _array("T N", np.str_)
    view_weights: Array = _array("T M N")
    swapped: Mask = _array("T M N", np.bool_)
    reprojection_error: Array = _array("T M N")
    noise: Array = _array("T")
    loss: Array = _array("T")
    n_iter: Index = _array("T", np.int64)
    stop_reason: npt.NDArray[np.str_] = _array("T", np.str_)
    velocity: Array = _array("T N 3")
    velocity_uncertainty: Array = _array("T N 3 3")
    bones: Index = _array("B 2", np.int64)
    bone_lengths: Array = _array("B")
    bone_length_sigma: Array = _array("B")
    frame_rate: float | None = None
    processing: tuple[str, ...] = ()

    def __repr__(self) -> str:
        size = f"{self.pose.shape[0]} frames, {len(self.joint_names)} joints"
        return f"PoseData({size}, {len(self.camera_names)} cameras, unit {self.unit!r})"

    def __post_init__(self) -> None:
        for name, (_, kind) in _ALL.items():
            object.__setattr__(self, name, _READ[kind](getattr(self, name), name))
        for name in ("joint_names", "camera_names", "processing"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
            for text in getattr(self, name):
                is_unicode = isinstance(text, str) and text.encode(errors="replace").decode() == text
                if not is_unicode or "\0" in text:  # which ends a text in npz, C3D and NetCDF
                    expected = "texts in Unicode without \\0"
                    raise InvalidInputError(f"{name}: expected {expected}, got {text!r:.60}")
        one_of("unit", self.unit, MM_PER_UNIT)
        if self.frame_rate is not None:
            positive("frame_rate", self.frame_rate)
        self._check_shapes()
        if len(self.joint_status):
            self._check_statuses()

    def _check_shapes(self) -> None:
        if self.pose.ndim != 3 or self.pose.shape[2] != 3:
            raise InvalidInputError(f"pose: expected shape (T, N, 3), got {self.pose.shape}")
        steps, joints, _ = self.pose.shape
        if len(self.joint_names) != joints:
            raise InvalidInputError(f"joint_names: expected {joints}, got {len(self.joint_names)}")
        sizes = {"T": steps, "M": len(self.camera_names), "N": joints, "B": len(self.bones)}
        for name, (axes, _) in _ALL.items():
            actual, expected = getattr(self, name).shape, shape_of(axes, sizes)
            if actual != expected and not (name in ARRAYS and actual[:1] == (0,)):
                raise InvalidInputError(f"{name}: expected shape {expected}, got {actual}")

    def _check_statuses(self) -> None:
        unknown = ~np.isin(self.joint_status, (*_STATUSES, ""))
        lacking = np.isnan(self.pose).any(axis=-1) & np.isin(self.joint_status, _WITH_POSITION)
        for t, j in np.argwhere(unknown | lacking)[:1]:
            where = f"frame {self.frames[t]}, joint {self.joint_names[j]}"
            expected = f"one of {', '.join(_STATUSES)} in {where}, unobserved or weak without a position"
            raise InvalidInputError(f"joint_status: expected {expected}, got {self.joint_status[t][j]}")

    @classmethod
    def from_refinement(
        cls,
        refinement: sk.Refinement,
        *,
        joint_names: Sequence[str],
        frames: npt.ArrayLike,
        camera_names: Sequence[str],
        unit: str,
        frame_rate: float | None = None,
    ) -> PoseData:
        """Collect the result of a refinement over T frames with its names; arrays are not copied."""
        held = [name for name in (*ARRAYS, *BONES) if hasattr(refinement, name)]
        arrays: dict[str, Any] = {name: getattr(refinement, name) for name in held}
        return cls(
            joint_names=tuple(joint_names),
            frames=whole_numbers(frames, "frames"),
            unit=unit,
            camera_names=tuple(camera_names),
            frame_rate=frame_rate,
            **arrays,
        )

    @property
    def error_bar(self) -> Array:
        if not (self.uncertainty.size and self.joint_bias.size):
            return self.uncertainty
        return self.uncertainty + self.joint_bias[..., None, None] ** 2 * np.eye(3)

    def in_unit(self, unit: str) -> PoseData:
        """Return the same poses with all lengths in ``unit``: "mm", "cm" or "m"."""
        one_of("unit", unit, MM_PER_UNIT)
        factor = MM_PER_UNIT[self.unit] / MM_PER_UNIT[unit]
        lengths = {name: getattr(self, name) * factor for name in _LENGTHS}
        squares = {name: getattr(self, name) * factor**2 for name in _SQUARES}
        return replace(self, unit=unit, **lengths, **squares)

    def at_rate(self, frame_rate: float) -> PoseData:
        """Return the same poses at another frame rate; velocities, if there are any, change with it."""
        positive("frame_rate", frame_rate)
        low, high = FRAME_RATES
        if not low <= frame_rate <= high:
            raise InvalidInputError(f"frame_rate: expected {low:g} to {high:g}, got {frame_rate:g}")
        factor = frame_rate / (self.frame_rate or frame_rate)
        squares = self.velocity_uncertainty * (factor * factor)
        velocity = self.velocity * factor
        return replace(self, frame_rate=frame_rate, velocity=velocity, velocity_uncertainty=squares)


# the axes of every array and the type of its entries
_ALL: dict[str, tuple[str, type[np.generic]]] = {
    "pose": ("T N 3", np.float64),
    **{entry.name: entry.metadata["array"] for entry in fields(PoseData) if entry.metadata},
    "frames": ("T", np.int64),
}
BONES = {name: array for name, array in _ALL.items() if array[0].startswith("B")}
ARRAYS = {name: array for name, array in _ALL.items() if name not in (*BONES, "frames")}
"""Those by frame, other than their numbers."""


class PoseParts:
    """Poses too long for the memory, in a folder; iterating yields them as `PoseData` of ``size`` frames.

    ``head`` has what is not by frame, of the last part; ``frames`` (T,) are all, also those that are not
    appended yet; ``rows`` are the arrays of `PoseData` that the poses have, by name.
    """

    head: PoseData

    def __init__(self, folder: Path, frames: Index, size: int) -> None:
        self.frames, self.rows = frames, dict[str, RowFile]()
        self._folder, self._size = folder, size

    def append(self, data: PoseData) -> None:
        """Add further frames."""
        nothing: dict[str, Any] = {"frames": data.frames[:0]}
        for name, (_, kind) in ARRAYS.items():
            array = getattr(data, name)
            if len(array) != len(data.frames):
                continue
            if name not in self.rows:
                dtype = _TEXT if kind is np.str_ else np.dtype(kind)
                self.rows[name] = RowFile(self._folder / name, array.shape[1:], dtype)
            self.rows[name].append(array)
            nothing[name] = array[:0]
        self.head = replace(data, **nothing)

    def __iter__(self) -> Iterator[PoseData]:
        for first in range(0, len(self.frames), self._size):
            end = min(first + self._size, len(self.frames))
            arrays: dict[str, Any] = {name: rows.read(first, end) for name, rows in self.rows.items()}
            yield replace(self.head, **arrays, frames=self.frames[first:end])


Poses = PoseData | PoseParts


def parts_of(data: Poses) -> tuple[PoseData, Index, Iterator[PoseData]]:
    """Return what holds for all frames, the frames, and the parts: of poses in memory a single one."""
    head = data if isinstance(data, PoseData) else data.head
    return head, data.frames, iter([data] if isinstance(data, PoseData) else data)


def checked(
    read: Callable[[str | os.PathLike[str]], PoseData],
) -> Callable[[str | os.PathLike[str]], PoseData]:
    """Give a reader of poses what all share: errors name the file, numbers can be computed with."""

    @functools.wraps(read)
    def reader(path: str | os.PathLike[str]) -> PoseData:
        source = Path(path)
        with within_memory(source):
            try:
                data = read(path)
            except InvalidInputError as error:
                raise DatasetError.of_argument(source, error) from error
        if (np.abs(data.frames) >= FRAME_LIMIT).any():
            raise DatasetError(source, "frames", "numbers below 2^62", "a larger one")
        most = FARTHEST * 1e3 / MM_PER_UNIT[data.unit]
        for name, (_, kind) in _ALL.items():
            values = getattr(data, name)
            if name == "bone_length_sigma":  # infinite for a bone that is never seen
                values = values[np.isfinite(values)]
            limit = most**2 if name in _SQUARES else most
            if kind is np.float64 and np.nanmax(np.abs(values), initial=0.0) > limit:
                expected = f"finite numbers within ±{limit:g}, none for what is missing"
                raise DatasetError(source, name, expected, "a larger one")
        return data

    return reader


def over_views(values: Array) -> tuple[Index, Array]:
    """Count the views that have a number, of (T, M, N), and average them, (T, N); NaN without a view."""
    seen = np.isfinite(values)
    count = seen.sum(axis=1, dtype=np.int64)
    total = np.where(seen, values, 0.0).sum(axis=1)
    mean: Array = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return count, mean


def shape_of(axes: str, sizes: Mapping[str, int]) -> tuple[int, ...]:
    """Return the shape with the axes of `ARRAYS` or `BONES`, such as ``"T N 3"``."""
    return tuple(sizes[axis] if axis in sizes else int(axis) for axis in axes.split())


def known_frame_rate(data: PoseData, given: float | None, kind: str) -> float:
    """Return the frame rate that is given, or else that of the data; a file of this ``kind`` states one."""
    rate = given if given is not None else data.frame_rate
    if rate is None:
        raise InvalidInputError(f"frame_rate: expected one for a {kind} file, got none")
    positive("frame_rate", rate)
    return rate
