"""One array in the forms in which users have it, and the calls of the package that take arrays."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat import metrics, synthetic, temporal
from skelsplat.association import choose_person
from skelsplat.evaluation import baselines
from skelsplat.io import PoseData


def unaligned(array):
    """Return the array one byte off the boundary of its type, as of a file with an odd header."""
    return np.frombuffer(b"\0" + array.tobytes(), offset=1, dtype=array.dtype).reshape(array.shape)


def of_packed_records(array):
    kind = np.dtype([("flag", "u1"), ("data", array.dtype, array.shape)])
    records = np.zeros(1, dtype=kind)
    records["data"][0] = array
    return records["data"][0]


def strided(array):
    wide = np.full((*array.shape, 2), -1.0, dtype=array.dtype)
    wide[..., 0] = array
    return wide[..., 0]


def negative(array):
    turned = tuple(slice(None, None, -1) for _ in array.shape)
    return np.ascontiguousarray(array[turned])[turned]


def read_only(array):
    copy = array.copy()
    copy.setflags(write=False)
    return copy


class WithArray:
    """An object of another library that NumPy can read."""

    def __init__(self, array):
        self.array = array

    def __array__(self, dtype=None, copy=None):
        return self.array if dtype is None else self.array.astype(dtype)


FORMS = {
    "unaligned": unaligned,
    "packed records": of_packed_records,
    "strided": strided,
    "negative strides": negative,
    "byte-swapped": lambda a: a.astype(a.dtype.newbyteorder()),
    "read-only": read_only,
    "Fortran order": np.asfortranarray,
    "list": lambda a: a.tolist(),
    "list of arrays": lambda a: list(a) if a.ndim else a,
    "objects": lambda a: a.astype(object),
    "masked array without a mask": np.ma.array,
    "masked array, unaligned": lambda a: np.ma.array(unaligned(a)),
    "__array__": WithArray,
    "memory of another type": lambda a: memoryview(np.ascontiguousarray(a)),
}
"""Forms that change no value."""


def _rest(hidden):
    """Return a number where something is masked that must not be read."""
    return np.where(hidden, 1e6, 0.0)


MASKED = {
    "masked array": lambda a, hidden: np.ma.array(a + _rest(hidden), mask=hidden),
    "masked array, unaligned": lambda a, hidden: np.ma.array(unaligned(a + _rest(hidden)), mask=hidden),
    "masked objects": lambda a, hidden: np.ma.array(a.astype(object), mask=hidden),
    "list of masked arrays": lambda a, hidden: list(np.ma.array(a + _rest(hidden), mask=hidden)),
    "list with None": lambda a, hidden: np.ma.array(a, mask=hidden).tolist(),
    "__array__ that is masked": lambda a, hidden: WithArray(np.ma.array(a + _rest(hidden), mask=hidden)),
}
"""Forms of an array of which some entries are hidden."""

RIG = synthetic.human36m_like(distortion=True)
POSES = synthetic.motion("walk", 8, seed=2)
SEEN = synthetic.simulate_detections(POSES, RIG, noise=synthetic.DetectionNoise(), seed=1)
PIXELS, CONFIDENCE = SEEN[..., :2].copy(), SEEN[..., 2].copy()
N = POSES.shape[1]
SPREAD = np.broadcast_to(np.diag([400.0, 500.0, 600.0]), (N, 3, 3)).copy()
FRAME, START = PIXELS[0], POSES[0] + 20.0
SMALL = RIG[0].scaled(0.1)
MONOCULAR = synthetic.monocular_poses(POSES, RIG, 40.0, seed=3)
LAYOUT = "h36m17"


def _camera(K, R, t, distortion):
    camera = sk.Camera(K, R, t, distortion=distortion, size=RIG[0].size)
    return camera.K, camera.R, camera.t, camera.distortion


def _configured(joint_sigmas_mm, view_weights):
    config = sk.RefineConfig(joint_sigmas_mm=joint_sigmas_mm, view_weights=view_weights)
    return np.array(config.joint_sigmas_mm), np.array(config.view_weights)


def _data(pose, covariance, view_weights):
    facts = (sk.layouts.H36M17.joints, np.arange(len(POSES)), "mm", RIG.names)
    return PoseData(pose, *facts, covariance=covariance, view_weights=view_weights)


def _refined(init_pose, detections, confidence, init_sigma):
    options = {"layout": LAYOUT, "confidence": confidence, "init_sigma": init_sigma}
    return sk.refine(init_pose, detections, RIG, **options)


def _loss(means, log_scales, quaternions, detections):
    return sk.loss_and_gradient(means, log_scales, quaternions, detections, [c.scaled(0.1) for c in RIG])


CALLS: dict[str, tuple[Any, dict[str, np.ndarray]]] = {
    "Camera": (_camera, {name: getattr(RIG[0], name) for name in ("K", "R", "t", "distortion")}),
    "Camera.undistort": (lambda points: RIG[0].undistort(points), {"points": FRAME[0]}),
    "RefineConfig": (_configured, {"joint_sigmas_mm": np.full(N, 25.0), "view_weights": np.ones(4)}),
    "project": (lambda points: sk.project(points, RIG), {"points": POSES}),
    "triangulate": (
        lambda detections, confidence: sk.triangulate(detections, RIG, confidence=confidence),
        {"detections": PIXELS, "confidence": CONFIDENCE},
    ),
    "fuse_monocular": (
        lambda poses, detections: sk.fuse_monocular(poses, detections, RIG),
        {"poses": MONOCULAR, "detections": PIXELS},
    ),
    "refine": (
        _refined,
        {
            "init_pose": START,
            "detections": FRAME,
            "confidence": CONFIDENCE[0],
            "init_sigma": np.full(N, 60.0),
        },
    ),
    "refine with a third channel": (
        lambda detections: sk.refine(None, detections, RIG, layout=LAYOUT),
        {"detections": SEEN[:3]},
    ),
    "refine with covariances": (
        lambda init_sigma: sk.refine(START, FRAME, RIG, init_sigma=init_sigma),
        {"init_sigma": SPREAD},
    ),
    "Refiner.step": (
        lambda detections, confidence: sk.Refiner(RIG, layout=LAYOUT).step(detections, confidence),
        {"detections": FRAME, "confidence": CONFIDENCE[0]},
    ),
    "project_gaussians": (
        lambda means, covariances: sk.project_gaussians(means, covariances, RIG),
        {"means": START, "covariances": SPREAD},
    ),
    "render": (
        lambda means, covariances: sk.render(means, covariances, SMALL),
        {"means": START[:4], "covariances": SPREAD[:4]},
    ),
    "pseudo_ground_truth": (
        lambda detections, means: sk.pseudo_ground_truth(detections, means, SPREAD[:4], SMALL),
        {"detections": FRAME[0, :4] * 0.1, "means": START[:4]},
    ),
    "loss_and_gradient": (
        _loss,
        {
            "means": START,
            "log_scales": np.full((N, 3), 3.0),
            "quaternions": np.tile([1.0, 0.1, 0.2, 0.0], (N, 1)),
            "detections": FRAME * 0.1,
        },
    ),
    **{
        name: (getattr(metrics, name), {"pred": 1.01 * POSES + 30.0, "gt": POSES})
        for name in ("mpjpe", "pa_mpjpe", "missing_rate", "pck", "auc")
    },
    "pcp": (lambda pred, gt: metrics.pcp(pred, gt, [(1, 2), (2, 3)]), {"pred": POSES + 90.0, "gt": POSES}),
    "sigma_coverage": (metrics.sigma_coverage, {"pred": START, "covariance": SPREAD, "gt": POSES[0]}),
    "fill_gaps": (lambda pose: temporal.fill_gaps(pose, 3), {"pose": POSES}),
    "butterworth": (lambda pose: temporal.butterworth(pose, 50.0), {"pose": POSES}),
    "choose_person": (lambda people: choose_person(people, RIG), {"people": SEEN[:3, :, None]}),
    "simulate_detections": (
        lambda points: synthetic.simulate_detections(points, RIG, noise=synthetic.DetectionNoise()),
        {"points": POSES},
    ),
    "monocular_poses": (lambda points: synthetic.monocular_poses(points, RIG, 5.0), {"points": POSES}),
    "in_layout": (lambda points: synthetic.in_layout(points, sk.layouts.COCO17), {"points": POSES}),
    "baselines": (lambda detections: baselines.dlt(detections, RIG), {"detections": SEEN}),
    "PoseData": (
        _data,
        {
            "pose": POSES,
            "covariance": np.broadcast_to(SPREAD, (8, N, 3, 3)).copy(),
            "view_weights": CONFIDENCE,
        },
    ),
}
"""Name → a function of arrays alone, and arrays that it takes."""

ARGUMENTS = [(call, argument) for call, (_, arrays) in CALLS.items() for argument in arrays]


def bits(result: Any) -> Any:
    """Return what tells two results apart, NaN and signs of zero included."""
    if isinstance(result, np.ndarray | np.generic | float):
        array = np.asarray(result)
        return array.shape, array.dtype.str, array.tobytes()
    if dataclasses.is_dataclass(result):
        return [bits(getattr(result, field.name)) for field in dataclasses.fields(result)]
    if isinstance(result, tuple | list):
        return [bits(item) for item in result]
    return result


def outcome(call: str, **changed: Any) -> Any:
    """Return the bits of a call with some arguments replaced, or the words of the error it raises."""
    function, arrays = CALLS[call]
    try:
        return bits(function(**(arrays | changed)))
    except sk.InvalidInputError as error:
        return str(error)
