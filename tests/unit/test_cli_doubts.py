"""Which cameras are named as those that disagree, or that see nobody who fits."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.run import Run
from two_people import picked

RIG, LAYOUT, FRAMES = synthetic.human36m_like(), sk.layouts.H36M17, 20


@pytest.mark.parametrize(
    ("cameras", "joints", "whole", "named"),
    [
        ((0.03, 0.03, 0.24, 0.03), (), False, ["cam3"]),
        ((0.03, 0.39, 0.26, 0.1), (), False, ["cam2", "cam3"]),  # neither has three times the others' median
        ((0.09, 0.11, 0.12, 0.1), (), False, []),  # all alike
        ((0.4, 0.5, 0.6, 0.0), (), True, ["cam1", "cam2", "cam3"]),
        ((0.3, 0.3, 0.3, 0.3), (), True, []),
        ((0.05, 0.05, 0.05, 0.8), (), False, ["cam4"]),  # the cause of 24 %
        ((0.25, 0.25, 0.25, 0.6), (), True, ["cam4"]),  # and the others, too
        ((0.0, 0.0, 0.0, 0.0), (2, 3, 5, 6, 13, 16), False, []),  # joints are the cause
    ],
)
def test_a_fifth_rejected_is_told_unless_cameras_or_joints_are_named_for_it(cameras, joints, whole, named):
    """Of detections, by camera or joint, such shares lie 200 px off, anywhere."""
    noise, walk = synthetic.DetectionNoise(sigma_px=2.0), synthetic.motion("walk", 40, seed=1)
    seen, rng = synthetic.simulate_detections(walk, RIG, noise=noise, seed=2), np.random.default_rng(0)
    share = np.fmax.outer(cameras, np.where(np.isin(np.arange(17), joints), 0.9, 0.0))
    wrong, angle = rng.random(seen.shape[:-1]) < share, rng.uniform(0.0, 2 * np.pi, seen.shape[:-1])
    seen[wrong, :2] += 200.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[wrong]
    result = sk.refine(None, seen, RIG, layout=LAYOUT)
    found = Run.from_arrays(result, RIG, seen, LAYOUT, fps=50.0).findings
    told = [(one.kind, *one.subject.cameras) for one in found if not one.subject.joints]
    assert (("many_rejected",) in told) == whole
    assert [camera for kind, *of in told if kind == "camera_disagrees" for camera in of] == named


def test_a_camera_that_alone_sees_somebody_contradicts_nobody():
    pose = synthetic.motion("walk", FRAMES, seed=1)
    noise = synthetic.DetectionNoise.good()
    seen = np.asarray(synthetic.simulate_detections(pose, RIG, noise=noise, seed=2))
    seen[5:, 1:] = np.nan  # the others see the person in the first five frames alone
    _, unmatched, _ = picked(seen[:, :, None], RIG, "consistent", None)
    assert not unmatched.any()
    seen[5:10, 1] = [0.0, 1000.0, 0.0] + [1.0, -1.0, 1.0] * seen[5:10, 0]  # upside down: of no such body
    _, unmatched, _ = picked(seen[:, :, None], RIG, "consistent", None)
    assert unmatched.sum(axis=0).tolist() == [5, 5, 0, 0]
