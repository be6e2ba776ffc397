"""The compiled core. Input and output arrays are C-ordered float64 unless stated otherwise."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat.cameras import CameraRig

__all__ = [
    "HIGHEST_CONFIDENCE",
    "JOINT_STATUS",
    "LAYOUT_NAMES",
    "REJECTED_WEIGHT",
    "Camera",
    "Known",
    "Layout",
    "Live",
    "RefineConfig",
    "Refiner",
    "Setting",
    "Tracker",
    "__version__",
    "adjust_cameras",
    "calibrate_cameras",
    "check_people",
    "checked_detections",
    "frame_evidence",
    "fuse_monocular",
    "implausible_extent",
    "loss_and_gradient",
    "people_identities",
    "people_scores",
    "project",
    "project_gaussians",
    "pseudo_ground_truth",
    "render",
    "rig_equations",
    "sequence_equations",
    "sequence_window_size",
    "sequence_windows",
    "track_people",
    "triangulate",
]

__version__: str
LAYOUT_NAMES: list[str]
JOINT_STATUS: list[str]
HIGHEST_CONFIDENCE: float
"""A confidence between 1 and this one counts as 1."""
REJECTED_WEIGHT: float
"""Detections with a weight (``Refinement.view_weights``) below this are rejected."""

_Cameras = CameraRig | Sequence[Camera]
_Joint = int | str

@final
class Camera:
    """A calibrated camera: pinhole, lens and image size. Immutable.

    World to camera is x_c = R x_w + t with x right, y down, z forward; integer pixel coordinates
    are at pixel centres.

    Parameters
    ----------
    K : (3, 3)
        [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
    R : (3, 3)
        Rotation world to camera. One that is orthonormal to 1e-3 will do: the nearest rotation is
        taken.
    t : (3,)
        Translation world to camera, in the unit of the rig.
    distortion : (4 | 5 | 8 | 12 | 14,), optional
        OpenCV order k1, k2, p1, p2[, k3[, k4, k5, k6[, s1..s4[, tau_x, tau_y]]]]; 4 with
        ``fisheye``.
    fisheye : bool
        Whether the coefficients are the four of OpenCV's fisheye model.
    size : (width, height)
        Image size in pixels.
    name : str, optional

    Raises
    ------
    InvalidInputError
        Wrong shape or number of coefficients, a value that is not finite or outside its range (see
        the page Conventions), or an R that is not a rotation.
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
        """Name of the camera, or None."""
    @property
    def fisheye(self) -> bool:
        """Whether the lens follows OpenCV's fisheye model."""
    @property
    def distortion(self) -> NDArray[np.float64] | None:
        """Distortion coefficients as given."""
    def scaled(self, factor: float) -> Camera:
        """Return the camera for images resized by ``factor``: u' = (u + ½) · factor − ½."""
    def undistort(self, points: ArrayLike) -> NDArray[np.float64]:
        """Map pixels (…, 2) to ideal pixels of the same K; NaN where no ray through the lens arrives."""
    def __eq__(self, other: object, /) -> bool: ...

@final
class Layout:
    """Joint names, limbs and symmetries of a skeleton. Immutable. Joints are indices or names.

    Parameters
    ----------
    name : str
    joints : sequence of str
        The N joint names, in the order of the arrays.
    limbs : sequence of (joint, joint)
    symmetric : sequence of (tier, (l1, l2), (r1, r2))
        Limbs of equal length; tier 1 (lower limbs), 2 (upper limbs) or 3 (trunk).
    left_right : sequence of (left, right)
        Joints that are mirror images.
    occlusion_prone : sequence of joints
        Joints to which ``RefineConfig.occlusion_sigma_mm`` applies.
    root : sequence of joints
        Joints whose mean is the root.
    lengths : sequence of ((joint, joint), length_mm, sigma_mm)
        Known lengths of limbs, in mm, and their standard deviations, which ``bone_lengths_mm`` of
        the configuration replaces.
    angles : sequence of (name, joints, sign, offset)
        Joint angles, ``offset + sign * angle`` in degrees, which `joint_angles` returns as well, or
        instead of those with the same name. Three joints a, b, c: the angle between a→b and b→c,
        0 to 180; four: that between a→b and c→d.
    human : bool
        This is a person's body, whose joints are named as in the built-in layouts: bones with known
        ends have the proportions of the population, and joints the usual errors of detectors.

    Raises
    ------
    InvalidInputError
        An unknown joint name or index, a joint paired with itself, a limb twice, a tier
        other than 1, 2, 3, a length that is not positive or of no limb, or an angle of other than
        three or four joints.
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
        lengths: Sequence[tuple[Sequence[_Joint], float, float]] | None = None,
        angles: Sequence[tuple[str, Sequence[_Joint], float, float]] | None = None,
        human: bool = False,
    ) -> Layout: ...
    @staticmethod
    def by_name(name: str) -> Layout:
        """Return the built-in layout with this name, or read the layout file at this path."""
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
        """Pairs of connected joints."""
    @property
    def symmetric(self) -> tuple[tuple[int, tuple[int, int], tuple[int, int]], ...]:
        """Triples (tier, (l1, l2), (r1, r2)) of limbs of equal length."""
    @property
    def left_right(self) -> tuple[tuple[int, int], ...]:
        """Pairs (left, right) of joints that are mirror images."""
    @property
    def occlusion_prone(self) -> tuple[int, ...]:
        """Joints prone to occlusion: elbows, wrists and ankles in the built-in layouts."""
    @property
    def root(self) -> tuple[int, ...]:
        """Joints whose mean is the root."""
    @property
    def lengths(self) -> tuple[tuple[tuple[int, int], float, float], ...]:
        """Triples ((joint, joint), length in mm, sigma in mm) of the limbs whose length is known."""
    @property
    def proportions(self) -> tuple[tuple[tuple[int, int], float, float], ...]:
        """Triples ((joint, joint), length over stature, relative sigma) of limbs that people have."""
    @property
    def angles(self) -> tuple[tuple[str, tuple[int, ...], float, float], ...]:
        """Quadruples (name, joints, sign, offset in degrees) of the layout's own joint angles."""
    @property
    def human(self) -> bool:
        """Whether this is a person's body, with the population's bones and usual errors of detectors."""
    def symmetric_pairs(self, tier: int) -> tuple[tuple[tuple[int, int], tuple[int, int]], ...]:
        """Return the pairs ((l1, l2), (r1, r2)) of symmetric limbs up to ``tier``."""
    def __eq__(self, other: object, /) -> bool: ...

@final
class Setting:
    """One setting of ``RefineConfig``.

    Attributes
    ----------
    name : str
        Keyword.
    type : str
        Accepted values.
    default : object
        Default value.
    unit : str
        Unit, empty for none.
    sentence : str
        Description.
    method : str
        Method it belongs to: ``"annealed"``, ``"paper"`` or ``"both"``.
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

    ``RefineConfig(...)`` configures the default method, ``annealed``: splats that narrow to the noise
    of the detections, from any initial pose. ``RefineConfig.paper(...)`` configures the published
    method, ``paper``: rendered pixels and Adam. Every setting is a keyword; settings of the other
    method are rejected, and settings not given keep their defaults. Lengths are in mm whatever the unit
    of the cameras; their names end in ``_mm``.

    Parameters
    ----------
    occlusion_sigma_mm : float or None, mm, default None
        ``sigma_mm`` of occlusion-prone joints (elbows, wrists, ankles); None: same as ``sigma_mm``.
    joint_sigmas_mm : sequence of float, or None, mm, default None
        ``sigma_mm`` per joint, N values; replaces ``sigma_mm`` and ``occlusion_sigma_mm``.
    symmetry_tier : int, default 1
        Tier up to which symmetric limbs are kept equal in length: 0 off, 1 lower limbs, 2 also upper limbs, 3
        also the trunk.
    symmetry_sigma_mm : float, mm, default 15
        Standard deviation of the length difference between symmetric limbs; ``paper`` uses it only for error
        bars.
    detection_sigma_px : float or None, px, default None
        Standard deviation of the detection noise per axis; ``paper`` uses it only for error bars; None:
        estimated in every frame.
    joint_bias_mm : float or sequence of float, or None, mm, default None
        Standard deviation per axis of the detector's joints from anatomical ones, the same in all views and
        frames, for all joints or N values; part of the error bar, not of the scatter; None: figures from
        motion capture for human layouts, 0 for others.
    undistort : bool, default True
        Remove lens distortion from the detections first; False reproduces results published without
        undistortion.
    min_confidence : float, default 0
        Detections with a lower confidence are treated as missing.
    n_threads : int or None, default None
        Number of threads that share the frames; does not affect the result; None: all cores.
    occlusion_factor : float
        The paper's f, an alternative to ``occlusion_sigma_mm``: multiplies the *logarithm* of ``sigma_mm``,
        giving σ^f; for ``paper`` 42.5 mm with 1.25, 90 mm with 1.5 and 403 mm with 2. Converted, not stored.

    Other Parameters
    ----------------
    For annealed, accepted by RefineConfig(...):

    sigma_mm : float, mm, default 30
        Largest final σ of a joint's kernel, unless the noise turns out to be larger.
    max_steps : int, default 50
        Maximum number of steps.
    sigma_start_mm : float, mm, default 320
        Initial σ of the kernels; a joint with all rays nearer than this starts at the distance of its
        farthest ray.
    sigma_decay : float, default 0.5
        Factor applied to the kernel's σ at each step.
    sigma_per_noise : float or None, default 2
        Final σ of the kernel as a multiple of the detection noise, if that is less than ``sigma_mm``; it
        exceeds ``sigma_mm`` only where large noise explains the frame better than many wrong detections.
        None: always ``sigma_mm``.
    view_weights : sequence of float, or None, default None
        Weight of each of the M views, multiplied by the confidence; 0 ignores a view; None: 1 for all.
    find_swaps : bool, default True
        Find and correct detections with left and right swapped.
    bones : {"population", "free"}, default "population"
        Lengths of bones for joints on which neither three views agree nor all that see them: ``population``,
        with the proportions of people (human layouts only) and a stature found in the frame, or ``free``,
        none.
    bone_lengths_mm : sequence of float, or None, mm, default None
        Known length of each of the layout's limbs, for any layout; replaces the population's. None: not
        known.
    bone_sigmas_mm : sequence of float, or None, mm, default None
        Standard deviation of each of these lengths; one that is not less than the length marks it as unknown.
        None: 20 for all.
    step_tolerance : float, default 0.01
        Converged when the kernels have reached their final width and no joint moves by more than this
        fraction of its standard deviation.

    For paper, accepted by RefineConfig.paper(...):

    sigma_mm : float, mm, default 20.09
        Initial standard deviation σ₀ of every joint's splat.
    max_steps : int, default 125
        Maximum number of steps.
    renderer : {"raster", "closed_form"}, default "raster"
        How splats are compared with detections: ``raster`` on pixels, as in the paper, or ``closed_form``
        with the exact integral of the same loss over the plane (one-hot encoding only).
    dilation : float, px², default 0.3
        h, added to the projected variances.
    encoding : {"one_hot", "rgb", "single"}, default "one_hot"
        Joint encoding; ``rgb`` and ``single``, which share channels among joints, are for ablations.
    symmetry_weight : float, mm⁻², default 1e-5
        λ_sym, the weight of the symmetry loss.
    views_per_step : int or None, default None
        Number of views accumulated into the gradient of a step; None: all.
    position_lr_mm : float or "camera_extent", mm, default 3
        Initial learning rate of the means; "camera_extent": 5e-4 · 1.1 · the largest distance of a camera
        centre from their mean.
    position_lr_factor : float, default 1
        Factor on ``position_lr_mm``; for its dome rigs the paper used 10 times the formula.
    log_scale_lr : float, default 0.005
        Learning rate of the log-scales.
    rotation_lr : float, default 0.001
        Learning rate of the quaternions.
    lr_decay : float, default 0.01
        Factor applied to the position learning rate over ``lr_decay_steps``.
    lr_decay_steps : float, steps, default 1000
        Number of steps after which the position learning rate has been multiplied by ``lr_decay``.
    adam_betas : (float, float), default (0.9, 0.999)
        Adam's β₁ and β₂.
    adam_epsilon : float, default 1e-15
        Adam's ε.
    stop_tolerance : float, default 1e-6
        Stop when the minimum loss of a window changes by less than this.
    stop_window : int or None, default None
        Steps per window of the stopping rule; None: the number of views.
    resolution : float, default 1
        Rendering resolution relative to that of the cameras.
    loss_history : bool, default False
        Record the loss of every step.

    Raises
    ------
    InvalidInputError
        An unknown setting, one of the other method, or a value outside its domain; the message names
        it.
    """

    def __new__(cls, **fields: Any) -> RefineConfig: ...
    @staticmethod
    def paper(**fields: Any) -> RefineConfig:
        """Return a configuration of the published method, ``paper``; keywords change its settings."""
    def replace(self, **fields: Any) -> RefineConfig:
        """Return a copy with the given settings changed."""
    def to_dict(self) -> dict[str, Any]:
        """Return the method and every setting; ``RefineConfig(**fields)`` recreates the configuration."""
    @staticmethod
    def settings(method: str = "annealed") -> list[Setting]:
        """Return the settings of a method, those specific to it first."""
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
    def bones(self) -> str: ...
    @property
    def bone_lengths_mm(self) -> tuple[float, ...] | None: ...
    @property
    def bone_sigmas_mm(self) -> tuple[float, ...] | None: ...
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
    def joint_bias_mm(self) -> float | tuple[float, ...] | None: ...
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

    The view axis comes first: a sequence (T, N, 3) gives (M, T, N, 2), while ``refine`` takes (T,
    M, N, 2); ``project(poses, cameras).swapaxes(0, 1)`` converts.
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

    ``"robust"``, the default, starts at the point nearest to all rays of a joint and narrows a
    Welsch kernel to the frame's noise, so that wrong detections lose their influence. If the views
    that agree at the end are not a majority, the points between pairs of rays are also tried, each
    scored by all views. A joint is recovered with up to half of its views wrong if the wrong ones
    do not agree with each other, and with all but two wrong if only those two agree. If only two
    views see a joint and they disagree, both are used. Detections with a weight k < ¼ (more than
    2.4 σ from the joint) are rejected.

    ``"dlt"`` is confidence-weighted algebraic triangulation. ``"ransac"`` applies it to the largest
    set of views that agree: of at most 10 pairs of views, the pair with most detections within 20
    px of its projected point defines the set; if no two views agree, all are used. Every method
    removes lens distortion first.

    Parameters
    ----------
    detections : ([T,] M, N, 2 | 3)
        Pixels and, in a third channel, confidences; NaN or a confidence of 0 where missing.
    cameras : CameraRig or sequence of Camera
        The M cameras; points are in their unit. A plain sequence is in mm. The unit matters only
        for ``"robust"``, which has a kernel width in mm.
    method : {"robust", "dlt", "ransac"}
    confidence : ([T,] M, N), optional
        Confidences, if detections have no third channel.
    return_rejected : bool
        Also return which detections were rejected, ([T,] M, N) bool. ``"dlt"`` rejects none;
        missing detections do not count as rejected.

    Raises
    ------
    InvalidInputError
        Shapes that do not match, an unknown method, or a confidence outside [0, 1].
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
    """Fuse monocular 3D poses ([T,] V, N, 3) in world coordinates into one pose ([T,] N, 3).

    X_j = Σ_i w_ij X_ij with w_ij ∝ 1 / (mean reprojection error of X_ij over the views that detect
    j). A pose that is NaN at a joint is ignored there.
    """

def project_gaussians(
    means: ArrayLike, covariances: ArrayLike, cameras: _Cameras
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project Gaussians (N, 3), (N, 3, 3) to ideal pixels: means (M, N, 2), covariances (M, N, 2, 2).

    Σ² = J W Σ Wᵀ Jᵀ + h·I (paper §3, supplement A); NaN behind a camera.
    """

def render(
    means: ArrayLike, covariances: ArrayLike, camera: Camera, *, encoding: str = "one_hot"
) -> NDArray[np.float32]:
    """Render Gaussians (N, 3), (N, 3, 3) as float32 images.

    (N, H, W) for ``"one_hot"``, (3, H, W) for ``"rgb"``, (1, H, W) for ``"single"``; ideal pixels.
    Raises ``MemoryError`` if the images do not fit into memory.
    """

def pseudo_ground_truth(
    detections: ArrayLike,
    means: ArrayLike,
    covariances: ArrayLike,
    camera: Camera,
    *,
    encoding: str = "one_hot",
) -> NDArray[np.float32]:
    """Render heat maps of detections (N, 2|3), ideal pixels, with the shapes of the given Gaussians.

    The result has the same shape as that of ``render``; the channel of a missing detection is zero.
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
) -> dict[str, Any]: ...
def frame_evidence(
    pose: ArrayLike,
    detections: ArrayLike,
    cameras: _Cameras,
    *,
    noise: float,
    widest: float,
    bones: Sequence[tuple[int, int, float, float]],
) -> tuple[float, float, list[float] | None]: ...
def sequence_equations(
    poses: ArrayLike,
    detections: ArrayLike,
    cameras: _Cameras,
    *,
    fps: float,
    lengths: Sequence[Sequence[float]],
    joints: Sequence[Sequence[float]],
    layout: str | Layout | None = None,
    config: RefineConfig | None = None,
) -> list[NDArray[np.float64]]: ...

@final
class Refiner:
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
    ) -> dict[str, Any]: ...
    def refine_sequence(
        self,
        init_pose: ArrayLike | None,
        detections: ArrayLike,
        fps: float,
        *,
        confidence: ArrayLike | None = None,
        progress: Callable[[int, int], Any] | None = None,
    ) -> dict[str, Any]: ...
    def learn_sequence(
        self, init_pose: ArrayLike | None, detections: ArrayLike, fps: float, stretches: Sequence[int]
    ) -> Known: ...
    def refine_windows(
        self,
        init_pose: ArrayLike | None,
        detections: ArrayLike,
        known: Known,
        windows: Sequence[Sequence[int]],
        *,
        progress: Callable[[int, int], Any] | None = None,
    ) -> dict[str, Any]: ...
    def follow(
        self, past: ArrayLike | None, detections: ArrayLike, *, confidence: ArrayLike | None = None
    ) -> tuple[dict[str, Any], NDArray[np.float64]]: ...

