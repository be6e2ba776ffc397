"""From one valid call, one thing broken at a time, or too large to compute with: the error names it."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic

K = np.array([[1000.0, 0, 500], [0, 1000, 400], [0, 0, 1]])
EYE, ZERO, SIZE = np.eye(3), np.zeros(3), (1000, 800)


def changed(matrix, index, value):
    out = np.array(matrix, dtype=float)
    out[index] = value
    return out


def refused(call, argument):
    with pytest.raises(sk.InvalidInputError) as caught:
        call()
    assert isinstance(caught.value, ValueError)
    assert caught.value.argument == argument
    assert str(caught.value) == f"{argument}: {caught.value.reason}"


CAMERA = {
    "NaN": {"K": changed(K, (0, 0), np.nan)},
    "shape": {"K": np.eye(4)},
    "reflection": {"R": np.diag([1.0, 1, -1])},
    "translation": {"t": np.zeros(4)},
    "text": {"t": ["a", "b", "c"]},
    "size": {"size": (0, 800)},
    "size type": {"size": "large"},
    "distortion": {"distortion": [0.1] * 6},
    "fisheye": {"distortion": [0.1] * 5, "fisheye": True},
    "name": {"name": 7},
}


@pytest.mark.parametrize("case", CAMERA)
def test_camera(case):
    arguments = {"K": K, "R": EYE, "t": ZERO, "size": SIZE} | CAMERA[case]
    refused(lambda: sk.Camera(**arguments), next(iter(CAMERA[case])))


def test_a_named_camera_is_named_in_the_message():
    with pytest.raises(sk.InvalidInputError, match="'cam_07'"):
        sk.Camera(changed(K, (0, 0), -1.0), EYE, ZERO, size=SIZE, name="cam_07")


def test_rig():
    camera = sk.Camera(K, EYE, ZERO, size=SIZE, name="a")
    refused(lambda: sk.CameraRig([]), "cameras")
    refused(lambda: sk.CameraRig([camera, 3]), "cameras[1]")
    refused(lambda: sk.CameraRig([camera, camera]), "cameras")
    refused(lambda: sk.CameraRig([camera], unit="inch"), "unit")
    refused(lambda: camera.scaled("2"), "factor")
    with pytest.raises(KeyError):
        sk.CameraRig([camera])["b"]


def crooked(place, value):
    """Return covariances of joints, one of which is none."""
    return changed(np.tile(np.eye(3), (17, 1, 1)), place, value)


REFINE = {
    "shape": (lambda s: {"detections": s.detections[0, 0, :, 0]}, "detections"),
    "several people": (lambda s: {"detections": s.detections[:, :, None]}, "detections"),
    "no joints": (lambda _: {"detections": np.zeros((4, 0, 2)), "init_pose": None}, "detections"),
    "views": (lambda s: {"detections": s.detections[0, :3]}, "detections"),
    "joints at (0, 0)": (
        lambda s: {"detections": changed(s.detections[0], (1, [2, 5]), 0.0)},
        "detections[1, 5]",
    ),
    "init_pose": (lambda s: {"init_pose": s.pose[0, :16]}, "init_pose"),
    "init_pose of a batch": (lambda s: {"detections": s.detections}, "init_pose"),
    "confidence": (lambda _: {"confidence": np.ones((4, 16))}, "confidence"),
    "confidence above 1": (lambda _: {"confidence": np.full((4, 17), 1.2)}, "confidence[0, 0]"),
    "unknown layout": (lambda _: {"layout": "h36m18"}, "layout"),
    "layout of another N": (lambda _: {"layout": "body25"}, "detections"),
    "layout type": (lambda _: {"layout": 17}, "layout"),
    "a camera's type": (lambda s: {"cameras": [*list(s.rig)[:3], {"K": 1}]}, "cameras[3]"),
    "one camera": (lambda s: {"cameras": s.rig[0]}, "cameras"),
    "cameras' type": (lambda _: {"cameras": 4}, "cameras"),
    "sigma of zero": (lambda _: {"init_sigma": 0.0}, "init_sigma"),
    "negative": (lambda _: {"init_sigma": changed(np.full(17, 30.0), 4, -1.0)}, "init_sigma[4]"),
    "endless": (lambda _: {"init_sigma": np.inf}, "init_sigma"),
    "sigma's shape": (lambda _: {"init_sigma": np.full(16, 30.0)}, "init_sigma"),
    "no covariance": (lambda _: {"init_sigma": crooked((2, 0, 0), -1.0)}, "init_sigma[2]"),
    "crooked": (lambda _: {"init_sigma": crooked((2, 0, 1), 0.5)}, "init_sigma[2]"),
    "no pose": (lambda _: {"init_pose": None, "init_sigma": 30.0}, "init_sigma"),
    "paper": (lambda _: {"init_sigma": 30.0, "config": sk.RefineConfig.paper()}, "init_sigma"),
    "weights": (lambda _: {"config": sk.RefineConfig(view_weights=[1.0, 1.0])}, "config.view_weights"),
    "sigmas": (lambda _: {"config": sk.RefineConfig(joint_sigmas_mm=[30.0] * 16)}, "config.joint_sigmas_mm"),
    "config": (lambda _: {"config": {"sigma_mm": 3}}, "config"),
}


@pytest.mark.parametrize("case", REFINE)
def test_refine(case, scene):
    change, argument = REFINE[case]
    valid = {
        "init_pose": scene.pose[0],
        "detections": scene.detections[0],
        "cameras": scene.rig,
        "layout": "h36m17",
    }
    refused(lambda: sk.refine(**(valid | change(scene))), argument)


def test_an_error_may_be_of_an_outer_argument():
    with pytest.raises(sk.InvalidInputError) as of_core:
        sk.RefineConfig(sigma_mm=-1.0)
    renamed = of_core.value.of_argument("sigma")
    assert (renamed.argument, renamed.reason) == ("sigma", of_core.value.reason)


# The core's tests have a wrong value of every setting; here, of every type.
@pytest.mark.parametrize(
    ("make", "name", "value"),
    [
        (sk.RefineConfig, "step_tolerance", 0.0),
        (sk.RefineConfig, "find_swaps", 2),
        (sk.RefineConfig, "view_weights", 2.0),
        (sk.RefineConfig, "renderer", "raster"),
        (sk.RefineConfig.paper, "max_steps", "many"),
        (sk.RefineConfig.paper, "encoding", "hsv"),
        (sk.RefineConfig.paper, "position_lr_mm", "extent"),
    ],
)
def test_settings(make, name, value):
    refused(lambda: make(**{name: value}), f"config.{name}")


def test_other_settings():
    refused(lambda: sk.RefineConfig(joint_sigmas_mm=[30.0, 0.0]), "config.joint_sigmas_mm[1]")
    refused(lambda: sk.RefineConfig(view_weights=[1.0, -1.0]), "config.view_weights[1]")
    refused(lambda: sk.RefineConfig(sigmas=1.0), "config")
    two = {"occlusion_sigma_mm": 30.0, "occlusion_factor": 1.25}
    refused(lambda: sk.RefineConfig.paper(**two), "config.occlusion_factor")


def test_functions_for_study(scene):
    pose, detections, rig = scene.pose[0], scene.detections[0], scene.rig
    zeros, crossed = np.zeros((17, 4)), crooked((2, 0, 1), 0.5)
    valid = (pose, np.zeros((17, 3)), zeros + 1.0, detections, rig)
    refused(lambda: sk.triangulate(scene.detections, rig, method="magic"), "method")
    refused(lambda: sk.render(pose, crooked((4, 1, 1), -2.0), rig[0]), "covariances[4]")
    refused(lambda: sk.project_gaussians(pose, crooked((4, 1, 1), -2.0), rig), "covariances[4]")
    refused(lambda: sk.render(pose, crossed, rig[0]), "covariances[2]")
    refused(lambda: sk.loss_and_gradient(*valid[:2], zeros, detections, rig), "quaternions[0]")
    given = {"target_means": pose, "target_covariances": crossed}
    refused(lambda: sk.loss_and_gradient(*valid, **given), "target_covariances[2]")


LAYOUT = {
    "a triple of two": {"symmetric": [(1, (0, 1))]},
    "tier": {"symmetric": [("a", (0, 1), (1, 0))]},
    "limb of one joint": {"limbs": [(0,)]},
    "no sequence": {"limbs": 3},
    "root": {"root": 0},
    "joints": {"joints": 2},
    "name": {"name": 1},
    "an angle of three": {"angles": [("bend", ["a", "b", "a"], 1)]},
    "no joint": {"left_right": [("a", "c")]},
}


@pytest.mark.parametrize("case", LAYOUT)
def test_layout(case):
    arguments = {"name": "pair", "joints": ["a", "b"]} | LAYOUT[case]
    refused(lambda: sk.Layout(**arguments), next(iter(LAYOUT[case])))


CAMERAS = [sk.Camera(K, EYE, [0, 0, 3000.0], size=SIZE)]
POINTS = np.random.default_rng(0).normal(size=(5, 3)) * 100
WIDE = np.tile(np.eye(3) * 400.0, (5, 1, 1))
PIXELS = sk.project(POINTS, CAMERAS)[0]
TURNS = np.tile([1.0, 0, 0, 0], (5, 1))


def far(values: np.ndarray, number: float = 1e308) -> np.ndarray:
    """Give the same with one number that is none to compute with."""
    out = values.copy()
    out[(-1,) * out.ndim] = number
    return out


ENDLESS = far(PIXELS, -np.inf)
FAR_VALUES: dict[str, tuple[Callable[[], object], str]] = {
    "refine endless": (lambda: sk.refine(None, ENDLESS[None, None], CAMERAS), "detections[0, 0, 4, 1]"),
    "in time endless": (
        lambda: sk.refine_sequence(np.stack([PIXELS, ENDLESS])[:, None], CAMERAS, fps=25),
        "detections[1, 0, 4, 1]",
    ),
    "step endless": (lambda: sk.Refiner(CAMERAS, fps=25).step(ENDLESS[None]), "detections[0, 4, 1]"),
    "track endless": (
        lambda: sk.track(far(np.zeros((2, 2, 1, 17, 2)), np.inf), synthetic.ring(2), fps=25, layout="h36m17"),
        "people[1, 1, 0, 16, 1]",
    ),
    "covariances": (lambda: sk.render(POINTS, far(WIDE), CAMERAS[0]), "covariances[4, 2, 2]"),
    "triangulate": (lambda: sk.triangulate(far(PIXELS)[None], CAMERAS), "detections[0, 4, 1]"),
    "fuse": (lambda: sk.fuse_monocular(far(POINTS)[None], PIXELS[None], CAMERAS), "poses[0, 4, 2]"),
    "quaternions": (
        lambda: sk.loss_and_gradient(POINTS, POINTS * 0, far(TURNS), PIXELS[None], CAMERAS),
        "quaternions[4, 3]",
    ),
}


@pytest.mark.parametrize("case", FAR_VALUES)
def test_numbers_that_are_none_to_compute_with(case):
    call, name = FAR_VALUES[case]
    with pytest.raises(sk.InvalidInputError, match=f"^{re.escape(name)}"):
        call()
