"""From one valid call, one thing broken at a time: the type of the error and its text."""

from __future__ import annotations

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


CAMERA = {
    "NaN in K": ({"K": changed(K, (0, 0), np.nan)}, r"K: expected finite values, got NaN"),
    "focal": ({"K": changed(K, (1, 1), -5.0)}, r"K: expected .*focal.*, got .*-5"),
    "skew": ({"K": changed(K, (0, 1), 3.0)}, r"K: expected .*got .*3"),
    "K shape": ({"K": np.eye(4)}, r"K: expected shape \(3, 3\), got shape \(4, 4\)"),
    "R scaled": ({"R": 1.1 * EYE}, r"R: expected .*got .*"),
    "R reflection": ({"R": np.diag([1.0, 1, -1])}, r"R: expected a rotation .*got a reflection"),
    "t shape": ({"t": np.zeros(4)}, r"t: expected shape \(3,\), got shape \(4,\)"),
    "t text": ({"t": ["a", "b", "c"]}, r"t: expected an array of numbers, got .*"),
    "size": ({"size": (0, 800)}, r"size: expected .*at least 1 pixel, got \(0, 800\)"),
    "size type": ({"size": "large"}, r"size: expected \(width, height\).*, got 'large'"),
    "distortion": ({"distortion": [0.1] * 6}, r"distortion: expected .*4, 5, 8, 12 or 14.*got .*6"),
    "fisheye": ({"distortion": [0.1] * 5, "fisheye": True}, r"distortion: expected .*4.*got .*5"),
}


@pytest.mark.parametrize("case", CAMERA)
def test_camera(case):
    broken, message = CAMERA[case]
    arguments = {"K": K, "R": EYE, "t": ZERO, "size": SIZE} | broken
    with pytest.raises(sk.InvalidInputError, match=message):
        sk.Camera(**arguments)


def test_a_named_camera_is_named_in_the_message():
    with pytest.raises(sk.InvalidInputError, match=r"'cam_07'"):
        sk.Camera(changed(K, (0, 0), -1.0), EYE, ZERO, size=SIZE, name="cam_07")


def test_rig():
    camera = sk.Camera(K, EYE, ZERO, size=SIZE, name="a")
    for cameras, unit, message in [
        ([], "mm", "cameras: expected at least one Camera, got none"),
        ([camera, 3], "mm", r"cameras\[1\]: expected a Camera, got int"),
        ([camera, camera], "mm", "cameras: expected different names, got 'a' twice"),
        ([camera], "inch", "unit: expected one of mm, cm, m, got 'inch'"),
    ]:
        with pytest.raises(sk.InvalidInputError, match=message):
            sk.CameraRig(cameras, unit=unit)
    with pytest.raises(KeyError, match="no camera called 'b'; there are a"):
        sk.CameraRig([camera])["b"]


