"""The compiled core. Arrays in and out are C-ordered float64 unless said otherwise."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat.cameras import CameraRig

__all__ = [
    "JOINT_STATUS",
    "LAYOUT_NAMES",
    "REJECTED_WEIGHT",
    "Camera",
    "Layout",
    "RefineConfig",
    "Refiner",
    "Setting",
    "__version__",
    "check_people",
    "fuse_monocular",
    "implausible_extent",
    "loss_and_gradient",
    "project",
    "project_gaussians",
    "pseudo_ground_truth",
    "render",
    "triangulate",
]

__version__: str
LAYOUT_NAMES: list[str]
JOINT_STATUS: list[str]
REJECTED_WEIGHT: float
"""Detections whose ``Refinement.view_weights`` are below this count as rejected."""

_Cameras = CameraRig | Sequence[Camera]
_Joint = int | str

@final
class Camera:
    """A calibrated camera: pinhole, lens and image size. Immutable.

    World to camera is x_c = R x_w + t with x right, y down, z forward; integer pixel coordinates are pixel
    centres.

    Parameters
    ----------
    K : (3, 3)
        [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
    R : (3, 3)
        Rotation world to camera.
    t : (3,)
        Translation world to camera, in the unit of the rig.
    distortion : (4 | 5 | 8 | 12 | 14,), optional
        OpenCV order k1, k2, p1, p2[, k3[, k4, k5, k6[, s1..s4[, tau_x, tau_y]]]]; 4 with ``fisheye``.
    fisheye : bool
        The four coefficients are those of OpenCV's fisheye model.
    size : (width, height)
        Image size in pixels.
    name : str, optional

    Raises
    ------
    InvalidInputError
        A wrong shape, a value that is not finite or outside its range (page Conventions), an R that is not a
        rotation, a wrong number of coefficients.
    """

    def __new__(
        cls,
        K: ArrayLike,
        R: ArrayLike,
        t: ArrayLike,
        *,
        distortion: ArrayLike | None = None,
        fisheye: bool = False,
        size: Sequence[int],
        name: str | None = None,
    ) -> Camera: ...
    @property
    def K(self) -> NDArray[np.float64]:
        """Camera matrix (3, 3)."""
    @property
    def R(self) -> NDArray[np.float64]:
        """Rotation world to camera (3, 3)."""
    @property
    def t(self) -> NDArray[np.float64]:
        """Translation world to camera (3,)."""
    @property
    def centre(self) -> NDArray[np.float64]:
        """Camera centre −Rᵀt in the world (3,)."""
    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
    @property
    def name(self) -> str | None:
        """Name, if it has one."""
    @property
    def fisheye(self) -> bool:
        """Whether the lens follows OpenCV's fisheye model."""
    @property
    def distortion(self) -> NDArray[np.float64] | None:
        """Distortion coefficients as given."""
    def scaled(self, factor: float) -> Camera:
        """Return the camera of images resized by ``factor``: u' = (u + ½) · factor − ½."""
    def undistort(self, points: ArrayLike) -> NDArray[np.float64]:
        """Map pixels (…, 2) to ideal pixels of the same K; NaN where no ray through the lens arrives."""
    def __eq__(self, other: object, /) -> bool: ...

@final
class Layout:
    """Joint names, limbs and symmetries of a skeleton. Immutable. Joints are given by index or by name.

    Parameters
    ----------
    name : str
    joints : sequence of str
        The N joint names, in the order of the arrays.
    limbs : sequence of (joint, joint)
    symmetric : sequence of (tier, (l1, l2), (r1, r2))
        Limbs of equal length; tier 1 (lower arms and legs), 2 (upper arms and legs) or 3.
    left_right : sequence of (left, right)
        Joints that are mirror images.
    occlusion_prone : sequence of joints
        Those that ``RefineConfig.occlusion_sigma`` applies to.
    root : sequence of joints
        Joints whose mean is the root.

    Raises
    ------
    InvalidInputError
        A name or index that is no joint, a joint paired with itself, a tier other than 1, 2, 3.
    """

    def __new__(
        cls,
        name: str,
        joints: Sequence[str],
        *,
        limbs: Sequence[Sequence[_Joint]] | None = None,
        symmetric: Sequence[tuple[int, Sequence[_Joint], Sequence[_Joint]]] | None = None,
        left_right: Sequence[Sequence[_Joint]] | None = None,
        occlusion_prone: Sequence[_Joint] | None = None,
        root: Sequence[_Joint] | None = None,
    ) -> Layout: ...
    @staticmethod
    def by_name(name: str) -> Layout:
        """Return the built-in layout of that name."""
    @property
    def name(self) -> str:
        """Name of the layout."""
    @property
    def n_joints(self) -> int:
        """Number of joints N."""
    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names in array order."""
    @property
    def limbs(self) -> tuple[tuple[int, int], ...]:
        """Connected joints."""
    @property
    def left_right(self) -> tuple[tuple[int, int], ...]:
        """Mirror images (left, right)."""
    @property
    def occlusion_prone(self) -> tuple[int, ...]:
        """Elbows, wrists and ankles in the built-in layouts."""
    @property
    def root(self) -> tuple[int, ...]:
        """Joints whose mean is the root."""
    def symmetric_pairs(self, tier: int) -> tuple[tuple[tuple[int, int], tuple[int, int]], ...]:
        """Return the pairs ((l1, l2), (r1, r2)) of symmetric limbs up to ``tier``."""
    def __eq__(self, other: object, /) -> bool: ...

@final
class Setting:
    """One setting of ``RefineConfig``, as the core's table has it.

    Attributes
    ----------
    name : str
        The keyword.
    type : str
        What values it takes.
    default : object
        Its default.
    unit : str
        Its unit, empty for none.
    sentence : str
        What it does.
    method : str
        ``"annealed"`` or ``"paper"``, to which it belongs, or ``"both"``.
    """

    @property
    def name(self) -> str: ...
    @property
    def type(self) -> str: ...
    @property
    def default(self) -> Any: ...
    @property
    def unit(self) -> str: ...
    @property
    def sentence(self) -> str: ...
    @property
    def method(self) -> str: ...

@final
class RefineConfig:
    """Settings of ``refine``. Immutable.

    ``RefineConfig(...)`` is the default method, ``annealed``: splats that narrow to the noise of the
    detections, from any start. ``RefineConfig.paper(...)`` is the published one, ``paper``: pixels and Adam.
    Every setting is a keyword, a setting of the other method is refused, and one that is left out keeps its
    default. Lengths are in mm whatever the unit of the cameras, and their names say so.

    Parameters
    ----------
    occlusion_sigma_mm : float or None, mm, default None
        ``sigma_mm`` of occlusion-prone joints (elbows, wrists, ankles); None: the same.
    joint_sigmas_mm : sequence of float, or None, mm, default None
        ``sigma_mm`` of each of the N joints, instead of the two others.
    symmetry_tier : int, default 1
        Symmetric limbs up to this tier are kept equally long, 0 to 3; 0: none.
    symmetry_sigma_mm : float, mm, default 15
        Standard deviation of the difference between symmetric limbs; ``paper`` uses it for the error bars
        alone.
    detection_sigma_px : float or None, px, default None
        Standard deviation of the detections' noise per axis, for ``paper`` in the error bars alone; None:
        estimated in every frame.
    undistort : bool, default True
        Remove lens distortion from the detections first; False mirrors numbers published without it.
    min_confidence : float, default 0
        Detections of a lower confidence count as missing.
    n_threads : int or None, default None
        Threads for a batch, on whose number the result does not depend; None: all cores.
    occlusion_factor : float
        Instead of ``occlusion_sigma_mm``, the paper's f, which multiplies the *logarithm* of ``sigma_mm``:
        σ^f, for ``paper`` 42.5 mm with 1.25, 90 with 1.5 and 403 with 2. It is not kept as a field.

    Other Parameters
    ----------------
    Of ``annealed``; ``RefineConfig(...)`` takes them:

    sigma_mm : float, mm, default 30
        Widest σ at which a joint's kernel ends, unless the noise turns out to be larger.
    max_steps : int, default 50
        Largest number of steps.
    sigma_start_mm : float, mm, default 320
        σ of the widest kernel; a joint whose farthest ray is nearer begins there.
    sigma_decay : float, default 0.5
        Factor on the kernel's σ from one step to the next.
    sigma_per_noise : float or None, default 2
        The kernel ends at this multiple of the detections' noise if that is less than ``sigma_mm``; larger
        noise is followed where it explains the frame better than many wrong detections do. None: it ends at
        ``sigma_mm``.
    view_weights : sequence of float, or None, default None
        How much each of the M views counts, on top of the confidence, 0 to leave it out; None: 1 for all.
    find_swaps : bool, default True
        Look for detections with left and right exchanged.
    step_tolerance : float, default 0.01
        Converged once the kernels are narrow and no joint moves by more than this part of the noise.

    Of ``paper``; ``RefineConfig.paper(...)`` takes them:

    sigma_mm : float, mm, default 20.09
        Initial standard deviation σ₀ of every joint's splat.
    max_steps : int, default 125
        Largest number of steps.
    renderer : {"raster", "closed_form"}, default "raster"
        What compares splats with detections: the paper's pixels, or the exact integral of the same loss over
        the plane (one-hot encoding only).
    dilation : float, px², default 0.3
        h, added to the projected variances.
    encoding : {"one_hot", "rgb", "single"}, default "one_hot"
        Joint encoding; the shared ones are ablations.
    symmetry_weight : float, mm⁻², default 1e-5
        λ_sym, the weight of the symmetry loss.
    views_per_step : int or None, default None
        Views whose gradients are accumulated before a step; None: all.
    position_lr_mm : float or "camera_extent", mm, default 3
        Initial learning rate of the means; "camera_extent": 5e-4 · 1.1 · the largest distance of a camera
        centre from their mean.
    position_lr_factor : float, default 1
        Multiplies ``position_lr_mm``; the paper's dome rigs ran with 10 times the formula.
    log_scale_lr : float, default 0.005
        Learning rate of the log-scales.
    rotation_lr : float, default 0.001
        Learning rate of the quaternions.
    lr_decay : float, default 0.01
        Factor by which the position's learning rate falls over ``lr_decay_steps``.
    lr_decay_steps : float, steps, default 1000
        Steps over which ``lr_decay`` is reached.
    adam_betas : (float, float), default (0.9, 0.999)
        Adam's β₁ and β₂.
    adam_epsilon : float, default 1e-15
        Adam's ε.
    stop_tolerance : float, default 1e-6
        Stop when the window minimum of the loss changes by less.
    stop_window : int or None, default None
        Steps per window; None: the number of views.
    resolution : float, default 1
        Render at this factor of the cameras' resolution.
    loss_history : bool, default False
        Keep the loss of every step.

    Raises
    ------
    InvalidInputError
        An unknown setting, one of the other method, or a value outside its domain; the message names it.
    """

    def __new__(cls, **fields: Any) -> RefineConfig: ...
    @staticmethod
    def paper(**fields: Any) -> RefineConfig:
        """Return the published method, with any setting changed by keyword."""
    def replace(self, **fields: Any) -> RefineConfig:
        """Return a copy with some settings changed."""
    def to_dict(self) -> dict[str, Any]:
        """Return the method and every setting; ``RefineConfig(**fields)`` makes the same again."""
    @staticmethod
    def settings(method: str = "annealed") -> list[Setting]:
        """Return the table of the settings of a method, its own first."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    @property
    def method(self) -> str:
        """Name of the method, ``"annealed"`` or ``"paper"``."""
    @property
    def sigma_mm(self) -> float: ...
    @property
    def max_steps(self) -> int: ...
    @property
    def sigma_start_mm(self) -> float: ...
    @property
    def sigma_decay(self) -> float: ...
    @property
    def sigma_per_noise(self) -> float | None: ...
    @property
    def view_weights(self) -> tuple[float, ...] | None: ...
    @property
    def find_swaps(self) -> bool: ...
    @property
    def step_tolerance(self) -> float: ...
    @property
    def occlusion_sigma_mm(self) -> float | None: ...
    @property
    def joint_sigmas_mm(self) -> tuple[float, ...] | None: ...
    @property
    def symmetry_tier(self) -> int: ...
    @property
    def symmetry_sigma_mm(self) -> float: ...
    @property
    def detection_sigma_px(self) -> float | None: ...
    @property
    def undistort(self) -> bool: ...
    @property
    def min_confidence(self) -> float: ...
    @property
    def n_threads(self) -> int | None: ...
    @property
    def renderer(self) -> str: ...
    @property
    def dilation(self) -> float: ...
    @property
    def encoding(self) -> str: ...
    @property
    def symmetry_weight(self) -> float: ...
    @property
    def views_per_step(self) -> int | None: ...
    @property
    def position_lr_mm(self) -> float | str: ...
    @property
    def position_lr_factor(self) -> float: ...
    @property
    def log_scale_lr(self) -> float: ...
    @property
    def rotation_lr(self) -> float: ...
    @property
    def lr_decay(self) -> float: ...
    @property
    def lr_decay_steps(self) -> float: ...
    @property
    def adam_betas(self) -> list[float]: ...
    @property
    def adam_epsilon(self) -> float: ...
    @property
    def stop_tolerance(self) -> float: ...
    @property
    def stop_window(self) -> int | None: ...
    @property
    def resolution(self) -> float: ...
    @property
    def loss_history(self) -> bool: ...

def project(points: ArrayLike, cameras: _Cameras) -> NDArray[np.float64]:
    """Project world points (…, 3) to pixels (M, …, 2), lens distortion included; NaN behind a camera.

    The view comes first: a sequence (T, N, 3) gives (M, T, N, 2), while ``refine`` takes (T, M, N, 2), so
    write ``project(poses, cameras).swapaxes(0, 1)``.
    """

@overload
def triangulate(
    detections: ArrayLike,
    cameras: _Cameras,
    *,
    method: str = "robust",
    confidence: ArrayLike | None = None,
    return_rejected: Literal[False] = False,
) -> NDArray[np.float64]:
    """Triangulate detections ([T,] M, N, 2|3) to points ([T,] N, 3); NaN with fewer than two views.

    ``"robust"``, the default, starts at the point nearest to all rays of a joint and lets a Welsch kernel
    narrow to the frame's noise, so that wrong detections lose their pull. Where the views that agree in the
    end are no majority, points between two rays are judged by all. A joint is right with up to half of its
    views wrong if those do not agree among themselves, and with all but two wrong if those two agree and
    nothing else does. Two views that disagree cannot be told apart: both are used. Detections with k < ¼ (2.4
    σ from the joint) are rejected.

    ``"dlt"`` is confidence-weighted algebraic triangulation. ``"ransac"`` is the same over the largest set of
    views that agree: of at most 10 pairs of views the one whose point projects within 20 px of most
    detections decides; where no two views agree, all are used. Every method removes lens distortion first.

    Parameters
    ----------
    detections : ([T,] M, N, 2 | 3)
        Pixels and, in a third channel, confidences; NaN or a confidence of 0 where missing.
    cameras : CameraRig or sequence of Camera
        The M cameras; points are in their unit. A plain sequence is in mm. The kernel of ``"robust"`` has a
        width in mm, so that it has to know the unit; the other methods do not look at it.
    method : {"robust", "dlt", "ransac"}
    confidence : ([T,] M, N), optional
        Instead of a third channel.
    return_rejected : bool
        Also return which detections the method left out, ([T,] M, N) bool. ``"dlt"`` rejects none; a missing
        detection is not rejected.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, an unknown method, a confidence outside [0, 1].
    """

@overload
def triangulate(
    detections: ArrayLike,
    cameras: _Cameras,
    *,
    method: str = "robust",
    confidence: ArrayLike | None = None,
    return_rejected: Literal[True],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]: ...
@overload
def triangulate(
    detections: ArrayLike,
    cameras: _Cameras,
    *,
    method: str = "robust",
    confidence: ArrayLike | None = None,
    return_rejected: bool,
) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.bool_]]: ...
def fuse_monocular(poses: ArrayLike, detections: ArrayLike, cameras: _Cameras) -> NDArray[np.float64]:
    """Fuse monocular 3D poses ([T,] V, N, 3) given in the world to one pose ([T,] N, 3).

    X_j = Σ_i w_ij X_ij with w_ij ∝ 1 / (mean reprojection error of X_ij over the views that detect j). A pose
    that is NaN at a joint has no weight there.
    """

