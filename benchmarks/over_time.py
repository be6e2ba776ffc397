"""Methods that solve a recording: a take in, poses and, where there are any, error bars out."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from recordings import Take
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import temporal

# Cutoff of the Butterworth filter; below half of low frame rates by the share that follows.
CUTOFF_HZ = 6.0
_OF_NYQUIST = 0.8
# Longest gap that is filled before filtering.
_GAP_S = 0.5
# Spectral density of the white acceleration of the Kalman smoother, mm²/s³, by the class of a joint: the
# lowest geometric mean of the errors in the four conditions at 30 Hz of 1e5, 3e5, 1e6, …, 1e8.
KALMAN_DENSITY = {"ends": 1e6, "middle": 1e6, "trunk": 3e5}
# What the name of a joint of the class contains; the first class that fits counts.
_CLASSES = {"ends": ("wrist", "ankle"), "middle": ("elbow", "knee"), "trunk": ("",)}
# Standard deviation of an unknown velocity, mm/s.
_ANY_SPEED = 3000.0


@dataclass(frozen=True)
class Solved:
    """Poses (T, N, 3), and the covariance of their errors (T, N, 3, 3) where the method states one."""

    pose: FloatArray
    covariance: FloatArray | None = None


Method = Callable[[Take], Solved]


def joint_classes(layout: str) -> dict[str, list[int]]:
    """Return the joints of each class: ends and middles of the limbs, and the rest."""
    classes: dict[str, list[int]] = {name: [] for name in _CLASSES}
    for j, joint in enumerate(sk.layouts.get(layout).joints):
        name = next(name for name, parts in _CLASSES.items() if any(part in joint for part in parts))
        classes[name].append(j)
    return classes


def frames(take: Take, *, bones: str = "population") -> Solved:
    """`sk.refine`, every frame by itself."""
    scene = take.scene
    config = sk.RefineConfig(n_threads=1, bones=bones)
    result = sk.refine(None, scene.detections, scene.rig, layout=scene.layout, config=config)
    return Solved(result.pose, result.uncertainty)


def sequence(take: Take) -> Solved:
    """`sk.refine_sequence`: bones and motion in the same solve."""
    scene = take.scene
    config = sk.RefineConfig(n_threads=1)
    result = sk.refine_sequence(scene.detections, scene.rig, fps=take.fps, layout=scene.layout, config=config)
    return Solved(result.pose, result.uncertainty)


def refiner(take: Take, *, fps: bool = False, lag: int = 0) -> Solved:
    """`sk.Refiner`; with `fps` the past predicts, with a lag the frames after count as well."""
    scene = take.scene
    config = sk.RefineConfig(n_threads=1)
    live = sk.Refiner(scene.rig, layout=scene.layout, fps=take.fps if fps else None, lag=lag, config=config)
    end = np.full((lag, *scene.detections.shape[1:]), np.nan)
    results = [live.step(frame) for frame in np.concatenate([scene.detections, end])][lag:]
    return Solved(np.array([r.pose for r in results]), np.array([r.uncertainty for r in results]))


def butterworth(take: Take, *, bones: str = "population") -> Solved:
    """Frame by frame, gaps filled linearly, then a zero-lag Butterworth filter of 6 Hz."""
    pose = frames(take, bones=bones).pose
    filled, _ = temporal.fill_gaps(pose, max(1, round(_GAP_S * take.fps)), method="linear")
    return Solved(temporal.butterworth(filled, take.fps, cutoff(take.fps))[0])


def cutoff(fps: float) -> float:
    """Return the filter's cutoff, Hz: 6, or less if that is too close to half the frame rate."""
    return min(CUTOFF_HZ, _OF_NYQUIST * fps / 2.0)


def kalman(take: Take) -> Solved:
    """Frame by frame, then `smoothed` with its error bars as the covariance of the measurements."""
    result = frames(take)
    assert result.covariance is not None
    density = np.empty(result.pose.shape[1])
    for name, joints in joint_classes(take.scene.layout).items():
        density[joints] = KALMAN_DENSITY[name]
    return smoothed(result.pose, result.covariance, take.fps, density)


