"""What the pose writers write: a refined sequence with the names and numbers that give it meaning.

And what marker files (TRC, C3D) have in common: names of the joints, axes, a frame rate.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import FARTHEST, Array, Index, Mask, flags, numbers, positive, whole_numbers
from skelsplat._budget import within_memory
from skelsplat._skelsplat import JOINT_STATUS
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io._arrays import FRAME_RATES
from skelsplat.io._files import of_file
from skelsplat.layouts import BODY25

# the axes of every array (T frames, M cameras, N joints) and the type of its entries
ARRAYS: dict[str, tuple[str, type[np.generic]]] = {
    "pose": ("T N 3", np.float64),
    "init_pose": ("T N 3", np.float64),
    "uncertainty": ("T N 3 3", np.float64),
    "joint_bias": ("T N", np.float64),
    "covariance": ("T N 3 3", np.float64),
    "joint_status": ("T N", np.str_),
    "view_weights": ("T M N", np.float64),
    "swapped": ("T M N", np.bool_),
    "reprojection_error": ("T M N", np.float64),
    "noise": ("T", np.float64),
    "loss": ("T", np.float64),
    "n_iter": ("T", np.int64),
    "stop_reason": ("T", np.str_),
    "velocity": ("T N 3", np.float64),
    "velocity_uncertainty": ("T N 3 3", np.float64),
}
# those of the whole sequence (B bones)
BONES: dict[str, tuple[str, type[np.generic]]] = {
    "bones": ("B 2", np.int64),
    "bone_lengths": ("B", np.float64),
    "bone_length_sigma": ("B", np.float64),
}
_LENGTHS = ("pose", "init_pose", "joint_bias", "noise", "velocity", "bone_lengths", "bone_length_sigma")
_SQUARES = ("covariance", "uncertainty", "velocity_uncertainty")
MARKER_NAMES = ("skelsplat", "pose2sim")
# the world's z axis up becomes the file's y axis up by this order of columns (Pose2Sim does the same)
Y_UP = [1, 2, 0]
_SIDES = {"left": "L", "right": "R"}
_STATUSES = (*JOINT_STATUS, "filled")
_WITH_POSITION = ("ok", "inferred", "filled")  # statuses


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
    init_pose : (T, N, 3)
        The poses that the refinement started from, in `unit`; solved over time, those of each frame alone.
    covariance : (T, N, 3, 3)
        Splat covariances, in `unit` squared: the shape of the splats, no error bars.
    uncertainty : (T, N, 3, 3)
        Posterior covariances of the joints, in `unit` squared: the scatter, what another recording of the
        same poses by the same detector would give; NaN where nothing is known.
    joint_bias : (T, N)
        Standard deviation per axis of the detector's joints from anatomical ones, in `unit`: the same in all
        frames.
    error_bar : (T, N, 3, 3)
        ``uncertainty + joint_bias² I``, the covariances of the distances from anatomical joints; derived.
        Without ``joint_bias`` it is the ``uncertainty``.
    view_weights : (T, M, N)
        How far each detection is believed, in [0, 1]; NaN where there is no detection. Below
        `skelsplat.REJECTED_WEIGHT` it counts as rejected.
    swapped : (T, M, N) bool
        The detection was taken for the joint on the other side of the body.
    noise : (T,)
        Standard deviation of the detections' noise across the ray, in `unit`.
    reprojection_error : (T, M, N)
        Pixels of the original images; NaN where there is no detection.
    joint_status : (T, N) str
        "ok", "weak" or "unobserved" as in `skelsplat.Refinement`, "inferred" as in
        `skelsplat.SequenceRefinement`; "filled": interpolated over a gap in time.
    loss : (T,)
    n_iter : (T,) int
    stop_reason : (T,) str
    velocity : (T, N, 3)
        Velocities of the joints, in `unit` per second. These and what follows are those of a recording
        solved over time (`skelsplat.refine_sequence`), and empty for one frame by frame.
    velocity_uncertainty : (T, N, 3, 3)
        Their posterior covariances.
    bones : (B, 2) int
        The joints at both ends of each bone.
    bone_lengths : (B,)
        Their lengths, one for the whole sequence, in `unit`; NaN for a bone that is never seen.
    bone_length_sigma : (B,)
        Standard errors of the lengths, in `unit`; infinite for a bone that is never seen.
    frame_rate : float or None
        Frames per second; None if unknown.
    processing : tuple of str
        What was done to `pose` over time, a sentence each: gaps filled, filters. The other arrays stay those
        of the refinement.

    Raises
    ------
    InvalidInputError
        If a shape does not fit the others, the unit is unknown, the frame rate is not positive or a joint
        that is "ok", "inferred" or "filled" has no position.
    """

    pose: Array
    joint_names: tuple[str, ...]
    frames: Index
    unit: str
    camera_names: tuple[str, ...] = ()
    init_pose: Array = field(default_factory=lambda: np.empty((0, 0, 3)))
    covariance: Array = field(default_factory=lambda: np.empty((0, 0, 3, 3)))
    uncertainty: Array = field(default_factory=lambda: np.empty((0, 0, 3, 3)))
    joint_bias: Array = field(default_factory=lambda: np.empty((0, 0)))
    view_weights: Array = field(default_factory=lambda: np.empty((0, 0, 0)))
    swapped: Mask = field(default_factory=lambda: np.empty((0, 0, 0), dtype=np.bool_))
    noise: Array = field(default_factory=lambda: np.empty(0))
    reprojection_error: Array = field(default_factory=lambda: np.empty((0, 0, 0)))
    joint_status: npt.NDArray[np.str_] = field(default_factory=lambda: np.empty((0, 0), dtype=np.str_))
    loss: Array = field(default_factory=lambda: np.empty(0))
    n_iter: Index = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    stop_reason: npt.NDArray[np.str_] = field(default_factory=lambda: np.empty(0, dtype=np.str_))
    velocity: Array = field(default_factory=lambda: np.empty((0, 0, 3)))
    velocity_uncertainty: Array = field(default_factory=lambda: np.empty((0, 0, 3, 3)))
    bones: Index = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    bone_lengths: Array = field(default_factory=lambda: np.empty(0))
    bone_length_sigma: Array = field(default_factory=lambda: np.empty(0))
    frame_rate: float | None = None
    processing: tuple[str, ...] = ()

    def __repr__(self) -> str:
        size = f"{self.pose.shape[0]} frames, {len(self.joint_names)} joints"
        return f"PoseData({size}, {len(self.camera_names)} cameras, unit {self.unit!r})"

    def __post_init__(self) -> None:
        self._read_arrays()
        self._check_names()
        one_of("unit", self.unit, MM_PER_UNIT)
        if self.pose.ndim != 3 or self.pose.shape[2] != 3:
            raise InvalidInputError(f"pose: expected shape (T, N, 3), got {self.pose.shape}")
        if self.frame_rate is not None:
            positive("frame_rate", self.frame_rate)
        steps, joints, _ = self.pose.shape
        shapes: dict[str, tuple[int, ...]] = {"joint_names": (joints,), "frames": (steps,)}
        for name in ARRAYS:
            if np.shape(getattr(self, name))[:1] != (0,):
                shapes[name] = shape_of(name, steps, len(self.camera_names), joints)
        shapes |= {"bones": (len(self.bones), 2)}
        shapes |= {name: (len(self.bones),) for name in BONES if name != "bones"}
        for name, shape in shapes.items():
            actual = np.shape(getattr(self, name))
            if actual != shape:
                raise InvalidInputError(f"{name}: expected shape {shape}, got {actual}")
        if len(self.joint_status):
            self._check_statuses()

    def _check_statuses(self) -> None:
        unknown = ~np.isin(self.joint_status, (*_STATUSES, ""))
        lacking = np.isnan(self.pose).any(axis=-1) & np.isin(self.joint_status, _WITH_POSITION)
        for t, j in np.argwhere(unknown | lacking)[:1]:
            where = f"frame {self.frames[t]}, joint {self.joint_names[j]}"
            known = f"one of {', '.join(_STATUSES)} in {where}"
            placeless = f"unobserved or weak in {where}, which has no position"
            expected = known if unknown[t, j] else placeless
            raise InvalidInputError(f"joint_status: expected {expected}, got {self.joint_status[t][j]}")

    def _check_names(self) -> None:
        for field_name in ("joint_names", "camera_names", "processing"):
            for name in getattr(self, field_name):
                if not isinstance(name, str) or name != name.encode(errors="replace").decode():
                    raise InvalidInputError(f"{field_name}: expected texts in Unicode, got {name!r:.60}")
                if "\0" in name:  # which ends a text in npz, C3D and NetCDF
                    raise InvalidInputError(f"{field_name}: expected texts without \\0, got {name!r:.60}")

    def _read_arrays(self) -> None:
        """Take arrays of any kind: NaN for what is masked."""
        read = {np.float64: numbers, np.int64: whole_numbers, np.bool_: flags}
        for name, (_, kind) in {**ARRAYS, **BONES, "frames": ("T", np.int64)}.items():
            if kind in read:
                object.__setattr__(self, name, read[kind](getattr(self, name), name))

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
        held = (name for name in (*ARRAYS, *BONES) if hasattr(refinement, name))
        arrays: dict[str, Any] = {name: getattr(refinement, name) for name in held}
        for name in ("joint_status", "stop_reason"):
            arrays[name] = np.asarray(arrays[name], dtype=np.str_)
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
        data = replace(self, frame_rate=frame_rate)
        low, high = FRAME_RATES
        if not low <= frame_rate <= high:
            raise InvalidInputError(
                f"frame_rate: expected a number from {low:g} to {high:g}, got {frame_rate:g}"
            )
        factor = frame_rate / (self.frame_rate or frame_rate)
        squares = self.velocity_uncertainty * (factor * factor)
        return replace(data, velocity=self.velocity * factor, velocity_uncertainty=squares)


