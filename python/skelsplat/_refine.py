"""``refine``, its result, and ``Refiner`` for a live loop. All computation is in the compiled core."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat import _skelsplat
from skelsplat._arrays import numbers, positive
from skelsplat._skelsplat import Camera, Layout, RefineConfig
from skelsplat._words import metric
from skelsplat.cameras import MM_PER_UNIT, CameraRig
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, Remedy, warn

Cameras = CameraRig | Sequence[Camera]
Progress = Callable[[int, int], None]

# Frames spread over a batch whose median size tells whether the unit is plausible.
_PERSON_MM = (500.0, 4000.0)  # in this extent of a skeleton one unit at most puts it
_FRAMES_TO_JUDGE = 16
# Share of joints that a start may outvote before it is doubted.
_MOST_OUTVOTED = 0.2
_STATUS = np.array(_skelsplat.JOINT_STATUS)


@dataclass(frozen=True, slots=True)
class Refinement:
    """What ``refine`` returns. ``…`` is ``(T,)`` for a batch and nothing for one frame.

    Attributes
    ----------
    pose : (…, N, 3) float64
        Refined joints in the unit of the cameras; NaN where nothing is known.
    covariance : (…, N, 3, 3) float64
        Splat covariance Σ, unit²: the kernel at the end for ``annealed``. It is not an error bar.
    uncertainty : (…, N, 3, 3) float64
        Posterior covariance of the position, unit²: the scatter, what another recording of the same pose by
        the same detector would give.
    joint_bias : (…, N) float64
        Standard deviation per axis of the detector's joints from anatomical ones, from
        ``config.joint_bias_mm``, and of what the ``joint_sigma`` of a `CameraRig` adds.
    error_bar : (…, N, 3, 3) float64
        ``uncertainty + joint_bias² I``, unit²: the covariance of the distance from an anatomical joint.
    view_weights : (…, M, N) float64
        k in [0, 1], how much each detection is trusted: 1 at the joint, ¼ at 2.4 σ from it (below
        `REJECTED_WEIGHT`, rejected); NaN without a detection.
    swapped : (…, M, N) bool
        Detections that were used with left and right exchanged.
    noise : (…) float64
        Standard deviation of the trusted detections' noise across the ray, per axis, in the cameras' unit.
    reprojection_error : (…, M, N) float64
        Distance between detection and reprojection, pixels of the original image; NaN without a detection.
    joint_status : (…, N) str
        ``"ok"``; ``"weak"``: fewer than two views agree on the position, or only views too close together to
        tell the depth, or as many agree on another place; ``"inferred"``: bones or frames before determine
        it; ``"unobserved"``: no usable detection, the joint keeps its initial position.
    loss, loss_render, loss_symmetry : (…) float64
        L_opt, L_render and the unweighted L_sym (mm²) of the returned pose over all views. For ``annealed``
        ``loss`` and ``loss_render`` are Σ c (2σ²/ŝ²)(1 − k) over the detections.
    n_iter : (…) int64
    stop_reason : (…) str
        ``"converged"``, ``"max_steps"``, ``"no_observations"`` or ``"diverged"``.
    init_pose : (…, N, 3) float64
    loss_history : (…, steps) float64
        L_opt of every step of ``paper``, NaN after a frame's last; only with ``config.loss_history``.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    uncertainty: NDArray[np.float64]
    view_weights: NDArray[np.float64]
    swapped: NDArray[np.bool_]
    noise: NDArray[np.float64]
    reprojection_error: NDArray[np.float64]
    joint_status: NDArray[np.str_]
    loss: NDArray[np.float64]
    loss_render: NDArray[np.float64]
    loss_symmetry: NDArray[np.float64]
    n_iter: NDArray[np.int64]
    stop_reason: NDArray[np.str_]
    init_pose: NDArray[np.float64]
    loss_history: NDArray[np.float64]
    joint_bias: NDArray[np.float64]

    @property
    def error_bar(self) -> NDArray[np.float64]:
        return self.uncertainty + self.joint_bias[..., None, None] ** 2 * np.eye(3)

    def __repr__(self) -> str:
        status, count = np.unique(self.joint_status, return_counts=True)
        joints = ", ".join(f"{n} {name}" for name, n in zip(status, count, strict=True))
        return f"{type(self).__name__}(pose {self.pose.shape}, joints: {joints})"


@dataclass(frozen=True, slots=True)
class LossAndGradient:
    """L_opt of a skeleton of Gaussians and its gradient.

    ``loss`` = ``render`` + λ_sym · ``symmetry``, with symmetry in mm². ``d_means`` (N, 3) is per unit of the
    cameras, ``d_quaternions`` (N, 4) that in the quaternions (w, x, y, z) as given, before normalisation.
    """

    loss: float
    render: float
    symmetry: float
    d_means: NDArray[np.float64]
    d_log_scales: NDArray[np.float64]
    d_quaternions: NDArray[np.float64]