REFINE = {
    "detections shape": (
        lambda s: {"detections": s.detections[0, 0, :, 0]},
        r"detections: expected shape \(\[T,\] M, N, 2\|3\) of one person \(.*, got shape \(17,\)",
    ),
    "several people": (
        lambda s: {"detections": s.detections[:, :, None]},
        r"detections: expected shape .* of one person \(choose_person\), got shape \(3, 4, 1",
    ),
    "no joints": (
        lambda _: {"detections": np.zeros((4, 0, 2)), "init_pose": None},
        r"detections: expected at least one view and one joint, got shape \(4, 0, 2\)",
    ),
    "number of cameras": (
        lambda s: {"detections": s.detections[0, :3], "init_pose": s.pose[0]},
        r"detections: expected one view per camera \(4\), got 3 views",
    ),
    "init_pose shape": (
        lambda s: {"init_pose": s.pose[0, :16]},
        r"init_pose: expected shape \(17, 3\).*, got shape \(16, 3\)",
    ),
    "init_pose for a batch": (
        lambda s: {"detections": s.detections},
        r"init_pose: expected shape \(3, 17, 3\).*, got shape \(17, 3\)",
    ),
    "confidence shape": (
        lambda _: {"confidence": np.ones((4, 16))},
        r"confidence: expected shape \(4, 17\), got shape \(4, 16\)",
    ),
    "confidence range": (
        lambda _: {"confidence": np.full((4, 17), 1.2)},
        r"^confidence\[0, 0\]: expected a value in \[0, 1\] \(clip scores: np\.clip\(.*\)\), got 1.2$",
    ),
    "confidence twice": (
        lambda s: {
            "detections": np.concatenate([s.detections[0], np.ones((4, 17, 1))], axis=-1),
            "confidence": np.ones((4, 17)),
        },
        r"confidence: expected only one source of confidences",
    ),
    "unknown layout": (
        lambda _: {"layout": "h36m18"},
        r"layout: expected one of h36m17, coco17, .* or a layout file.* got 'h36m18'; did you mean h36m17\?",
    ),
    "layout of another N": (
        lambda _: {"layout": "body25"},
        r"detections: expected the layout's 25 joints, got 17 joints",
    ),
    "layout type": (lambda _: {"layout": 17}, r"layout: expected a Layout or its name, got int"),
    "a camera's type": (
        lambda s: {"cameras": [*list(s.rig)[:3], {"K": 1}]},
        r"cameras\[3\]: expected a Camera, got dict",
    ),
    "one camera": (
        lambda s: {"cameras": s.rig[0]},
        r"cameras: expected a CameraRig or a sequence of Camera, got Camera",
    ),
    "cameras type": (
        lambda _: {"cameras": 4},
        r"cameras: expected a CameraRig or a sequence of Camera, got int",
    ),
    "init_sigma of zero": (
        lambda _: {"init_sigma": 0.0},
        r"init_sigma: expected a positive finite standard deviation, or NaN for none, got 0",
    ),
    "negative init_sigma": (
        lambda _: {"init_sigma": changed(np.full(17, 30.0), 4, -1.0)},
        r"init_sigma\[4\]: expected a positive finite standard deviation, or NaN for none, got -1",
    ),
    "endless init_sigma": (
        lambda _: {"init_sigma": np.inf},
        r"init_sigma: expected values within ±1e30, or NaN for none, got inf",
    ),
    "init_sigma shape": (
        lambda _: {"init_sigma": np.full(16, 30.0)},
        r"init_sigma: expected shape \(\) for a number, \(17,\), \(17, 3, 3\), got shape \(16,\)",
    ),
    "init_sigma of another batch": (
        lambda s: {
            "init_pose": s.pose,
            "detections": s.detections,
            "init_sigma": np.tile(np.eye(3), (2, 17, 1, 1)),
        },
        r"init_sigma: expected shape .* or \(3, 17, 3, 3\), got shape \(2, 17, 3, 3\)",
    ),
    "init_sigma that is no covariance": (
        lambda _: {"init_sigma": changed(np.tile(np.eye(3), (17, 1, 1)), (2, 0, 0), -1.0)},
        r"init_sigma\[2\]: expected a symmetric positive definite covariance",
    ),
    "crooked init_sigma": (
        lambda _: {"init_sigma": changed(np.tile(np.eye(3), (17, 1, 1)), (2, 0, 1), 0.5)},
        r"init_sigma\[2\]: expected a symmetric positive definite covariance",
    ),
    "init_sigma without a pose": (
        lambda _: {"init_pose": None, "init_sigma": 30.0},
        r"init_sigma: expected an init_pose as well, got none",
    ),
    "init_sigma for paper": (
        lambda _: {"init_sigma": 30.0, "config": sk.RefineConfig.paper()},
        r"init_sigma: expected the method 'annealed', got 'paper'",
    ),
    "view_weights": (
        lambda _: {"config": sk.RefineConfig(view_weights=[1.0, 1.0])},
        r"config.view_weights: expected one weight per camera \(4\), got 2",
    ),
    "joint_sigmas_mm": (
        lambda _: {"config": sk.RefineConfig(joint_sigmas_mm=[30.0] * 16)},
        r"config.joint_sigmas_mm: expected 17 joints, as in the detections, got 16 joints",
    ),
    "config type": (
        lambda _: {"config": {"sigma_mm": 3}},
        r"config: expected a RefineConfig or None, got dict",
    ),
}


