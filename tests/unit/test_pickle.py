"""What users hand to other processes comes back equal, by every protocol, by copy and by deepcopy."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import skelsplat as sk
from array_forms import FRAME, POSES, RIG, SEEN, START, bits
from skelsplat import synthetic
from skelsplat.io import PoseData
from skelsplat.rig_check import check_rig


def twins(value):
    """Return the value as every way of copying makes it, and how."""
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        yield f"protocol {protocol}", pickle.loads(pickle.dumps(value, protocol))
    yield "copy", copy.copy(value)
    yield "deepcopy", copy.deepcopy(value)


OWN = sk.Layout(
    "two arms",
    ["neck", "l_elbow", "l_wrist", "r_elbow", "r_wrist"],
    limbs=[("l_elbow", "l_wrist"), (3, 4)],
    symmetric=[(1, (1, 2), (3, 4)), (3, (0, 1), (0, 3))],
    left_right=[(1, 3), (2, 4)],
    occlusion_prone=["l_wrist", "r_wrist"],
    root=[0],
    angles=[("bend", ["neck", "l_elbow", "l_wrist"], -1, 90)],
)


def camera(count: int, *, fisheye: bool = False) -> sk.Camera:
    rng = np.random.default_rng(count)
    R, t = synthetic.look_at(rng.normal(size=3) * 3e3, rng.normal(size=3))
    K = np.diag([*rng.uniform(500, 2000, 2), 1.0])
    lens = rng.normal(size=count) * 1e-3 if count else None
    return sk.Camera(K, R, t, distortion=lens, fisheye=fisheye, size=(1920, 1080), name="x" * count or None)


VALUES = {
    "built-in layout": sk.layouts.get("halpe26"),
    "layout": OWN,
    "settings": sk.RefineConfig(),
    "paper": sk.RefineConfig.paper(position_lr_mm="camera_extent", stop_window=3, adam_betas=(0.8, 0.99)),
    "settings per joint and view": sk.RefineConfig(
        joint_sigmas_mm=np.linspace(10, 60, 17), view_weights=[1, 0, 0.3, 1], sigma_per_noise=None
    ),
    **{f"camera with {count}": camera(count) for count in (0, 4, 5, 8, 12, 14)},
    "fisheye": camera(4, fisheye=True),
    "rig": sk.CameraRig(list(RIG)[:2], unit="m"),
}


@pytest.mark.parametrize("name", VALUES)
def test_values_are_equal(name):
    for way, twin in twins(VALUES[name]):
        assert twin == VALUES[name], way
        assert repr(twin) == repr(VALUES[name]), way


RESULTS = {
    "Refinement": sk.refine(START, FRAME, RIG, layout="h36m17"),
    "SequenceRefinement": sk.refine_sequence(SEEN[:2], RIG, fps=25.0),
    "LossAndGradient": sk.loss_and_gradient(
        START, np.zeros((17, 3)) + 3, np.tile([1.0, 0, 0, 0], (17, 1)), FRAME, RIG
    ),
    "PoseData": PoseData(POSES, sk.layouts.H36M17.joints, np.arange(len(POSES)), "mm"),
    "DetectionNoise": synthetic.DetectionNoise(sigma_px=2.0, limb_swap_rate=0.1),
    "RigReport": check_rig(RIG),
}


@pytest.mark.parametrize("result", RESULTS)
def test_results(result):
    for way, twin in twins(RESULTS[result]):
        assert type(twin) is type(RESULTS[result]), way
        assert bits(twin) == bits(RESULTS[result]), way


@pytest.mark.parametrize("live", [sk.Refiner(RIG), sk.Tracker(RIG, layout="coco17", fps=30.0)])
def test_what_holds_earlier_frames_is_not_copied(live):
    for copied in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError):
            copied(live)
