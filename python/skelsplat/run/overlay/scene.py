"""What is to be drawn of a run on one camera's image: poses and error bars projected, and a cut-out."""

from __future__ import annotations

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, Mask
from skelsplat.io.run_folder import RunFolder
from skelsplat.io.video import Size
from skelsplat.run.solve import rig_as_used
from skelsplat.viz import Skeleton
from skelsplat.viz.overlay import OverlayFrame

# Step of the central differences in parts of the distance to the camera: about a tenth of a pixel. What they
# leave out is a millionth of the ellipse.
_STEP = 1e-4
_RELIABLE = "ok"
# Of the cut-out: its margin on every side, in parts of the person, its least size, and the frames over which
# its middle is averaged.
_MARGIN, _LEAST_PX, _CALM = 0.15, 64.0, 15


class Scene:
    """A run, frame by frame and camera by camera.

    The lens is that of the run: without distortion if it was left out (``--no-undistort``), as then the
    detections were compared with a pinhole camera's image.
    """

    def __init__(self, run: RunFolder) -> None:
        self.run = run
        self.cameras = list(rig_as_used(run.rig, undistort=run.undistorted))
        self.skeleton = Skeleton(tuple(run.layout.limbs), tuple(run.layout.left_right))
        self._index = {int(number): t for t, number in enumerate(run.poses.frames)}

    def frame(self, view: int, number: int) -> OverlayFrame | None:
        """Return what the camera `view` sees in the frame `number`; None for one that the run lacks."""
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
        return OverlayFrame(
            pose=pose,
            covariances=covariances,
            reliable=status == _RELIABLE,
            detections=self.run.detections[t, view, :, :2],
            weights=_known(poses.view_weights, shape)[t, view],
            swapped=poses.swapped[t, view] if len(poses.swapped) else np.zeros(joints, dtype=bool),
            before=sk.project(start, [camera])[0],
        )

    def outline(self, view: int) -> Array:
        """Return the joints in the camera's pixels over the whole run, (T, N, 2)."""
        seen: Array = sk.project(self.run.poses.pose, [self.cameras[view]])[0]
        return seen


def project_covariances(points: Array, covariances: Array, camera: sk.Camera) -> tuple[Array, Array]:
    """Project points (N, 3) and their covariances (N, 3, 3) through the lens.

    Returns
    -------
    pixels, covariances : (N, 2), (N, 2, 2)
        J Σ Jᵀ with the derivative J of `skelsplat.project` at the point, by central differences: lens
        distortion moves the ellipse and turns and stretches it as well. NaN where nothing is known.
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
    """Return the size of the cut-out, and its upper left corner in each frame.

    Parameters
    ----------
    points : (T, N, 2)
        The person's joints in the pixels of the frames; NaN where unknown.
    size : (width, height)
        Of the frames.

    Returns
    -------
    size : (width, height)
        Enough for the person in 95 of 100 frames, with a margin; the whole frame if it is in none.
    corners : (T, 2) int
        x and y; the middle is averaged over frames and the cut-out stays within the frame.
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
