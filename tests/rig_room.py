"""Recordings of somebody who walks about, from which cameras can be found or not."""

from __future__ import annotations

import numpy as np

import calibration_files as files
import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import write_calibration

RIG = synthetic.human36m_like(distortion=True)
LATE = 12  # frames that the numbers of cam2 are too high


def write_room(top, *only):
    """Write a walk of 5 s; in ``late`` cam2 is late and cam3 ends early, in ``other`` cam4 sees another.

    In ``mixed`` it does in every fourth frame; in ``skipped`` cam2 lacks six frames from 60 on. `only` are
    those that are written.
    """
    pace = np.cumsum(np.rint(4 + 3 * np.sin(np.cumsum(np.linspace(0.1, 0.3, 140))))).astype(int)
    seen = [
        synthetic.simulate_detections(
            synthetic.motion("walk", 1000, fps=100, seed=seed)[pace],  # one that is not periodic
            RIG,
            noise=synthetic.DetectionNoise.good(),
            seed=seed,
        )[LATE:, ..., :2]
        for seed in (1, 7)
    ]
    write_calibration(top / "lenses.toml", RIG)
    late, other, mixed = (seen[0].copy() for _ in range(3))
    late[LATE:, 1] = seen[0][:-LATE, 1]
    other[:, 3] = seen[1][:, 1]
    mixed[::4, 3] = other[::4, 3]
    skipped = seen[0].copy()
    skipped[60:-6, 1], skipped[-6:, 1] = seen[0][66:, 1], np.nan
    rng = np.random.default_rng(0)
    still = seen[0][:1] + rng.normal(0, 8, seen[0][:1].shape) + rng.normal(0, 0.3, seen[0].shape)
    recordings = {"pose": seen[0], "late": late[LATE:], "other": other, "still": still, "short": late[:3]}
    recordings |= {"mixed": mixed, "skipped": skipped, "nobody": np.full((70, 4, 17, 2), np.nan)}
    recordings |= {"two": seen[0][:, :2], "one": seen[0][:, :1]}
    for name in only or recordings:
        rig = sk.CameraRig(RIG[: recordings[name].shape[1]].cameras)
        files.openpose_folders(top / name, rig, recordings[name])
    for path in sorted((top / "late" / "cam3").glob("*"))[-5:]:
        path.unlink()
    return top
