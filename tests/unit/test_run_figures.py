"""What the figures of a run are given: arrays in the pixels and units in which they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic, viz
from skelsplat.run import Run


@pytest.mark.drawn
def test_detections_and_reprojections_are_in_the_same_pixels(tmp_path, monkeypatch):
    """Both are ideal ones: where detections are exact, they meet."""
    rig = synthetic.human36m_like(distortion=True)
    seen = sk.project(synthetic.motion("walk", 1, seed=3), rig).swapaxes(0, 1)
    config = sk.RefineConfig.paper(max_steps=20)
    result = sk.refine(None, seen, rig, layout="h36m17", config=config)
    given = {}
    for name in ("write_overview", "write_weights"):
        monkeypatch.setattr(viz, name, lambda _, data, name=name, **__: given.update({name: data}))
    Run.from_arrays(result, rig, seen, "h36m17", config=config).write_figures(tmp_path)
    assert max(np.abs(seen[0, i] - rig[i].undistort(seen[0, i])).max() for i in range(4)) > 5.0
    for picture in given["write_overview"].panels:
        assert np.abs(picture.detections - picture.reprojection).max() < 1.0