def checked(
    read: Callable[[str | os.PathLike[str]], PoseData],
) -> Callable[[str | os.PathLike[str]], PoseData]:
    """Give a reader of poses what all have in common: lengths are finite or missing, and fit into memory."""

    @functools.wraps(read)
    def reader(path: str | os.PathLike[str]) -> PoseData:
        source = Path(path)
        with within_memory(source):
            try:
                data = read(path)
            except InvalidInputError as error:
                raise of_file(source, error) from error
        for name, (_, kind) in {**ARRAYS, **BONES}.items():
            if kind is np.float64 and name != "bone_length_sigma" and np.isinf(getattr(data, name)).any():
                raise DatasetError(
                    source, name, "finite numbers, none for what is missing", "an infinite one"
                )
        for name in (*_LENGTHS, *_SQUARES):
            power = 2 if name in _SQUARES else 1
            largest = np.nanmax(np.abs(getattr(data, name)), initial=0.0)
            most = (FARTHEST * 1e3 / MM_PER_UNIT[data.unit]) ** power
            if most < largest < np.inf:
                raise DatasetError(source, name, f"numbers within ±{most:g}", f"{largest:g}")
        return data

    return reader


def over_views(values: Array) -> tuple[Index, Array]:
    """Count the views that have a number, of (T, M, N), and average them, (T, N); NaN without a view."""
    seen = np.isfinite(values)
    count = seen.sum(axis=1, dtype=np.int64)
    total = np.where(seen, values, 0.0).sum(axis=1)
    mean: Array = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return count, mean


