"""Cameras from several people: who is who is found out; strangers and bystanders do no harm."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import detection_files
import skelsplat as sk
from command_line import succeed
from skelsplat import synthetic
from skelsplat._who import one_after_another
from skelsplat._world import mean_size
from skelsplat.exceptions import DegenerateGeometryError
from skelsplat.io import write_calibration

RIG = synthetic.ring(4, radius_mm=4500.0)
LAYOUT, FRAMES, FPS = "h36m17", 60, 15.0
ONE_THREAD = sk.RefineConfig(n_threads=1)


@cache
def scene(frames: int = FRAMES, **given: bool) -> synthetic.Scene:
    """Return two people who cross, in random order in every frame."""
    return synthetic.simulate_scene(2, RIG, n_frames=frames, fps=FPS, meetings=("cross",), seed=1, **given)


def calibrated(people: np.ndarray, **given: object) -> sk.RigCalibration:
    rig = list(RIG)[: people.shape[1]]
    return sk.calibrate_cameras(people, rig, layout=LAYOUT, fps=FPS, config=ONE_THREAD, **given)


def off(found: sk.RigCalibration) -> float:
    """Return the largest difference of two cameras' distance from the true one, relative to it."""
    true = list(RIG)[: len(found.report)]
    assert found.cameras.names == tuple(camera.name for camera in true)
    a, b = (np.stack([np.asarray(camera.centre) for camera in rig]) for rig in (found.cameras, true))
    pairs = np.triu_indices(len(a), 1)
    ratio = np.linalg.norm(a[:, None] - a, axis=2)[pairs] / np.linalg.norm(b[:, None] - b, axis=2)[pairs]
    return float(np.ptp(ratio / ratio.mean()))


def test_two_people_who_cross_place_cameras_as_well_as_if_it_were_known_who_is_who() -> None:
    known, found = calibrated(one_after_another(list(scene().detections()))), calibrated(scene().people)
    assert found.sure
    assert [len(person) for person in found.people] == [FRAMES] * 2
    assert off(found) <= 1.5 * off(known) + 0.003
    assert off(known) < 0.02


def test_a_camera_that_was_moved_while_people_come_and_go_is_named() -> None:
    people = scene(frames=90).people[:, :3].copy()
    people[50:, 1, ..., 0] += 60.0  # px
    found = calibrated(people)
    assert off(found) < 0.02
    assert found.report[1].span == (0, pytest.approx(50, abs=2))


def test_a_bystander_of_two_views_a_stranger_of_one_and_empty_places_do_no_harm() -> None:
    seen = scene(bystander=True)
    people = np.pad(seen.people, ((0, 0), (0, 0), (0, 2), (0, 0), (0, 0)), constant_values=np.nan)
    people[:, 2, -1] = seen.detections()[0, ::-1, 0]  # a time-reversed walk that no other view sees
    assert off(calibrated(people)) < 0.02


def test_people_who_come_and_go_are_enough_together() -> None:
    first, second = scene().detections()
    half = FRAMES // 2
    people = np.full((FRAMES, 4, 2, *first.shape[2:]), np.nan)
    people[:half, :, 0], people[half:, :, 1] = first[:half], second[half:]
    assert off(calibrated(people)) < 0.03


def test_the_command_that_is_printed_refines_everybody(tmp_path) -> None:
    take = detection_files.Take(scene().people, list(RIG.names), list(sk.layouts.H36M17.joints))
    write_calibration(tmp_path / "lenses.toml", RIG)
    options = ["--intrinsics", tmp_path / "lenses.toml", "--layout", LAYOUT, "-o", tmp_path / "new.toml"]
    found = succeed("calibrate", detection_files.npz(tmp_path, take), *options, "--fps", FPS)
    assert found.stdout.rstrip().endswith("--fps 15.0 --people all")


def test_one_place_is_one_person() -> None:
    one = scene().detections()[0]
    alone, among = calibrated(one), calibrated(one[:, :, None])
    for a, b in zip(alone.cameras, among.cameras, strict=True):
        np.testing.assert_array_equal(a.R, b.R)
        np.testing.assert_array_equal(a.t, b.t)


def test_nobody_in_common_is_an_error_that_says_what_to_do() -> None:
    first, second = scene().detections()
    people = np.full((FRAMES, 2, 2, *first.shape[2:]), np.nan)
    people[: FRAMES // 2, 0, 0] = first[: FRAMES // 2, 0]
    people[FRAMES // 2 :, 1, 1] = second[FRAMES // 2 :, 1]
    with pytest.raises(DegenerateGeometryError, match="film one person who walks about, or choose a person"):
        sk.calibrate_cameras(people, list(RIG)[:2], layout=LAYOUT)


def test_clocks_are_found_by_several_people() -> None:
    late, frames = np.array([0, 11, 19]), 90
    whole = scene(frames=frames + 20).people
    people = np.stack([whole[20 - n : 20 - n + frames, i] for i, n in enumerate(late)], axis=1)
    found = calibrated(people, clock=True)
    assert off(found) < 0.03
    assert [round(clock) for clock in found.clocks.values()] == late.tolist()
    together = found.synchronised(people)
    assert together.shape == people.shape
    np.testing.assert_array_equal(together[: frames - 20, 0], people[: frames - 20, 0])


def test_the_stature_is_the_mean_of_the_people() -> None:
    body = synthetic.motion("walk", 30, fps=FPS, seed=0)
    tall = np.concatenate([body, 1.2 * body, 1.2 * body])
    of_bones = mean_size(tall, sk.layouts.H36M17)  # relative to the median bone, of a tall one
    assert of_bones == pytest.approx((1 / 1.2 + 2) / 3, rel=1e-6)
