"""Cameras whose clocks differ by parts of a frame."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat._clocks import between, shifted
from skelsplat.io.detections import open_detections, read_detections
from skelsplat.synthetic import DetectionNoise, motion, ring, simulate_detections

FIGURE = np.array([[100.0, 100.0, 0.9], [140.0, 120.0, 0.8], [120.0, 300.0, 1.0], [130.0, 200.0, 0.5]])
STEP = np.array([8.0, -4.0, -0.1])
HALFWAY = np.array([4.0, -2.0, -0.1])  # as doubtful as the more doubtful one


def test_what_only_one_frame_shows_and_what_jumps_stays():
    other = FIGURE + STEP
    other[1, :2] = [900.0, 40.0]
    other[3] = np.nan
    (moved,) = between([FIGURE], [other], 0.5)
    np.testing.assert_allclose(moved[[0, 2]], (FIGURE + HALFWAY)[[0, 2]])
    np.testing.assert_array_equal(moved[[1, 3]], FIGURE[[1, 3]])
    (gone,) = between([np.where([[False], [True], [False], [False]], np.nan, FIGURE)], [FIGURE], 0.5)
    assert np.isnan(gone[1]).all()


def test_a_joint_at_zero_is_none_in_both_frames():
    """Some detectors write what they did not detect as (0, 0): half the way there is a wrong detection."""
    corner = FIGURE - np.array([80.0, 80.0, 0.0])  # where it would pass for a small movement
    gone = corner + STEP
    gone[0, :2] = 0.0
    (moved,), (back,) = between([corner], [gone], 0.5), between([gone], [corner], 0.5)
    np.testing.assert_array_equal(moved[0], corner[0])
    np.testing.assert_array_equal(back[0], gone[0])
    np.testing.assert_allclose(moved[1:], (corner + HALFWAY)[1:])


@pytest.mark.parametrize("clock", [0.5, -0.5, 2.0, -1.75, 40.3])
def test_detections_of_steady_motion_are_shifted_exactly(clock):
    times = np.arange(30.0)[:, None, None]
    step = STEP * [1.0, 1.0, 0.0]
    found = shifted(FIGURE + times * step, clock)
    known = np.isfinite(found).all(axis=(1, 2))
    inside = (times[:, 0, 0] + clock >= 0) & (times[:, 0, 0] + clock <= 29)
    assert (known | ~inside).all()
    np.testing.assert_allclose(found[inside], (FIGURE + (times + clock) * step)[inside], atol=1e-12)


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("offset", [0.4, -0.4, 3.6])
def test_files_are_read_between_frames(tmp_path, offset, every):
    rng = np.random.default_rng(3)
    times = every * np.arange(12.0)[:, None, None, None, None]
    people = 300.0 + 100.0 * rng.random((1, 2, 2, 17, 3)) + times * rng.random((1, 2, 2, 17, 3))
    people[..., 2] = 0.5
    people[:, :, 1, :, 0] += 600.0
    people[1::2] = people[1::2, :, ::-1]  # the order of the people is the detector's
    folder, frames = tmp_path, every * np.arange(12)
    for m in range(2):
        np.savez(folder / f"cam{m + 1}.npz", detections=people[:, m], frames=frames)
    options = {"layout": "coco17", "offsets": {"cam2": offset}, "frames": "union"}
    opened = open_detections(folder, ["cam1", "cam2"], **options)
    found = opened.read()
    parts = list(opened.stretches(5))
    np.testing.assert_array_equal(np.concatenate(parts), found.people)
    whole = read_detections(folder, ["cam1", "cam2"], **{**options, "offsets": {"cam2": round(offset)}})
    np.testing.assert_array_equal(found.frames, whole.frames)
    np.testing.assert_array_equal(found.people[:, 0], whole.people[:, 0])
    moved = found.people[:, 1] - whole.people[:, 1]
    inner = np.isfinite(moved).all(axis=(1, 2, 3)) & (np.abs(moved).max(axis=(1, 2, 3)) > 0.0)
    assert inner.sum() == 11  # the camera's first or last frame has none beside it
    rest = offset - round(offset)
    ordered = np.sort(moved[inner], axis=1)
    speed = np.sort(people[2, 1] - people[0, 1], axis=0) / (2 * every)
    np.testing.assert_allclose(
        ordered, np.broadcast_to(np.sort(-rest * speed, axis=0), ordered.shape), atol=1e-9
    )


def test_a_clock_that_is_measured_can_be_set_right():
    """Simulated: a walk at 15 Hz, one camera 0.5 frames late, detections with errors that last."""
    fine, rig, noise = motion("walk", 1200, fps=60, seed=1), ring(4), DetectionNoise.recording(15)
    truth, late = fine[2::4], fine[:-2:4]
    seen = simulate_detections(truth, rig, noise=noise, seed=1)
    wrong = seen.copy()
    wrong[:, 1] = simulate_detections(late, rig, noise=noise, seed=1)[:, 1]
    found = sk.adjust_cameras(wrong, rig, free=[1], clock=True)
    assert found.report[1].clock == pytest.approx(0.5, abs=0.1)

    def error(detections):
        pose = sk.refine_sequence(detections, rig, fps=15, layout="h36m17").pose
        return np.nanmean(np.linalg.norm(pose - truth, axis=-1))

    assert error(wrong) > 1.15 * error(seen)
    assert error(found.synchronised(wrong)) < 1.03 * error(seen)
    np.testing.assert_array_equal(found.synchronised(wrong)[:, 0], wrong[:, 0])
    with pytest.raises(sk.InvalidInputError, match=r"detections: expected shape \(T, 4, N, 2 or 3\), got"):
        found.synchronised(wrong[:, :3])
