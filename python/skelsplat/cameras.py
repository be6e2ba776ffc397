"""A rig: cameras that belong together, and the unit of their translations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from skelsplat._skelsplat import Camera
from skelsplat.exceptions import InvalidInputError, one_of

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


@dataclass(frozen=True, repr=False)
class CameraRig(Sequence[Camera]):
    """Calibrated cameras of one recording: at least one; those that have a name have different ones.

    `unit` is "mm", "cm" or "m", of the cameras' translations and of every 3D point that goes with them.
    `clocks` are by name, of cameras that were not started at the same time: the frames, its own, by which a
    camera's count is ahead, its frame f + clock is frame f of the others. Detections are put in step by them
    where they are read from files (`skelsplat.io.read_detections`); arrays are taken as they are. What does
    not fit is an `InvalidInputError`.

    `joint_sigma`, in `unit`, is of cameras whose places were estimated: the standard deviation per axis by
    which joints are off because of that, with a recording aligned as a whole. Error bars of poses include it.
    """

    cameras: Sequence[Camera]
    unit: str = "mm"
    clocks: Mapping[str, float] = field(default_factory=dict)
    joint_sigma: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise InvalidInputError("cameras: expected at least one Camera, got none")
        for i, camera in enumerate(self.cameras):
            if not isinstance(camera, Camera):
                raise InvalidInputError(f"cameras[{i}]: expected a Camera, got {type(camera).__name__}")
        names = [c.name for c in self.cameras if c.name is not None]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise InvalidInputError(f"cameras: expected different names, got '{twice[0]}' twice")
        one_of("unit", self.unit, MM_PER_UNIT)
        for name, clock in self.clocks.items():
            if name not in self.names:
                raise InvalidInputError(f"clocks: expected one of {', '.join(self.names)}, got {name!r}")
            if not math.isfinite(clock):
                raise InvalidInputError(f"clocks[{name}]: expected a number of frames, got {clock}")
        if not 0.0 <= self.joint_sigma < math.inf:
            raise InvalidInputError(f"joint_sigma: expected a length of at least 0, got {self.joint_sigma}")
        object.__setattr__(self, "clocks", {name: float(one) for name, one in self.clocks.items() if one})

    @property
    def mm_per_unit(self) -> float:
        """How many millimetres one unit is."""
        return MM_PER_UNIT[self.unit]

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each camera; ``"0"``, ``"1"``, … for those without one."""
        return tuple(c.name if c.name is not None else str(i) for i, c in enumerate(self.cameras))

    def of(self, cameras: Sequence[Camera]) -> CameraRig:
        """Return a rig of these cameras; those called as before keep their clocks."""
        kept = replace(self, cameras=cameras, clocks={})
        return replace(kept, clocks={name: self.clocks.get(name, 0.0) for name in kept.names})

    def __len__(self) -> int:
        return len(self.cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    @overload
    def __getitem__(self, key: int | str) -> Camera: ...
    @overload
    def __getitem__(self, key: slice) -> CameraRig: ...
    def __getitem__(self, key: int | str | slice) -> Camera | CameraRig:
        if isinstance(key, slice):
            return self.of(self.cameras[key])
        if isinstance(key, str):
            if key not in self.names:
                raise KeyError(f"no camera called {key!r}; there are {', '.join(self.names)}")
            return self.cameras[self.names.index(key)]
        return self.cameras[key]

    def __repr__(self) -> str:
        return f"CameraRig({len(self)} cameras, unit='{self.unit}': {', '.join(self.names)})"


def mm_per_unit(cameras: CameraRig | Sequence[Camera]) -> float:
    """Return how many millimetres one unit of these cameras is; a plain sequence is in mm."""
    return cameras.mm_per_unit if isinstance(cameras, CameraRig) else 1.0


def altered(camera: Camera, **changes: Any) -> Camera:
    """Return the camera with some of K, R, t, distortion, fisheye, size and name changed."""
    same = {key: getattr(camera, key) for key in ("K", "R", "t", "distortion", "fisheye", "size", "name")}
    return Camera(**{**same, **changes})


def without_distortion(camera: Camera) -> Camera:
    """Return the camera with an ideal lens."""
    return altered(camera, distortion=None, fisheye=False)


def matrix_from_vector(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) (Rodrigues: axis times angle in radians).

    R = I + sinc(θ)·[v]ₓ + ½·sinc²(θ/2)·[v]ₓ².
    """
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    rotation: NDArray[np.float64] = np.eye(3) + first * cross + second * (cross @ cross)
    return rotation


def matrix_from_quaternion(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z) of any norm above zero."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def vector_from_matrix(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vector (3,) in radians, angle at most π, of a rotation matrix (3, 3).

    Goes through 4·q qᵀ of the unit quaternion q = (w, x, y, z), whose row with the largest diagonal is q up
    to a factor, so that no angle, π included, loses digits.
    """
    r = rotation
    outer = np.array(
        [
            [1.0 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1.0 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1.0 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1.0 - r[0, 0] - r[1, 1] + r[2, 2]],
        ]
    )
    w, *axis = outer[int(np.argmax(np.diag(outer)))]
    sine = float(np.linalg.norm(axis))
    if sine == 0.0:
        return np.zeros(3)
    angle = 2.0 * np.arctan2(sine, abs(w))  # w < 0 is the same rotation the long way round
    vector: NDArray[np.float64] = np.array(axis) * (np.copysign(angle, w) / sine)
    return vector
