"""What is to be drawn of a run on one camera's image: poses and error bars projected, and a cut-out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, Mask, median
from skelsplat.io._run_files import REPORT, check_people, folders_of_run
from skelsplat.io.run_folder import RunFolder, read_run
from skelsplat.io.video import Size
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.solve import rig_as_used
from skelsplat.viz import Skeleton, person_colour
from skelsplat.viz.overlay import OverlayFrame

# Step of the central differences in parts of the distance to the camera: about a tenth of a pixel. What they
# leave out is a millionth of the ellipse.
_STEP = 1e-4
_RELIABLE = "ok"
# Of the cut-out: its margin on every side, in parts of the person, its least size, and the frames over which
# its middle is averaged.
_MARGIN, _LEAST_PX, _CALM = 0.15, 64.0, 15


class Scene:
    """A run, or the runs of several people, frame by frame and camera by camera.

    The lens is that of the run: without distortion if it was left out (``--no-undistort``), as then the
    detections were compared with a pinhole camera's image.
    """

    def __init__(self, people: Mapping[str, RunFolder]) -> None:
        """Show people, by the names that are drawn; one with the name ``""`` in the colours of the sides."""
        runs = list(people.values())
        self.rig = runs[0].rig
        self.offsets = runs[0].offsets
        self.frame_rate = runs[0].poses.frame_rate
        self.frames: Index = np.unique(np.concatenate([run.poses.frames for run in runs]))
        self.ends = runs[0].ends if len(runs) == 1 else (int(self.frames[0]), int(self.frames[-1]))
        self.cameras = list(rig_as_used(self.rig, undistort=runs[0].undistorted))
        self.colours = {
            name: person_colour(place) for place, name in enumerate(name for name in people if name)
        }
        self._people = [
            _Person(name, run, self.cameras, self.colours.get(name)) for name, run in people.items()
        ]

    @classmethod
    def read(cls, folder: Path, chosen: FrameRange) -> Scene:
        """Read the folder of a run, or that of several people; of a long run the range alone."""
        names = folders_of_run(folder)
        if not names:
            return cls({"": read_run(folder, within=chosen.to_read)})
        check_people(folder / REPORT)
        return cls({name.replace("_", " "): read_run(folder / name) for name in names})

    def frame(self, view: int, number: int) -> list[Drawn] | None:
        """Return who is in the frame `number` of a camera, the farthest first; None if it is in no run."""
        if number not in self.frames:
            return None
        found = [person.frame(view, number) for person in self._people]
        return sorted((drawn for drawn in found if drawn is not None), key=lambda drawn: -drawn.distance)

    def outline(self, view: int) -> Array:
        """Return everybody's joints in the camera's pixels in all `frames`, (T, N, 2)."""
        parts = []
        for person in self._people:
            whole = np.full((len(self.frames), *person.run.poses.pose.shape[1:]), np.nan)
            whole[np.searchsorted(self.frames, person.run.poses.frames)] = person.run.poses.pose
            parts.append(sk.project(whole, [self.cameras[view]])[0])
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class Drawn:
    """A person in one image."""

    name: str  # ``""`` for the only one
    frame: OverlayFrame
    skeleton: Skeleton
    distance: float  # from the camera, in the unit of the run; 0 if unknown


class _Person:
    """One person's run."""

    def __init__(self, name: str, run: RunFolder, cameras: Sequence[sk.Camera], colour: str | None) -> None:
        self.name, self.run, self.cameras = name, run, cameras
        self.skeleton = Skeleton(tuple(run.layout.limbs), tuple(run.layout.left_right), colour)
        self._index = {int(number): t for t, number in enumerate(run.poses.frames)}

    def frame(self, view: int, number: int) -> Drawn | None:
        """Return what the camera `view` sees of the person; None in a frame that their run lacks."""
        t = self._index.get(number)
        if t is None:
            return None
        poses, camera, shape = self.run.poses, self.cameras[view], self.run.detections.shape[:3]
        joints = shape[2:]
        covariance = _known(poses.error_bar, (shape[0], *joints, 3, 3))[t]
        status = poses.joint_status[t] if len(poses.joint_status) else np.full(joints, _RELIABLE)
        filled = (status == "filled")[:, None, None]  # a place between others has no error bar
        pose, covariances = project_covariances(poses.pose[t], np.where(filled, np.nan, covariance), camera)
        start = _known(poses.init_pose, (shape[0], *joints, 3))[t]
        frame = OverlayFrame(
            pose=pose,
            covariances=covariances,
            reliable=status == _RELIABLE,
            detections=self.run.detections[t, view, :, :2],
            weights=_known(poses.view_weights, shape)[t, view],
            swapped=poses.swapped[t, view] if len(poses.swapped) else np.zeros(joints, dtype=bool),
            before=sk.project(start, [camera])[0],
        )
        away = np.linalg.norm(poses.pose[t] - camera.centre, axis=1)
        return Drawn(self.name, frame, self.skeleton, float(np.nan_to_num(median(away))))


