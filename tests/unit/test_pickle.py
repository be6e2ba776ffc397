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

PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)


def twins(value):
    """Return the value as every way of copying makes it, and how."""
    for protocol in PROTOCOLS:
        yield f"protocol {protocol}", pickle.loads(pickle.dumps(value, protocol))
        if protocol < 5:  # CPython's own fails on empty arrays by protocol 5
            yield f"Python, protocol {protocol}", pickle._loads(pickle._dumps(value, protocol))
    yield "copy", copy.copy(value)
    yield "deepcopy", copy.deepcopy(value)


def layout_parts(layout):
    pairs = [layout.symmetric_pairs(tier) for tier in range(4)]
    ends = layout.limbs, layout.left_right, layout.occlusion_prone, layout.root
    return layout.name, layout.joints, *ends, *pairs


OWN = sk.Layout(
    "two arms",
    ["neck", "l_elbow", "l_wrist", "r_elbow", "r_wrist"],
    limbs=[("l_elbow", "l_wrist"), (3, 4)],
    symmetric=[(1, (1, 2), (3, 4)), (3, (0, 1), (0, 3))],
    left_right=[(1, 3), (2, 4)],
    occlusion_prone=["l_wrist", "r_wrist"],
    root=[0],
)


@pytest.mark.parametrize(
    "layout", [*map(sk.layouts.get, sk.layouts.names), OWN, sk.Layout("bare", ["a"])], ids=lambda v: v.name
)
def test_layouts(layout):
    for way, twin in twins(layout):
        assert twin == layout, way
        assert layout_parts(twin) == layout_parts(layout), way


CONFIGS = {
    "default": sk.RefineConfig(),
    "paper": sk.RefineConfig.paper(),
    "by extent": sk.RefineConfig.paper(position_lr_mm="camera_extent", stop_window=3, n_threads=1),
    "per joint and view": sk.RefineConfig(
        joint_sigmas_mm=np.linspace(10, 60, 17), view_weights=[1, 0, 0.3, 1]
    ),
    "factor": sk.RefineConfig.paper(occlusion_factor=1.25, adam_betas=(0.8, 0.99)),
    "no limits": sk.RefineConfig(sigma_per_noise=None, detection_sigma_px=2.5, find_swaps=False),
}


@pytest.mark.parametrize("config", CONFIGS)
def test_settings(config):
    for way, twin in twins(CONFIGS[config]):
        assert twin == CONFIGS[config], way
        assert twin.to_dict() == CONFIGS[config].to_dict(), way


def cameras():
    rng = np.random.default_rng(0)
    for count, fisheye in [
        (0, False),
        (4, False),
        (5, False),
        (8, False),
        (12, False),
        (14, False),
        (4, True),
    ]:
        R, t = synthetic.look_at(rng.normal(size=3) * 3e3, rng.normal(size=3))
        K = np.diag([*rng.uniform(500, 2000, 2), 1.0])
        K[:2, 2] = rng.uniform(100, 900, 2)
        lens = rng.normal(size=count) * 1e-3 if count else None
        yield sk.Camera(
            K, R, t, distortion=lens, fisheye=fisheye, size=(1920, 1080), name="x" * (count % 3) or None
        )


@pytest.mark.parametrize("camera", list(cameras()), ids=lambda c: f"{c.distortion is None}{c.fisheye}")
def test_cameras(camera):
    for way, twin in twins(camera):
        assert twin == camera, way
        for part in ("K", "R", "t", "distortion", "size", "name", "fisheye"):
            assert bits(getattr(twin, part)) == bits(getattr(camera, part)), (way, part)


def test_rigs():
    for rig in (RIG, sk.CameraRig(list(RIG)[:2], unit="m")):
        for way, twin in twins(rig):
            assert twin == rig, way
            assert (twin.unit, twin.names) == (rig.unit, rig.names), way


class StudioRig(sk.CameraRig):
    """A class of one's own; pickle finds it by its name in the module."""


RESULTS = {
    "Refinement": sk.refine(START, FRAME, RIG, layout="h36m17"),
    "Refinement of a batch": sk.refine(None, SEEN[:2], RIG),
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


ERRORS = [
    sk.SkelSplatError("a"),
    sk.InvalidInputError("a: expected b, got c"),
    sk.DegenerateGeometryError("a"),
    sk.MissingPackageError("a"),
    sk.DatasetError("folder/file.json", "line 3", 4, 5),
]


def test_a_damaged_setting_is_refused():
    make, (kind, arguments, fields) = sk.RefineConfig().__reduce__()
    with pytest.raises(sk.InvalidInputError, match="sigma_mm"):
        make(kind, arguments, fields | {"sigma_mm": -1.0})
