"""MVOR, an operating room: real detections, many people half hidden.

Which detection belongs to which person is taken from the ground truth (oracle association).
"""

from __future__ import annotations

import numpy as np

import skelsplat as sk


def test_hard_data_are_outcomes(data):
    with np.load(data / "mvor" / "mvor_days12.npz") as archive:
        mvor = dict(archive)
    size = tuple(int(s) for s in mvor["image_size"])
    cameras = [
        sk.Camera(K, w2c[:, :3], w2c[:, 3], size=size) for K, w2c in zip(mvor["K"], mvor["w2c"], strict=True)
    ]
    frames = []
    for f, person in np.argwhere((mvor["gt_match_openpose"] >= 0).sum(axis=-1) >= 2)[::6]:
        views = np.full((3, 17, 3), np.nan)
        for i, match in enumerate(mvor["gt_match_openpose"][f, person]):
            if match >= 0:
                views[i] = mvor["det2d_openpose"][f, i, match]
        frames.append(views)
    detections = np.array(frames, dtype=float)
    result = sk.refine(None, np.clip(detections, None, [np.inf, np.inf, 1.0]), cameras, layout="coco17")
    seen = (np.isfinite(detections).all(axis=-1) & (detections[..., 2] > 0)).sum(axis=1)
    assert ((result.joint_status == "unobserved") >= (seen == 0)).all()
    assert (np.isfinite(result.pose).all(axis=-1) | (seen < 2) | np.isnan(result.init_pose[..., 0])).all()
    ok = result.joint_status == "ok"
    assert np.isfinite(result.pose[ok]).all()
    assert ok.any()
