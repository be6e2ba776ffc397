"""One valid call that the input checks start from."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

import skelsplat as sk
from skelsplat import synthetic


@pytest.fixture
def scene() -> SimpleNamespace:
    """Three frames of a walk in the Human3.6M-like room: pose (T,N,3), detections (T,M,N,2), rig."""
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", 3, seed=5)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    return SimpleNamespace(rig=rig, pose=pose, detections=detections, layout="h36m17")
