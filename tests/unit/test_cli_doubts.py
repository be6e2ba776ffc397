"""Which cameras are named as those that disagree, or that see nobody who fits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from skelsplat import synthetic
from skelsplat.run.findings import find_cameras, find_whole, unfit_cameras
from two_people import picked


def group(name, rejected, used=1000):
    """Return what findings read of a camera or joint."""
    errors, shares = dict.fromkeys(("before_px", "after_px"), 1.0), {"rejected_share": rejected / used}
    return {"name": name, "used": used, "rejected": rejected, "mean_weight": 0.5, **errors, **shares}


def doubts(*rejected):
    cameras = [group(f"cam_{i:02d}", count) for i, count in enumerate(rejected, 1)]
    statistics = SimpleNamespace(cameras=cameras, total=group("all", sum(rejected)))
    return [finding.text for finding in find_cameras(statistics)]


@pytest.mark.parametrize(
    ("rejected", "named"),
    [
        ((30, 30, 240, 30), ["cam_03"]),
        ((30, 390, 260, 100), ["cam_02", "cam_03"]),  # neither has three times the others' median
        ((90, 110, 120, 100), []),  # all alike
        ((150, 190, 180, 20), []),  # less than a fifth, and the best camera is not what is usual
        ((300, 350, 400), []),
        ((20, 99, 20), []),
        ((0, 0, 100), ["cam_03"]),
        ((400, 500, 600, 0), ["cam_01", "cam_02", "cam_03"]),
        ((900,), []),
    ],
)
def test_bad_cameras_do_not_hide_each_other(rejected, named):
    assert [doubt.split()[0] for doubt in doubts(*rejected)] == named


def whole(rejected):
    """Return the doubts of all detections (100, M, N) of which these are rejected."""
    count = rejected.shape[0]
    statistics = SimpleNamespace(
        total=group("all", int(rejected.sum()), used=rejected.size),
        cameras=[
            group(f"cam_{i}", int(one.sum()), used=one.size) for i, one in enumerate(rejected.swapaxes(0, 1))
        ],
        joints=[
            group(f"j{j}", int(one.sum()), used=one.size) for j, one in enumerate(np.moveaxis(rejected, 2, 0))
        ],
        rejected=rejected,
        views_used=(~rejected).sum(axis=1),
        error_after=np.ones((count, *rejected.shape[1:])),
    )
    return [finding.text.split(": check ")[0] for finding in find_whole(statistics)]


def shares(cameras, joints):
    """Return detections (100, M, N) rejected in so many per cent of the frames, by camera and by joint."""
    percent = np.fmax.outer(np.asarray(cameras), np.asarray(joints))
    return np.arange(100)[:, None, None] < percent


@pytest.mark.parametrize(
    ("cameras", "joints", "told"),
    [
        ((21, 21, 21, 21), (0,) * 8, ["21% of all detections are rejected"]),
        ((19, 19, 19, 19), (0,) * 8, []),
        ((5, 5, 5, 80), (0,) * 8, []),  # 24 %, of which one camera is the cause and named
        ((5, 5, 5, 95), (50,) * 2 + (0,) * 6, ["36% of all detections are rejected"]),
        ((5, 5, 5, 5), (70, 70) + (0,) * 6, []),  # 21 %, of which two joints are
        ((15, 15, 15, 90), (0,) * 8, ["34% of all detections are rejected"]),
        ((21, 21, 21, 60), (0,) * 8, ["31% of all detections are rejected"]),  # and the others, too
    ],
)
def test_a_fifth_rejected_is_told_unless_cameras_or_joints_are_named_for_it(cameras, joints, told):
    assert whole(shares(cameras, joints)) == told


FRAMES = 20


def views(**frames):
    """Return inputs of cameras of (frames with somebody, frames of them in which nobody fits)."""
    detections = np.full((FRAMES, len(frames), 5, 3), np.nan)
    unmatched = np.zeros((FRAMES, len(frames)), dtype=bool)
    for i, (somebody, unfit) in enumerate(frames.values()):
        unmatched[:unfit, i] = True
        detections[unfit:somebody, i] = 0.5
    rig = SimpleNamespace(names=tuple(frames))
    return SimpleNamespace(detections=detections, unmatched=unmatched, rig=rig)


@pytest.mark.parametrize(
    ("frames", "named"),
    [
        ({"a": (20, 15), "b": (20, 18), "c": (20, 0), "d": (20, 0)}, {"a": (15, 20), "b": (18, 20)}),
        (
            {"a": (20, 6), "b": (20, 18), "c": (20, 1)},
            {"a": (6, 20), "b": (18, 20)},
        ),  # one half of an exchanged pair
        ({"a": (20, 6), "b": (20, 9), "c": (20, 0)}, {}),  # nowhere in most frames
        ({"a": (8, 6), "b": (20, 0)}, {"a": (6, 8)}),  # of the frames in which it sees somebody
        ({"a": (1, 1), "b": (20, 0)}, {}),  # a single ghost
        ({"a": (0, 0), "b": (20, 0)}, {}),  # sees nobody
    ],
)
def test_cameras_in_which_unmatched_are_found(frames, named):
    inputs = views(**frames)
    found = unfit_cameras(inputs)
    assert {inputs.rig.names[i]: frames for i, frames in found.items()} == named


def test_a_camera_that_alone_sees_somebody_contradicts_nobody():
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", FRAMES, seed=1)
    noise = synthetic.DetectionNoise.good()
    seen = np.asarray(synthetic.simulate_detections(pose, rig, noise=noise, seed=2))
    seen[5:, 1:] = np.nan  # the others see the person in the first five frames alone
    _, unmatched, _ = picked(seen[:, :, None], rig, "consistent", None)
    assert not unmatched.any()
    seen[5:10, 1] = [0.0, 1000.0, 0.0] + [1.0, -1.0, 1.0] * seen[5:10, 0]  # upside down: of no such body
    _, unmatched, _ = picked(seen[:, :, None], rig, "consistent", None)
    assert unmatched.sum(axis=0).tolist() == [5, 5, 0, 0]
