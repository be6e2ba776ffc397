"""What is to be drawn of a run on one camera's image: its poses and error bars projected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.run.solve import rig_as_used
from skelsplat.viz.overlay import OverlayFrame

if TYPE_CHECKING:
    import numpy.typing as npt

    from skelsplat.io.run_folder import RunFolder

    Array = npt.NDArray[np.float64]

# Step of the central differences in parts of the distance to the camera: about a tenth of a pixel. What they
# leave out is a millionth of the ellipse.
_STEP = 1e-4
_RELIABLE = "ok"


class Scene:
    """A run, frame by frame and camera by camera.

    The lens is that of the run: without distortion if it was left out (``--no-undistort``), as then the
    detections were compared with a pinhole camera's image.
    """

    def __init__(self, run: RunFolder) -> None:
        self.run = run
        self.cameras = list(rig_as_used(run.rig, undistort=run.undistorted))
        self._index = {int(number): t for t, number in enumerate(run.poses.frames)}

    def frame(self, view: int, number: int) -> OverlayFrame | None:
        """Return what the camera `view` sees in the frame `number`; None for one that the run lacks."""
        t = self._index.get(number)
        if t is None:
            return None
        poses, camera, shape = self.run.poses, self.cameras[view], self.run.detections.shape[:3]
        joints = shape[2:]
        uncertainty = _known(poses.uncertainty, (shape[0], *joints, 3, 3))[t]
        status = poses.joint_status[t] if len(poses.joint_status) else np.full(joints, _RELIABLE)
        filled = (status == "filled")[:, None, None]  # a place between others has no error bar
        pose, covariances = project_covariances(poses.pose[t], np.where(filled, np.nan, uncertainty), camera)
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