@pytest.mark.parametrize("case", REFINE)
def test_refine(case, scene):
    change, message = REFINE[case]
    valid = {
        "init_pose": scene.pose[0],
        "detections": scene.detections[0],
        "cameras": scene.rig,
        "layout": "h36m17",
    }
    with pytest.raises(sk.InvalidInputError, match=message) as caught:
        sk.refine(**(valid | change(scene)))
    assert isinstance(caught.value, ValueError)
    assert str(caught.value) == f"{caught.value.argument}: {caught.value.reason}"


def test_an_error_knows_its_argument():
    with pytest.raises(sk.InvalidInputError) as of_core:
        sk.RefineConfig(sigma_mm=-1.0)
    assert of_core.value.argument == "config.sigma_mm"
    renamed = of_core.value.of_argument("sigma")
    assert str(renamed) == f"sigma: {of_core.value.reason}"
    assert renamed.argument == "sigma"


CONFIG = {
    "negative sigma": ({"sigma_mm": -1.0}, r"config.sigma_mm: expected a positive finite number, got -1"),
    "unknown field": ({"sigmas": 1.0}, r"config: unknown name 'sigmas', expected one of sigma_mm"),
    "type": ({"max_steps": "many"}, r"config.max_steps: expected a whole number of at least 0, got 'many'"),
    "tier": ({"symmetry_tier": 4}, r"config.symmetry_tier: expected a whole number from 0 to 3, got 4"),
    "encoding": ({"encoding": "hsv"}, r"config.encoding: expected 'one_hot', 'rgb' or 'single', got 'hsv'"),
    "learning rate": (
        {"position_lr_mm": "extent"},
        r"config.position_lr_mm: expected a number, or 'camera_extent', got 'extent'",
    ),
    "two sigmas": (
        {"occlusion_sigma_mm": 30.0, "occlusion_factor": 1.25},
        r"config.occlusion_factor: expected only one of the two, got occlusion_sigma_mm as well",
    ),
}


ROBUST_CONFIG = {
    "sigma_start_mm": (
        {"sigma_start_mm": 0.0},
        r"config.sigma_start_mm: expected a positive finite number, got 0",
    ),
    "sigma_decay": ({"sigma_decay": 1.0}, r"config.sigma_decay: expected a number between 0 and 1, got 1"),
    "per noise": ({"sigma_per_noise": -2.0}, r"config.sigma_per_noise: expected a positive .*, got -2"),
    "noise": (
        {"detection_sigma_px": 0.0},
        r"config.detection_sigma_px: expected a positive finite number, got 0",
    ),
    "symmetry": ({"symmetry_sigma_mm": -1.0}, r"config.symmetry_sigma_mm: expected a positive finite number"),
    "step": ({"step_tolerance": 0.0}, r"config.step_tolerance: expected a positive finite number, got 0"),
    "joint": (
        {"joint_sigmas_mm": [30.0, 0.0]},
        r"config.joint_sigmas_mm\[1\]: expected a positive finite number",
    ),
    "view": ({"view_weights": [1.0, -1.0]}, r"config.view_weights\[1\]: expected .* not negative, got -1"),
    "weights": ({"view_weights": 2.0}, r"config.view_weights: expected a sequence of numbers, or None, got"),
    "swaps": ({"find_swaps": 2}, r"config.find_swaps: expected True or False, got 2"),
    "pixels": ({"renderer": "raster"}, r"config.renderer: expected a setting of the method 'annealed', got"),
}


@pytest.mark.parametrize("case", ROBUST_CONFIG)
def test_config_of_the_default(case):
    fields, message = ROBUST_CONFIG[case]
    with pytest.raises(sk.InvalidInputError, match=message):
        sk.RefineConfig(**fields)


@pytest.mark.parametrize("case", CONFIG)
def test_config(case):
    fields, message = CONFIG[case]
    with pytest.raises(sk.InvalidInputError, match=message):
        sk.RefineConfig.paper(**fields)


def test_triangulation_method(scene):
    with pytest.raises(
        sk.InvalidInputError, match="method: unknown name 'magic', expected one of robust, dlt, ransac"
    ):
        sk.triangulate(scene.detections, scene.rig, method="magic")


