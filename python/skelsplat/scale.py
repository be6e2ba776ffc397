"""Recordings of any length on many processes or machines: Dask distributes the windows of `refine_sequence`.

What Dask runs on is its user's choice: the threads of this process, processes, a cluster
(docs/howto/large-recordings.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import _skelsplat
from skelsplat._arrays import Array, positive
from skelsplat._chunks import Sliceable, checked
from skelsplat._optional import require
from skelsplat._refine import Cameras, refinement_fields
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import InvalidInputError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["refine"]

# Fields of a result: axes after the time, and the type.
_FIELDS: dict[str, tuple[tuple[str, ...], str]] = {
    "pose": (("joint", "space"), "f8"),
    "covariance": (("joint", "space", "axis"), "f8"),
    "uncertainty": (("joint", "space", "axis"), "f8"),
    "joint_bias": (("joint",), "f8"),
    "view_weights": (("view", "joint"), "f8"),
    "swapped": (("view", "joint"), "?"),
    "reprojection_error": (("view", "joint"), "f8"),
    "joint_status": (("joint",), "U10"),
    "init_pose": (("joint", "space"), "f8"),
    "loss": ((), "f8"),
    "loss_render": ((), "f8"),
    "loss_symmetry": ((), "f8"),
    "n_iter": ((), "i8"),
    "stop_reason": ((), "U15"),
    "noise": ((), "f8"),
    "velocity": (("joint", "space"), "f8"),
    "velocity_uncertainty": (("joint", "space", "axis"), "f8"),
}
_PER_BLOCK = 10_000
_NEEDED = ("skelsplat.scale", "scale")


def refine(
    detections: xr.DataArray | Sliceable,
    cameras: Cameras,
    *,
    fps: float | None = None,
    layout: str | Layout | None = None,
    config: RefineConfig | None = None,
    frames_per_block: int | None = None,
) -> xr.Dataset:
    """Refine a recording as tasks of Dask, with the bits of `skelsplat.refine` or `refine_sequence`.

    Nothing is computed before Dask is asked to, such as by ``compute`` or ``to_zarr`` of the result. Each
    task runs on one thread and returns all fields of its frames: compute the fields together.

    Parameters
    ----------
    detections : (T, M, N, 2|3) Dask array or DataArray
        As in `skelsplat.refine`, with Dask's blocks of any size: each task reads its frames where it runs.
        Another array is sent to the tasks.
    cameras, layout, config
        As in `skelsplat.refine`; ``n_threads`` is 1 by default.
    fps : float, optional
        Frames per second, of one motion in order. Tasks are then the windows of `refine_sequence`, after one
        that learns from a sample of them. None refines every frame by itself.
    frames_per_block : int, optional
        Frames per task, without ``fps``: 10,000 by default.

    Returns
    -------
    xarray.Dataset
        A variable per field of `Refinement` or `SequenceRefinement`, except ``loss_history``, with dimensions
        ``time``, ``view``, ``joint``, ``space`` and ``axis``, and ``bone`` and ``end``. Coordinates
        of the time are kept.

    Raises
    ------
    InvalidInputError
        As `skelsplat.refine` and `refine_sequence`: at once, or for values of detections when they are
        computed, with the frames of the task.
    MissingPackageError
        If Dask or xarray is not installed.
    """
    dask, xarray = (require(name, *_NEEDED) for name in ("dask", "xarray"))
    setup = _Setup(cameras, layout, config, fps)
    array, coords = _as_dask(detections)
    n_frames, n_views, n_joints, _ = array.shape
    setup.refiner().refine(None, np.full((n_views, n_joints, 2), np.nan))  # refuses another rig or layout
    nothing = setup.solve(np.empty((0, n_views, n_joints, 2)))
    rows, parts = _tasks(n_frames, fps, frames_per_block)
    shared, known = dask.delayed(setup, traverse=False), None
    if len(rows) > 1 and fps is not None:
        known = dask.delayed(_learn)(shared, [array[a:b] for a, b in parts], parts)
    solve = dask.delayed(_solve)
    results = [solve(shared, array[row[0] : row[3]], row, known) for row in rows] or [dask.delayed(nothing)]
    sizes = {"view": n_views, "joint": n_joints, "space": 3, "axis": 3}
    variables: dict[str, Any] = {}
    for name, (axes, kind) in _FIELDS.items():
        if name in nothing:  # velocities only in time
            shape = tuple(sizes[axis] for axis in axes)
            variables[name] = (("time", *axes), _joined(results, name, rows, shape, kind))
    if fps is not None:
        bones = require("dask.array", *_NEEDED).from_delayed(
            dask.delayed(_bones)(results), (2, len(nothing["bones"])), float
        )
        variables |= {
            "bones": (("bone", "end"), nothing["bones"]),
            "bone_lengths": ("bone", bones[0]),
            "bone_length_sigma": ("bone", bones[1]),
        }
    unit = cameras.unit if isinstance(cameras, CameraRig) else "mm"
    attributes = {"unit": unit} | ({} if fps is None else {"fps": fps})
    dataset: xr.Dataset = xarray.Dataset(variables, coords, attributes)
    return dataset


def _as_dask(detections: Any) -> tuple[Any, dict[str, Any]]:
    """Return detections as a Dask array, and the coordinates of their time."""
    array, xarray = (require(name, *_NEEDED) for name in ("dask.array", "xarray"))
    values, coords = detections, {}
    if isinstance(detections, xarray.DataArray):
        values, (time, *_) = detections.data, detections.dims
        of_time = {key: value for key, value in detections.coords.items() if value.dims == (time,)}
        coords = {"time" if key == time else key: ("time", value.data) for key, value in of_time.items()}
    shape = getattr(values, "shape", None)
    if shape is None or len(shape) != 4 or np.isnan(shape[0]):
        got = type(values).__name__ if shape is None else f"shape {shape}"
        raise InvalidInputError(f"detections: expected an array (T, M, N, 2|3) of known size, got {got}")
    if not isinstance(values, array.Array):
        values = array.from_array(values, chunks=(_PER_BLOCK, *shape[1:]))
    return values, coords


@dataclass(frozen=True)
class _Setup:
    """What all tasks of a recording need."""

    cameras: Cameras
    layout: str | Layout | None
    config: RefineConfig | None
    fps: float | None

    def refiner(self) -> _skelsplat.Refiner:
        config = self.config or RefineConfig()
        if config.n_threads is None:
            config = config.replace(n_threads=1)
        return _skelsplat.Refiner(self.cameras, layout=self.layout, config=config)

    def solve(self, detections: Array) -> dict[str, Any]:
        """Solve frames each by itself, or all frames of a recording."""
        if self.fps is None:
            return _fields(self.refiner().refine(None, detections))
        return _fields(self.refiner().refine_sequence(None, detections, self.fps))

    def checked(self, given: ArrayLike, start: int, stop: int) -> Array:
        return checked(given, f"frames {start} to {stop - 1}", len(self.cameras)).detections


def _tasks(n: int, fps: float | None, per_block: int | None) -> tuple[list[list[int]], list[list[int]]]:
    """Return rows as of ``sequence_windows``, and the frames from which is learnt."""
    size = _PER_BLOCK if per_block is None else per_block
    positive("frames_per_block", size, "integer")
    if fps is None:
        return [[a, a, min(a + size, n), min(a + size, n)] for a in range(0, n, size)], []
    if per_block is not None:
        raise InvalidInputError(f"frames_per_block: expected None with fps, got {per_block}")
    return _skelsplat.sequence_windows(n, fps)


def _learn(setup: _Setup, pieces: list[ArrayLike], parts: list[list[int]]) -> Array:
    stretches = [setup.checked(piece, *part) for piece, part in zip(pieces, parts, strict=True)]
    lengths = [len(stretch) for stretch in stretches]
    return setup.refiner().learn_sequence(None, np.concatenate(stretches), setup.fps or 0.0, lengths)


def _solve(setup: _Setup, piece: ArrayLike, row: list[int], known: Array | None) -> dict[str, Any]:
    detections = setup.checked(piece, row[0], row[3])
    if known is None:
        return setup.solve(detections)
    window = [[frame - row[0] for frame in row]]
    return _fields(setup.refiner().refine_windows(None, detections, known, window))


def _fields(out: dict[str, Any]) -> dict[str, Any]:
    """Return the fields with the types of `_FIELDS`."""
    fields = refinement_fields(out)
    types = {name: kind for name, (_, kind) in _FIELDS.items() if name in fields}
    return fields | {name: np.asarray(fields[name]).astype(kind) for name, kind in types.items()}


def _joined(results: list[Any], name: str, rows: list[list[int]], shape: tuple[int, ...], kind: str) -> Any:
    """Return a field of all frames."""
    array = require("dask.array", *_NEEDED)
    counts = [row[2] - row[1] for row in rows] or [0]
    parts = [
        array.from_delayed(result[name], (n, *shape), np.dtype(kind))
        for result, n in zip(results, counts, strict=True)
    ]
    return array.concatenate(parts)


def _bones(results: list[dict[str, Any]]) -> Array:
    """Return the bones' lengths, and the median of their errors in the windows that see them, as the core."""
    lengths = np.stack([result["bone_lengths"] for result in results])
    errors = np.sort(np.stack([result["bone_length_sigma"] for result in results]), axis=0)  # infinite last
    middle = np.isfinite(errors).sum(axis=0) // 2
    median = np.take_along_axis(errors, middle[None] % len(errors), axis=0)[0]
    return np.stack([np.fmax.reduce(lengths, axis=0), median])