def project_covariances(points: Array, covariances: Array, camera: sk.Camera) -> tuple[Array, Array]:
    """Project points (N, 3) and their covariances (N, 3, 3) through the lens: (N, 2) and J Σ Jᵀ (N, 2, 2).

    J is the derivative of `skelsplat.project` at the point, by central differences: lens distortion moves,
    turns and stretches the ellipse.
    """
    step = _STEP * np.linalg.norm(points - camera.centre, axis=1)  # (N,)
    shifts = np.concatenate([np.eye(3), -np.eye(3)])[:, None] * step[:, None]  # (6, N, 3)
    seen = sk.project(np.concatenate([points[None], points + shifts]), [camera])[0]
    jacobian = (seen[1:4] - seen[4:]) / (2 * step[:, None])  # (3, N, 2)
    return seen[0], np.einsum("anu,nab,bnv->nuv", jacobian, covariances, jacobian)


def _known(values: Array, shape: tuple[int, ...]) -> Array:
    """Return an array of `PoseData`, NaN throughout if it was left out."""
    return values if len(values) else np.full(shape, np.nan)


def follow(points: Array, size: Size) -> tuple[Size, Index]:
    """Return the size of a cut-out that follows joints (T, N, 2), and its upper left corners (T, 2).

    It holds the person in 95 of 100 frames with a margin, or else is the whole frame. Its middle is averaged
    over frames, and it stays within the frame of ``size`` (width, height).
    """
    limit = np.array(size)
    inside: Mask = np.all((points >= -0.5) & (points < limit - 0.5), axis=2)
    points = np.where(inside[..., None], points, np.nan)
    seen: Mask = np.any(inside, axis=1)
    if not seen.any():
        return size, np.zeros((len(points), 2), dtype=np.int64)
    low, high = np.fmin.reduce(points, axis=1), np.fmax.reduce(points, axis=1)  # NaN without the person
    extent = np.quantile((high - low)[seen], 0.95, axis=0)
    wanted = np.maximum(extent * (1 + 2 * _MARGIN), np.maximum(_LEAST_PX, 0.25 * extent[::-1]))
    cut = np.minimum(np.ceil(wanted / 2) * 2, limit).astype(np.int64)
    corners = np.rint(_calm((low + high) / 2, seen) - (cut - 1) / 2).astype(np.int64)
    return (int(cut[0]), int(cut[1])), np.clip(corners, 0, limit - cut)


def _calm(middle: Array, seen: Mask) -> Array:
    """Fill the frames without the person by the nearest ones in time, and average over `_CALM` frames."""
    times = np.arange(len(middle))
    whole = np.stack([np.interp(times, times[seen], axis[seen]) for axis in middle.T], axis=1)
    reach = min(_CALM, len(middle)) // 2
    padded = np.pad(whole, [(reach, reach), (0, 0)], mode="edge")
    kernel = np.full(2 * reach + 1, 1 / (2 * reach + 1))
    return np.stack([np.convolve(axis, kernel, mode="valid") for axis in padded.T], axis=1)
