"""SkelSplat: accurate 3D human pose from the 2D keypoints of several calibrated cameras, without training.

Each joint is an anisotropic 3D Gaussian, splatted into every view on a channel of its own and matched to a
Gaussian at the 2D detection. The public names are the ones listed in ``__all__``; everything else may change.
"""

from skelsplat import layouts, metrics, synthetic
from skelsplat._angles import JointAngles, joint_angles
from skelsplat._calibrate import CalibratedCamera, Intrinsics, RigCalibration, calibrate_cameras
from skelsplat._clocks import retimed
from skelsplat._people import Person, Tracker, track
from skelsplat._refine import LossAndGradient, Refinement, Refiner, loss_and_gradient, refine
from skelsplat._rig import CameraAdjustment, RigAdjustment, adjust_cameras
from skelsplat._sequence import SequenceRefinement, refine_batches, refine_sequence
from skelsplat._skelsplat import (
    REJECTED_WEIGHT,
    Camera,
    Layout,
    RefineConfig,
    __version__,
    fuse_monocular,
    project,
    project_gaussians,
    pseudo_ground_truth,
    render,
    triangulate,
)
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import (
    DatasetError,
    DegenerateGeometryError,
    InvalidInputError,
    MissingPackageError,
    SkelSplatError,
)

__all__ = [
    "REJECTED_WEIGHT",
    "CalibratedCamera",
    "Camera",
    "CameraAdjustment",
    "CameraRig",
    "DatasetError",
    "DegenerateGeometryError",
    "Intrinsics",
    "InvalidInputError",
    "JointAngles",
    "Layout",
    "LossAndGradient",
    "MissingPackageError",
    "Person",
    "RefineConfig",
    "Refinement",
    "Refiner",
    "RigAdjustment",
    "RigCalibration",
    "SequenceRefinement",
    "SkelSplatError",
    "Tracker",
    "__version__",
    "adjust_cameras",
    "calibrate_cameras",
    "fuse_monocular",
    "joint_angles",
    "layouts",
    "loss_and_gradient",
    "metrics",
    "project",
    "project_gaussians",
    "pseudo_ground_truth",
    "refine",
    "refine_batches",
    "refine_sequence",
    "render",
    "retimed",
    "synthetic",
    "track",
    "triangulate",
]