@final
class Known: ...

@final
class Live:
    def __new__(cls, refiner: Refiner, fps: float, *, lag: int = 0) -> Live: ...
    def step(self, detections: ArrayLike, *, confidence: ArrayLike | None = None) -> dict[str, Any]: ...
    def reset(self) -> None: ...

@final
class Tracker:
    def __new__(
        cls, refiner: Refiner, layout: str | Layout, fps: float, *, max_people: int | None = None
    ) -> Tracker: ...
    def step(self, people: ArrayLike) -> list[dict[str, Any]]: ...
    def reset(self) -> None: ...
    def ids(self) -> list[int]: ...
    def cut(self) -> int: ...
    def copy(self) -> Tracker: ...

def people_identities(
    refiner: Refiner, layout: str | Layout | None, people: ArrayLike, fps: float
) -> tuple[list[tuple[int, NDArray[np.int64]]], NDArray[np.bool_]]: ...
def people_scores(
    refiner: Refiner, layout: str | Layout, people: ArrayLike, pose: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]: ...
def track_people(
    refiner: Refiner,
    layout: str | Layout,
    people: ArrayLike,
    fps: float,
    *,
    max_people: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> tuple[list[dict[str, Any]], int, NDArray[np.int64], NDArray[np.int64]]: ...
def rig_equations(
    points: ArrayLike, detections: ArrayLike, cameras: _Cameras, *, clocks: Sequence[float], sigma: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]: ...
def adjust_cameras(
    detections: ArrayLike,
    cameras: _Cameras,
    *,
    times: ArrayLike | None = None,
    confidence: ArrayLike | None = None,
    free: Sequence[int] | None = None,
    focal: bool = False,
    clock: bool = False,
    config: RefineConfig | None = None,
) -> tuple[list[Camera], dict[str, Any]]: ...
def calibrate_cameras(
    detections: ArrayLike,
    cameras: _Cameras,
    clocks: Sequence[float | None],
    layout: Layout,
    times: ArrayLike,
    *,
    focal: bool = False,
    same_focal: bool = False,
    clock: bool = False,
    config: RefineConfig | None = None,
) -> tuple[list[Camera], dict[str, Any]]: ...
def sequence_windows(n_frames: int, fps: float) -> tuple[list[list[int]], list[list[int]]]: ...
def sequence_window_size(fps: float) -> list[int]: ...
def checked_detections(
    detections: ArrayLike, confidence: ArrayLike | None, n_views: int
) -> NDArray[np.float64]: ...
def implausible_extent(
    poses: ArrayLike, cameras: _Cameras, *, layout: str | Layout | None = None
) -> dict[str, Any] | None: ...
def check_people(people: ArrayLike) -> None: ...
