"""The overlay on the recording's own videos: it reads what a camera's codec wrote, and marks what it says."""

from __future__ import annotations

import numpy as np

import skelsplat as sk
from command_line import invoke, succeed
from overlay_case import at, need_opencv, read_image, read_video
from skelsplat.io import read_run, sample
from skelsplat.viz import _style

need_opencv()

from skelsplat.viz.overlay._marks import bgr, weight_colour  # noqa: E402  after the check

FRAMES = "40-42"


def test_the_recordings_videos(data, tmp_path):
    """cam01 and cam02 have 1080 columns, the calibration 1088; their codecs differ."""
    videos, run, out = data / "pose2sim_demo" / "videos", tmp_path / "run", tmp_path / "out"
    assert invoke("demo", "--no-adjust", "-o", run, "--quiet").exit_code == 0
    args = ("overlay", run, videos, "-o", out, "--range", FRAMES, "--no-legend")
    result = succeed(*args)
    assert result.stderr.count("1080×1920, but camera") == 2
    for name, width in zip(("cam_01", "cam_02", "cam_03", "cam_04"), (1080, 1080, 1088, 1088), strict=True):
        frames, rate = read_video(out / f"{name}.mp4")
        assert [frame.shape for frame in frames] == [(1920, width, 3)] * 3
        assert round(rate) == sample.FRAME_RATE_HZ
    one = ("--camera", "cam_04", "--range", "41-41")
    assert invoke(*args, *one, "--png", "--no-pose", "--no-ellipses").exit_code == 0
    found = read_run(run)
    t, view = 41, 3
    image = read_image(out / "cam_04" / f"{t:06d}.png")
    weights, seen = found.poses.view_weights[t, view], found.detections[t, view, :, :2]
    apart = np.linalg.norm(seen[:, None] - seen, axis=-1) + np.diag(np.full(len(seen), np.inf))
    for j in np.flatnonzero(np.isfinite(weights) & (np.fmin.reduce(apart, axis=1) > 20)):
        rejected = weights[j] < sk.REJECTED_WEIGHT
        colour = bgr(_style.REJECTED) if rejected else weight_colour(weights[j])
        assert np.abs(at(image, seen[j]) - colour).max() <= 8, found.layout.joints[j]