def refine(
    init_pose: ArrayLike | None,
    detections: ArrayLike,
    cameras: Cameras,
    *,
    layout: str | Layout | None = None,
    confidence: ArrayLike | None = None,
    init_sigma: ArrayLike | None = None,
    config: RefineConfig | None = None,
    progress: bool | Progress = False,
) -> Refinement:
    """Refine one 3D pose, or a batch of frames in parallel (paper §3).

    Parameters
    ----------
    init_pose : (N, 3) or (T, N, 3), or None
        Where to start, in the unit of the cameras. A joint that is NaN, or all of them if None, is
        triangulated from the detections.
    detections : (M, N, 2|3) or (T, M, N, 2|3)
        Pixels, and the confidence in [0, 1] as an optional third channel. NaN or confidence 0: missing; the
        confidence of a pixel that is NaN does not count.
    cameras : CameraRig or sequence of Camera
        M cameras; a plain sequence is in mm.
    layout : str, Layout or None
        Joint layout. None takes any N joints and uses no symmetry.
    confidence : (M, N) or (T, M, N), optional
        Instead of a third channel. ``paper`` uses it only for triangulation and to tell what is missing.
    init_sigma : float, (N,), (N, 3, 3) or (T, N, 3, 3), optional
        Standard deviation per axis, in the cameras' unit, or covariance (unit²) per joint of an ``init_pose``
        that does *not* come from these detections (monocular, the last frame, a body model). It then counts
        as a measurement, and is not robust: many standard deviations off, it outvotes the detections. Without
        it ``init_pose`` only places joints that fewer than two views see. NaN: no prior. ``annealed`` only.
    progress : bool or callable
        True draws a progress bar; a callable is called with (frames done, frames in all).

    Warns
    -----
    UserWarning
        If the skeleton is taller than 10 m or shorter than 22 cm in the stated unit (with a layout that is
        not human, taller than 20 m; without one, shorter than 10 cm before cameras less than 5 cm apart).
    """
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    with reporter(progress) as report:
        out = prepared.refine(
            init_pose, detections, init_sigma=init_sigma, confidence=confidence, progress=report
        )
    result = Refinement(**refinement_fields(out))
    warn_of_size(result.pose, cameras, layout)
    if init_sigma is not None:
        _warn_of_prior(result)
    return result


