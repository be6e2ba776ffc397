"""Attacks 1, 5, 10 and 11: arrays with unusual memory layout, masked arrays, huge poses, pickles."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable

import numpy as np

import skelsplat as sk
from skelsplat import metrics, synthetic

from . import attack

_RIG = synthetic.human36m_like(distortion=True)
_POSES = synthetic.motion("walk", 5, seed=7)
_SEEN = synthetic.simulate_detections(_POSES, _RIG, noise=synthetic.DetectionNoise(), seed=7)
_PIXELS = np.nan_to_num(_SEEN[..., :2], nan=500.0)
_LAYOUT = "h36m17"


def _unaligned(array: np.ndarray) -> np.ndarray:
    return np.frombuffer(b"\0" + np.ascontiguousarray(array).tobytes(), offset=1).reshape(array.shape)


def _tried(call: Callable[[], object]) -> str:
    """Return the result of a call, or its error."""
    try:
        return str(call())
    except BaseException as error:  # a panic of the compiled core is not an Exception
        return f"{type(error).__name__}: {str(error).splitlines()[0][:60]}"


def _statuses(confidence: np.ndarray) -> str:
    found = sk.refine(None, _PIXELS, _RIG, layout=_LAYOUT, confidence=confidence).joint_status
    return f"{(found == 'ok').sum()} / {(found == 'unobserved').sum()}"


def _same(call: Callable[[np.ndarray], object], array: np.ndarray) -> str:
    plain = np.asarray(call(array))
    return _tried(
        lambda: "as plain" if np.array_equal(call(_unaligned(array)), plain, equal_nan=True) else "differs"
    )


@attack("1a", "confidences of 0, unaligned: joints ok / unobserved", "0 / 85")
def unaligned_confidence_of_zero() -> str:
    return _statuses(_unaligned(np.zeros(_PIXELS.shape[:3])))


@attack("1b", "confidences of 7, unaligned", "InvalidInputError")
def unaligned_confidence_of_seven() -> str:
    return _tried(lambda: _statuses(_unaligned(np.full(_PIXELS.shape[:3], 7.0))))


@attack("1c", "unaligned detections", "as plain")
def unaligned_detections() -> str:
    return _same(lambda a: sk.refine(None, a, _RIG, layout=_LAYOUT).pose, _SEEN)


@attack("1d", "unaligned distortion", "as plain")
def unaligned_distortion() -> str:
    camera = _RIG[0]

    def coefficients(lens: np.ndarray) -> object:
        built = sk.Camera(camera.K, camera.R, camera.t, distortion=lens, size=camera.size).distortion
        return np.zeros(0) if built is None else built

    return _same(coefficients, camera.distortion)


@attack("1e", "unaligned K; t; init_sigma", "as plain; as plain; as plain")
def unaligned_camera_and_prior() -> str:
    camera, start = _RIG[0], _POSES[0] + 10.0
    calls: list[tuple[Callable[[np.ndarray], object], np.ndarray]] = [
        (lambda K: sk.Camera(K, camera.R, camera.t, size=camera.size).K, camera.K),
        (lambda t: sk.Camera(camera.K, camera.R, t, size=camera.size).t, camera.t),
        (lambda s: sk.refine(start, _SEEN[0], _RIG, init_sigma=s).pose, np.full(17, 50.0)),
    ]
    return "; ".join(_same(call, array) for call, array in calls)


@attack("1f", "unaligned points to project; undistort; init_pose", "as plain; as plain; as plain")
def unaligned_points() -> str:
    calls: list[tuple[Callable[[np.ndarray], object], np.ndarray]] = [
        (lambda points: sk.project(points, _RIG), _POSES),
        (lambda points: _RIG[0].undistort(points), _PIXELS[0, 0]),
        (lambda pose: sk.refine(pose, _SEEN[0], _RIG).pose, _POSES[0] + 10.0),
    ]
    return "; ".join(_same(call, array) for call, array in calls)


@attack("1g", "complex detections; numbers as text", "InvalidInputError; InvalidInputError")
def no_numbers() -> str:
    warnings.simplefilter("ignore")
    points = _POSES[0]
    forms = (points + 2j, points.astype(str))
    return "; ".join(_tried(lambda p=p: f"accepted {sk.project(p, _RIG).shape}").split(":")[0] for p in forms)


def _masked() -> tuple[np.ndarray, np.ndarray]:
    """Return detections of which 40 % are far off, and their mask."""
    rng = np.random.default_rng(4)
    wild = rng.random(_PIXELS.shape[:3]) < 0.4
    pixels = np.where(wild[..., None], rng.uniform(0, 1000, _PIXELS.shape), _PIXELS)
    return pixels, np.broadcast_to(wild[..., None], pixels.shape)


def _error(detections: object) -> str:
    found = sk.refine(None, detections, _RIG, layout=_LAYOUT)
    status, count = np.unique(found.joint_status, return_counts=True)
    joints = ", ".join(f"{n} {name}" for name, n in zip(status, count, strict=True))
    return f"{metrics.mpjpe(found.pose, _POSES):.0f} mm, {joints}"


@attack("5a", "40 % of the detections masked: mean error", "as 5b")
def masked_detections() -> str:
    pixels, wild = _masked()
    return _error(np.ma.array(pixels, mask=wild))


@attack("5b", "the same 40 % as NaN", "the reference")
def missing_detections() -> str:
    pixels, wild = _masked()
    return _error(np.where(wild, np.nan, pixels))


@attack("5c", "the same as a list of masked arrays", "as 5b")
def list_of_masked_detections() -> str:
    pixels, wild = _masked()
    return _error([np.ma.array(p, mask=w) for p, w in zip(pixels, wild, strict=True)])


@attack("5d", "MPJPE of a pose whose masked joints are 5 m off", "0 mm, 20 % missing")
def masked_predictions() -> str:
    hidden = np.random.default_rng(0).permutation(np.arange(85) % 5 == 0).reshape(5, 17, 1)
    masked = np.ma.array(np.where(hidden, _POSES + 5e3, _POSES), mask=np.broadcast_to(hidden, _POSES.shape))
    missing = metrics.missing_rate(masked, _POSES)
    return f"{metrics.mpjpe(masked, _POSES):.0f} mm, {100 * missing:.0f} % missing"


@attack("5e", "masked integers: pixels 0 under a mask, projected", "NaN where masked")
def masked_integers() -> str:
    points = np.ma.array(np.rint(_POSES[0]).astype(int), mask=False)
    points[3] = np.ma.masked
    return f"NaN at {np.flatnonzero(np.isnan(sk.project(points, _RIG)[0, :, 0])).tolist()}"


@attack("10j", "pa_mpjpe of poses of 1e155", "InvalidInputError", limit_s=20.0)
def aligned_error_of_huge_poses() -> str:
    huge = np.random.default_rng(0).normal(size=(200, 17, 3)) * 1e155
    return _tried(lambda: metrics.pa_mpjpe(huge, huge[::-1]))


def _copies(value: object) -> str:
    """Count the pickle protocols and the ways of copying that preserve the value."""

    def equal(twin: Callable[[], object]) -> bool:
        try:
            return bool(twin() == value)
        except Exception:
            return False

    protocols = range(pickle.HIGHEST_PROTOCOL + 1)
    pickled = sum(equal(lambda p=p: pickle.loads(pickle.dumps(value, p))) for p in protocols)
    copied = sum(equal(lambda make=make: make(value)) for make in (copy.copy, copy.deepcopy))
    return f"{pickled} of {len(protocols)}, {copied} of 2"


@attack("11a", "RefineConfig: pickle protocols, copies", "6 of 6, 2 of 2")
def pickled_config() -> str:
    return _copies(sk.RefineConfig.paper(position_lr_mm="camera_extent"))


@attack("11b", "Layout: pickle protocols, copies", "6 of 6, 2 of 2")
def pickled_layout() -> str:
    return _copies(sk.layouts.COCO17)


@attack("11c", "Camera: pickle protocols, copies", "6 of 6, 2 of 2")
def pickled_camera() -> str:
    return _copies(_RIG[0])


@attack("11d", "CameraRig: pickle protocols, copies", "6 of 6, 2 of 2")
def pickled_rig() -> str:
    return _copies(_RIG)


@attack("11e", "Refiner: pickle protocols after which it continues identically", "6 of 6")
def pickled_refiner() -> str:
    refiner = sk.Refiner(_RIG, layout=_LAYOUT)
    refiner.step(_SEEN[0])
    ways = range(pickle.HIGHEST_PROTOCOL + 1)
    twins = [
        _tried(lambda p=p: pickle.loads(pickle.dumps(refiner, p)).step(_SEEN[1]).pose.tolist()) for p in ways
    ]
    after = str(refiner.step(_SEEN[1]).pose.tolist())
    return f"{sum(twin == after for twin in twins)} of {len(twins)}"


def _refined(frame: np.ndarray, rig: sk.CameraRig, layout: sk.Layout, config: sk.RefineConfig) -> np.ndarray:
    return sk.refine(None, frame, rig, layout=layout, config=config).pose


@attack("11f", "refine in a process pool, layout and settings passed along", "as in one process")
def in_a_process_pool() -> str:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    given = _RIG, sk.layouts.H36M17, sk.RefineConfig(n_threads=1)
    plain = [_refined(frame, *given) for frame in _SEEN]

    def run() -> str:
        with ProcessPoolExecutor(2, mp_context=get_context("fork")) as pool:
            found = [pool.submit(_refined, frame, *given) for frame in _SEEN]
            same = all(np.array_equal(a, b.result(60)) for a, b in zip(plain, found, strict=True))
        return "as in one process" if same else "differs"

    return _tried(run)
