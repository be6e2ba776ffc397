"""`Refiner(fps=…)`: the past predicts, the detections decide; with a lag the frames after count as well."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from array_forms import bits
from skelsplat import synthetic
from skelsplat.synthetic import DetectionNoise

FPS = 30
RIG = synthetic.human36m_like()
ONE_CORE = sk.RefineConfig(n_threads=1)


@pytest.fixture(scope="module")
def walk():
    return synthetic.motion("walk", 90, fps=FPS, seed=0)


@pytest.fixture(scope="module")
def seen(walk):
    noise = DetectionNoise.recording(frame_rate=FPS)
    return synthetic.simulate_detections(walk, RIG, noise=noise, layout="h36m17", seed=0)


def refiner(**options):
    return sk.Refiner(RIG, layout="h36m17", **{"fps": FPS, "config": ONE_CORE, **options})


def poses(live, frames):
    return np.array([live.step(frame).pose for frame in frames])


def far(pose, truth):
    return np.linalg.norm(pose - truth, axis=-1)


@pytest.mark.parametrize("views", [2, 4])
def test_a_jump_is_followed_by_two_views_that_agree(walk, seen, views):
    live = refiner()
    poses(live, seen[:40])
    jumped = walk[40:45] + np.array([600.0, -500.0, 100.0])
    noise = DetectionNoise.recording(frame_rate=FPS)
    shown = synthetic.simulate_detections(jumped, RIG, noise=noise, layout="h36m17", seed=1)
    shown[:, views:] = [np.nan, np.nan, 0.0]
    for frame, truth in zip(shown, jumped, strict=True):
        alone = sk.refine(None, frame, RIG, layout="h36m17", config=ONE_CORE)
        result = live.step(frame)
        judged = alone.joint_status == "ok"
        assert far(result.pose, truth)[judged].mean() < 1.1 * far(alone.pose, truth)[judged].mean()


def test_the_lag_says_which_frame_is_answered(walk, seen):
    live = refiner(lag=4)
    results = [live.step(frame) for frame in seen[:20]]
    assert all((result.joint_status == "unobserved").all() for result in results[:4])
    assert all(np.isnan(result.pose).all() for result in results[:4])
    nothing = np.full_like(seen[0], np.nan)
    results += [live.step(nothing) for _ in range(4)]
    found = np.array([result.pose for result in results[4:]])
    assert np.isfinite(found).all()
    assert far(found, walk[:20]).mean() < 20.0
    errors = np.array([result.reprojection_error for result in results[4:]])
    assert np.array_equal(np.isfinite(errors), np.isfinite(seen[:20, ..., 0]) & (seen[:20, ..., 2] > 0))


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"fps": 0.0}, "fps"),
        ({"fps": float("nan")}, "fps"),
        ({"fps": 1e9}, "fps"),
        ({"lag": -1}, "lag"),
        ({"lag": 2.5}, "lag"),
        ({"lag": 10**30}, "lag"),
        ({"fps": None, "lag": 3}, "lag"),
        ({"config": sk.RefineConfig.paper()}, "config.method"),
    ],
)
def test_what_is_no_rate_or_lag_is_refused(options, argument):
    with pytest.raises(sk.InvalidInputError) as caught:
        refiner(**options)
    assert caught.value.argument == argument


@pytest.mark.parametrize("lag", [0, 2])
def test_bad_input_leaves_the_state_as_it_was(seen, lag):
    live, untouched = refiner(lag=lag), refiner(lag=lag)
    for one in (live, untouched):
        poses(one, seen[:5])
    with pytest.raises(sk.InvalidInputError, match="expected one frame"):
        live.step(seen)
    with pytest.raises(sk.InvalidInputError, match="expected 17 joints, as in the previous frames"):
        live.step(seen[0][:, :5])
    assert bits(live.step(seen[5])) == bits(untouched.step(seen[5]))