def test_a_covariance_with_a_negative_variance(scene):
    bad = np.tile(np.eye(3), (17, 1, 1))
    bad[4, 1, 1] = -2.0
    for call in (
        lambda: sk.render(scene.pose[0], bad, scene.rig[0]),
        lambda: sk.project_gaussians(scene.pose[0], bad, scene.rig),
    ):
        with pytest.raises(
            sk.InvalidInputError, match=r"covariances\[4\]: expected no negative variance, got .*-2"
        ):
            call()


def test_loss_and_gradient(scene):
    zeros = np.zeros((17, 4))
    with pytest.raises(sk.InvalidInputError, match=r"quaternions\[0\]: expected a non-zero quaternion"):
        sk.loss_and_gradient(scene.pose[0], np.zeros((17, 3)), zeros, scene.detections[0], scene.rig)
    bad = np.tile(np.eye(3), (17, 1, 1))
    bad[2, 0, 1] = 0.5
    valid = (scene.pose[0], np.zeros((17, 3)), zeros + 1.0, scene.detections[0], scene.rig)
    with pytest.raises(sk.InvalidInputError, match=r"target_covariances\[2\]: expected a symmetric matrix"):
        sk.loss_and_gradient(*valid, target_means=scene.pose[0], target_covariances=bad)
    with pytest.raises(sk.InvalidInputError, match=r"covariances\[2\]: expected a symmetric matrix"):
        sk.render(scene.pose[0], bad, scene.rig[0])


LAYOUT = {
    "a triple of two": ({"symmetric": [(1, (0, 1))]}, r"symmetric: expected triples .*, got \(1, \(0, 1\)\)"),
    "tier type": ({"symmetric": [("a", (0, 1), (1, 0))]}, r"symmetric: expected triples .*, got \('a', "),
    "limb of one joint": ({"limbs": [(0,)]}, r"limbs: expected pairs of two joints, got 1 joints"),
    "no sequence": ({"limbs": 3}, r"limbs: expected pairs of two joints, got int"),
    "limb type": ({"limbs": [3]}, r"limbs: expected pairs of two joints, got int"),
    "root": ({"root": 0}, r"root: expected a sequence of joints, got int"),
    "joints": ({"joints": 2}, r"joints: expected a sequence of strings, got 2"),
    "name": ({"name": 1}, r"name: expected a string, got 1"),
    "no joint": ({"left_right": [("a", "c")]}, r"left_right: expected a joint of the layout, got 'c'"),
}


@pytest.mark.parametrize("case", LAYOUT)
def test_layout(case):
    broken, message = LAYOUT[case]
    with pytest.raises(sk.InvalidInputError, match=message):
        sk.Layout(**{"name": "pair", "joints": ["a", "b"]} | broken)


def test_plain_values():
    camera = sk.Camera(K, EYE, ZERO, size=SIZE)
    with pytest.raises(sk.InvalidInputError, match=r"factor: expected a number, got '2'"):
        camera.scaled("2")
    with pytest.raises(sk.InvalidInputError, match=r"name: expected a string, got 7"):
        sk.Camera(K, EYE, ZERO, size=SIZE, name=7)
    with pytest.raises(sk.InvalidInputError, match=r"tier: expected a whole number from 0 to 255, got 'all'"):
        sk.layouts.COCO17.symmetric_pairs("all")


class Stopped:
    """What Python code meets at Ctrl-C, wherever the compiled code calls it."""

    def __array__(self, *_args, **_kwargs):
        raise KeyboardInterrupt

    __iter__ = __index__ = __array__


def test_ctrl_c_is_no_bad_input():
    rig = synthetic.human36m_like()
    detections = np.zeros((4, 17, 3))
    with pytest.raises(KeyboardInterrupt):
        sk.triangulate(Stopped(), rig)
    with pytest.raises(KeyboardInterrupt):
        sk.triangulate(detections, Stopped())
    with pytest.raises(KeyboardInterrupt):
        sk.Layout("pair", ["a", "b"], limbs=[("a", Stopped())])
    with pytest.raises(KeyboardInterrupt):
        sk.Camera(np.eye(3), np.eye(3), [0.0, 0.0, 1.0], size=(Stopped(), 3))