def shape_of(name: str, steps: int, views: int, joints: int) -> tuple[int, ...]:
    """Return the shape of an array of `ARRAYS`."""
    sizes = {"T": steps, "M": views, "N": joints}
    return tuple(sizes[axis] if axis in sizes else int(axis) for axis in ARRAYS[name][0].split())


def known_frame_rate(data: PoseData, given: float | None, kind: str) -> float:
    """Return the frame rate that is given, or else that of the data; a file of this ``kind`` states one."""
    rate = given if given is not None else data.frame_rate
    if rate is None:
        expected = f"one for a {kind} file (the poses state none)"
        raise InvalidInputError(f"frame_rate: expected {expected}, got none")
    positive("frame_rate", rate)
    return rate


def marker_names(joint_names: tuple[str, ...], convention: str) -> tuple[str, ...]:
    """Return the joints' names in a convention of `MARKER_NAMES`.

    The programs that read TRC and C3D go by names: Pose2Sim's filters, marker augmentation and OpenSim models
    know ``RHip``, ``LBigToe``. Its root is ``CHip`` in BODY_25 and ``Hip`` in HALPE_26.
    """
    one_of("marker_names", convention, MARKER_NAMES)
    if convention == "skelsplat":
        return joint_names
    root = "CHip" if joint_names == tuple(BODY25.joints) else "Hip"
    return tuple(root if name == "pelvis" else _pose2sim(name) for name in joint_names)


def _pose2sim(name: str) -> str:
    side, _, rest = name.partition("_")
    prefix = _SIDES.get(side, "") if rest else ""
    words = (rest if prefix else name).split("_")
    return prefix + "".join(word[:1].upper() + word[1:] for word in words)