def project_gaussians(
    means: ArrayLike, covariances: ArrayLike, cameras: _Cameras
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project Gaussians (N, 3), (N, 3, 3) to means (M, N, 2) and covariances (M, N, 2, 2), ideal pixels.

    Σ² = J W Σ Wᵀ Jᵀ + h·I (paper §3, supplement A); NaN behind a camera.
    """

def render(
    means: ArrayLike, covariances: ArrayLike, camera: Camera, *, encoding: str = "one_hot"
) -> NDArray[np.float32]:
    """Render Gaussians (N, 3), (N, 3, 3) as float32 images.

    (N, H, W) for ``"one_hot"``, (3, H, W) for ``"rgb"``, (1, H, W) for ``"single"``; ideal pixels.
    Images that do not fit into memory raise ``MemoryError``.
    """

def pseudo_ground_truth(
    detections: ArrayLike,
    means: ArrayLike,
    covariances: ArrayLike,
    camera: Camera,
    *,
    encoding: str = "one_hot",
) -> NDArray[np.float32]:
    """Draw the heat maps of detections (N, 2|3), ideal pixels, with the shapes of the given Gaussians.

    Same shape of result as ``render``; the channel of a missing detection is zero.
    """

def loss_and_gradient(
    means: ArrayLike,
    log_scales: ArrayLike,
    quaternions: ArrayLike,
    detections: ArrayLike,
    cameras: _Cameras,
    *,
    layout: str | Layout | None = None,
    config: RefineConfig | None = None,
    target_means: ArrayLike | None = None,
    target_covariances: ArrayLike | None = None,
) -> dict[str, Any]:
    """Fields of ``skelsplat.LossAndGradient``."""

@final
class Refiner:
    """Cameras, layout and settings, prepared once for any number of frames.

    Raises
    ------
    InvalidInputError
        No camera, an unknown layout, settings that do not fit the cameras.
    """

    def __new__(
        cls, cameras: _Cameras, *, layout: str | Layout | None = None, config: RefineConfig | None = None
    ) -> Refiner: ...
    def refine(
        self,
        init_pose: ArrayLike | None,
        detections: ArrayLike,
        *,
        confidence: ArrayLike | None = None,
        init_sigma: ArrayLike | None = None,
        progress: Callable[[int, int], Any] | None = None,
    ) -> dict[str, Any]:
        """Return the fields of ``skelsplat.Refinement``; ``joint_status`` as codes into ``JOINT_STATUS``."""

    def follow(
        self, past: ArrayLike | None, detections: ArrayLike, *, confidence: ArrayLike | None = None
    ) -> tuple[dict[str, Any], NDArray[np.float64]]:
        """Return the fields of the frame after ``past`` (N, 3), and the past of the next one."""

def implausible_extent(
    poses: ArrayLike, cameras: _Cameras, *, layout: str | Layout | None = None
) -> dict[str, Any] | None:
    """Return what a warning quotes if the skeletons (T, N, 3) are taller than 10 m or shorter than 10 cm.

    With a layout of one's own the limits are 20 m and 1 mm.
    """

def check_people(people: ArrayLike) -> None:
    """Refuse a confidence outside [0, 1] in people (T, M, P, K, 3), which the message calls ``people``."""