def warn_of_size(poses: NDArray[np.float64], cameras: Cameras, layout: str | Layout | None) -> None:
    """Warn if the size of the body in poses (…, N, 3) makes no sense in the cameras' unit."""
    some = poses[:: max(1, len(poses) // _FRAMES_TO_JUDGE)] if poses.ndim == 3 else poses[None]
    found = _skelsplat.implausible_extent(some, cameras, layout=layout)
    if found is not None:
        extent, unit = found["extent"], found["unit"]
        size = f"{extent:.6f}" if extent < 0.01 else f"{extent:.2f}"
        beyond = f"{'taller' if found['taller'] else 'shorter'} than {metric(found['limit_mm'])}"
        sentence = f"The skeleton measures {size} {unit} and is {beyond}: is the unit really '{unit}'?"
        fits = [name for name, mm in MM_PER_UNIT.items() if _PERSON_MM[0] <= extent * mm <= _PERSON_MM[1]]
        remedy = tuple(Remedy("unit", name) for name in fits)
        warn(Finding("unit_wrong", numbers=found, remedy=remedy, sentence=sentence))


def refinement_fields(out: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a result with its codes as words."""
    reasons = np.array(out["stop_reason"])
    stop_reason = reasons.reshape(()) if out["pose"].ndim == 2 else reasons
    words = {"joint_status": _STATUS[out["joint_status"]], "stop_reason": stop_reason}
    bias = np.broadcast_to(out["joint_bias"], out["pose"].shape[:-1])  # one for all frames
    return {**out, **words, "joint_bias": bias}


def _warn_of_prior(result: Refinement) -> None:
    """Warn of a start that is trusted more than it deserves: it can outvote all detections."""
    seen = result.joint_status != "unobserved"
    rejected = np.nanmax(result.view_weights, axis=-2, initial=-1.0) < _skelsplat.REJECTED_WEIGHT
    share = float(np.mean(rejected[seen])) if seen.any() else 0.0
    if share > _MOST_OUTVOTED:
        percent = 100 * share
        sentence = f"init_pose with init_sigma contradicts every detection of {percent:.0f} % of the joints: "
        sentence += "is it of another person or frame, or is init_sigma (in the cameras' unit) too small?"
        warn(Finding("start_contradicts", numbers={"percent": percent}, sentence=sentence))


@contextmanager
def reporter(progress: bool | Progress) -> Iterator[Progress | None]:
    """Yield the callable that the core reports to: None, the user's own, or a progress bar."""
    if progress is not True:
        yield progress or None
        return
    from rich.progress import Progress as Bar

    with Bar(transient=True) as bar:
        task = bar.add_task("refining", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def loss_and_gradient(
    means: ArrayLike,
    log_scales: ArrayLike,
    quaternions: ArrayLike,
    detections: ArrayLike,
    cameras: Cameras,
    *,
    layout: str | Layout | None = None,
    config: RefineConfig | None = None,
    target_means: ArrayLike | None = None,
    target_covariances: ArrayLike | None = None,
) -> LossAndGradient:
    """Evaluate L_opt over all views and its gradient, in double precision, for study and tests.

    ``means`` and ``log_scales`` (N, 3) are μ and s = ln σ in the unit of the cameras, ``quaternions`` (N, 4)
    the orientations (w, x, y, z) of any norm above zero; the rest is as in ``refine``, of one frame. The
    Gaussians whose projection shapes the pseudo ground truth, a constant for the gradient, are by default the
    given ones, else ``target_means`` (N, 3) and ``target_covariances`` (N, 3, 3).
    """
    found = _skelsplat.loss_and_gradient(
        means,
        log_scales,
        quaternions,
        detections,
        cameras,
        layout=layout,
        config=config,
        target_means=target_means,
        target_covariances=target_covariances,
    )
    return LossAndGradient(**found)


class Refiner:
    """Refine frame after frame as they arrive: a live loop with any detector.

    ``skelsplat live`` is the same for programs in other languages.

    Parameters
    ----------
    cameras, layout, config
        As in ``refine``, for every frame.
    fps : float, optional
        Frames per second, all of which are given to ``step``: the past then predicts, except where two views
        agree on another position, and limbs keep their lengths. ``annealed`` only.
    lag : int
        With ``fps``: return the pose of the frame that lies this many frames before the last one, solved
        together with the frames around it. The first ``lag`` steps return a pose of NaN; as many steps
        without any detection (NaN) at the end return the last.

    Examples
    --------
    >>> refiner = sk.Refiner(rig, layout="coco17", fps=30)                               # doctest: +SKIP
    >>> for detections in camera_loop():                                                 # doctest: +SKIP
    ...     pose = refiner.step(detections).pose
    """

    def __init__(
        self,
        cameras: Cameras,
        *,
        layout: str | Layout | None = None,
        fps: float | None = None,
        lag: int = 0,
        config: RefineConfig | None = None,
    ) -> None:
        if fps is not None:
            positive("fps", fps)
        if not isinstance(lag, int | np.integer) or lag < 0:
            raise InvalidInputError(f"lag: expected a whole number of at least 0, got {lag!r}")
        if lag and fps is None:
            raise InvalidInputError("lag: expected fps= as well, got none")
        self._cameras, self._layout = cameras, layout
        self._prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
        self._live: _skelsplat.Live | None = None
        if fps is not None:
            self._live = _skelsplat.Live(self._prepared, float(fps), lag=min(int(lag), sys.maxsize))
        self._last: NDArray[np.float64] | None = None
        self._begun = False
        known = Layout.by_name(layout) if isinstance(layout, str) else layout
        self._joints = None if known is None else known.n_joints

    def __copy__(self) -> NoReturn:
        raise TypeError("a Refiner holds the frames before and is not copied: make another one")

    def reset(self) -> None:
        """Forget all frames: the next one is triangulated. With a lag, poses not yet returned are lost."""
        self._last, self._begun = None, False
        if self._live is not None:
            self._live.reset()

    def step(
        self,
        detections: ArrayLike | Sequence[ArrayLike | None],
        confidence: ArrayLike | Sequence[ArrayLike | None] | None = None,
    ) -> Refinement:
        """Refine one frame ``(M, N, 2|3)``; in a list of views, None is a camera without detections.

        The detections of this frame decide wherever two views see a joint, however far the person moved; the
        last pose gives the depth of a joint that one view sees and the place of one that none sees
        (``"weak"`` and ``"unobserved"``). With ``fps`` prediction and bones do, for up to half a second
        (``"inferred"``, or ``"weak"`` where the error bar is wide), and ``init_pose`` is the pose of the
        frame alone; do not leave out frames without detections.
        """
        frame, scores = _whole(detections, confidence, self._joints)
        if self._live is None:
            out, past = self._prepared.follow(self._last, frame, confidence=scores)
        else:
            out, past = self._live.step(frame, confidence=scores), None
        result = Refinement(**refinement_fields(out))
        if not self._begun:
            warn_of_size(result.pose, self._cameras, self._layout)
        self._last, self._joints = past, result.pose.shape[-2]
        self._begun = self._begun or bool(np.isfinite(result.pose).any())
        return result


def _whole(detections: Any, confidence: Any, joints: int | None) -> tuple[Any, Any]:
    """Return detections and confidence of one frame, NaN and 0 for views that are None."""
    if not isinstance(detections, list | tuple) or all(view is not None for view in detections):
        return detections, confidence
    known = [np.shape(numbers(view, "detections")) for view in detections if view is not None]
    if not known and joints is None:
        expected = "detections of a view, which tell how many joints there are (or a layout)"
        raise InvalidInputError(f"detections: expected {expected}, got None for every view")
    shape = known[0] if known else (joints, 2)
    if isinstance(confidence, list | tuple):
        confidence = [np.zeros(shape[:1]) if view is None else view for view in confidence]
    return [np.full(shape, np.nan) if view is None else view for view in detections], confidence