def smoothed(pose: FloatArray, covariance: FloatArray, fps: float, density: FloatArray) -> Solved:
    """Run a Kalman filter and the Rauch-Tung-Striebel smoother over every joint by itself.

    The velocity is constant but for white acceleration. A position that is not finite, or has no finite
    covariance, is no measurement.

    Parameters
    ----------
    pose : (T, N, 3) mm
    covariance : (T, N, 3, 3) mm²
    fps : float
    density : (N,) mm²/s³
        Spectral density of the acceleration.
    """
    n_frames, n_joints = pose.shape[:2]
    dt, one, zero = 1.0 / fps, np.eye(3), np.zeros((3, 3))
    step = np.block([[one, dt * one], [zero, one]])
    process = density[:, None, None] * np.block(
        [[dt**3 / 3 * one, dt**2 / 2 * one], [dt**2 / 2 * one, dt * one]]
    )
    finite: NDArray[np.bool_] = np.isfinite(pose).all(axis=-1)
    known = finite & np.isfinite(covariance).all(axis=(-2, -1))
    state = np.zeros((n_joints, 6))
    state[:, :3] = _first_known(pose, known)
    spread = np.broadcast_to(np.diag([1e8] * 3 + [_ANY_SPEED**2] * 3), (n_joints, 6, 6)).copy()
    states = np.empty((n_frames, n_joints, 6))
    spreads = np.empty((n_frames, n_joints, 6, 6))
    predicted, predicted_spreads = np.empty_like(states), np.empty_like(spreads)
    for t in range(n_frames):
        if t > 0:
            state = state @ step.T
            spread = step @ spread @ step.T + process
        predicted[t], predicted_spreads[t] = state, spread
        states[t], spreads[t] = state, spread
        k = np.flatnonzero(known[t])
        gain = np.linalg.solve(spread[k, :3, :3] + covariance[t, k], spread[k, :3]).swapaxes(-1, -2)
        states[t, k] += np.einsum("nij,nj->ni", gain, pose[t, k] - state[k, :3])
        spreads[t, k] = _remaining(gain, np.eye(3, 6), spread[k], covariance[t, k])
        state, spread = states[t], spreads[t]
    for t in range(n_frames - 2, -1, -1):
        gain = np.linalg.solve(predicted_spreads[t + 1], step @ spreads[t]).swapaxes(-1, -2)
        states[t] += np.einsum("nij,nj->ni", gain, states[t + 1] - predicted[t + 1])
        spreads[t] = _remaining(gain, step, spreads[t], process + spreads[t + 1])
    never = ~known.any(axis=0)
    states[:, never], spreads[:, never] = np.nan, np.nan
    return Solved(states[..., :3], spreads[..., :3, :3])


def _remaining(gain: FloatArray, seen: FloatArray, spread: FloatArray, noise: FloatArray) -> FloatArray:
    """Return (1 − G H) P (1 − G H)ᵀ + G R Gᵀ, Joseph's form: symmetric and positive whatever the rounding."""
    kept = np.eye(spread.shape[-1]) - gain @ seen
    out: FloatArray = kept @ spread @ kept.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)
    return (out + out.swapaxes(-1, -2)) / 2.0


def _first_known(pose: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Return the first known position (N, 3) of every joint; zeros where there is none."""
    first = pose[known.argmax(axis=0), np.arange(pose.shape[1])]
    return np.where(known.any(axis=0)[:, None], first, 0.0)


def anipose(take: Take, *, ransac: bool = False) -> Solved:
    """Aniposelib's `CameraGroup.triangulate_optim`, all bones of the layout constrained.

    Its defaults but for `n_deriv_smooth` and `reproj_error_threshold`, which are the best here of 1, 2, 3 and
    2, 5, 15 px from DLT. From its RANSAC it is far better where views are occluded, and ten times slower.
    """
    import cv2
    from aniposelib.cameras import Camera, CameraGroup

    scene = take.scene
    group = CameraGroup(
        [Camera(matrix=c.K, rvec=cv2.Rodrigues(c.R)[0].ravel(), tvec=c.t, size=c.size) for c in scene.rig]
    )
    points = np.ascontiguousarray(np.moveaxis(scene.detections[..., :2], 1, 0))
    limbs = [list(limb) for limb in sk.layouts.get(scene.layout).limbs]
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Numba, about what it cannot compile
        pose = group.triangulate_optim(
            points, init_ransac=ransac, constraints=limbs, n_deriv_smooth=2, reproj_error_threshold=5
        )
    return Solved(np.asarray(pose))


METHODS: dict[str, Method] = {
    "free": partial(frames, bones="free"),
    "free-butterworth": partial(butterworth, bones="free"),
    "frames": frames,
    "refiner": refiner,
    "live": partial(refiner, fps=True),
    "lag5": partial(refiner, fps=True, lag=5),
    "lag15": partial(refiner, fps=True, lag=15),
    "butterworth": butterworth,
    "kalman": kalman,
    "anipose": anipose,
    "anipose-ransac": partial(anipose, ransac=True),
    "sequence": sequence,
}


def absent(name: str) -> str | None:
    """Return why a method is not available here, or None."""
    if name == "sequence" and not hasattr(sk, "refine_sequence"):
        return "this version of skelsplat has no refine_sequence"
    if name.startswith("anipose"):
        try:
            import aniposelib  # noqa: F401
        except ImportError as error:
            return f"{error}; install with pip install aniposelib"
    return None
