"""Cameras that repeat one image are found by detections that stay the same to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat._frozen import frozen
from skelsplat.findings import FindingWarning
from skelsplat.rig_check import check_rig

RIG = sk.CameraRig(synthetic.human36m_like(), unit="mm")
PART = slice(41, 80)


@pytest.fixture(scope="module")
def stuck():
    """Return a walk, and its detections with one camera that repeats frame 40 for 39 frames."""
    poses = synthetic.motion("walk", 100, fps=30)
    seen = synthetic.simulate_detections(poses, RIG, noise=synthetic.DetectionNoise.good(), seed=1)
    seen[PART, 1] = seen[40, 1]
    return poses, seen


def test_a_camera_that_repeats_an_image_is_left_out_there_and_said(stuck):
    truth, seen = stuck
    repeated = frozen(seen)
    assert repeated[PART, 1].all()
    assert repeated.sum() == 39
    with pytest.warns(FindingWarning, match="repeat one image while others move"):
        result = sk.refine_sequence(seen, RIG, fps=30, layout="h36m17")
    assert np.nanmean(np.linalg.norm(result.pose - truth, axis=-1)[PART]) < 25
    assert not np.isfinite(result.view_weights[PART, 1]).any()
    with pytest.warns(FindingWarning, match="repeat one image while others move"):
        (person,) = sk.track(seen[:, :, None], RIG, fps=30, layout="h36m17")
    assert (person.slots[PART, 1] == -1).all()
    (finding,) = [one for one in check_rig(RIG, seen).findings if one.kind == "camera_frozen"]
    assert (finding.subject.cameras, finding.numbers["frames"]) == ((RIG.names[1],), [39])


def test_a_camera_that_sees_nothing_repeats_no_image(stuck):
    seen = stuck[1].copy()
    seen[:, 0] = (np.nan, np.nan, 0.0)
    assert not frozen(seen)[:, 0].any()


def test_frames_that_are_doubled_and_a_scene_that_stands_still_are_not(stuck):
    _, seen = stuck
    doubled = np.repeat(seen[:40], 2, axis=0)
    assert not frozen(doubled).any()
    assert not frozen(np.repeat(seen[:1], 50, axis=0)).any()
    assert not frozen(np.full((50, 4, 17, 3), np.nan)).any()
