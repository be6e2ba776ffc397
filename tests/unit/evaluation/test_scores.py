"""Figures by hand: errors that were put there, and which views, frames and takes count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
import takes
from skelsplat.datasets import Dataset
from skelsplat.evaluation import protocols
from skelsplat.evaluation.methods import Solution
from skelsplat.evaluation.scores import mean_interval, score

LAYOUT = sk.layouts.H36M17


def scored(protocol: protocols.Protocol, made, errors, *, layout=LAYOUT) -> dict[str, dict[str, float]]:
    """Score poses whose error is added to the truth of each take; figures by column or joint, "" of all."""
    cases = protocol.cases(Dataset("test", layout, tuple(made)))
    moved = {take.key: error for take, error in zip(made, errors, strict=True)}
    solutions = [Solution(case.take.truth + moved[case.take.key], 0.5) for case in cases]
    return {line["name"]: line for line in score("by hand", cases, solutions, layout, protocol)}


def pck(figures) -> list[float]:
    return [figures[""][f"pck_{mm}"] for mm in (50, 100, 150)]


def along_x(mm: float) -> np.ndarray:
    return np.array([mm, 0.0, 0.0])


PROTOCOL = replace(protocols.get("human36m"), every=1)


def test_averages_are_over_frames_not_over_actions_or_takes() -> None:
    made = [
        takes.hand_made("S9/Directions", frames=range(3)),
        takes.hand_made("S11/Directions 1", frames=range(1)),
        takes.hand_made("S9/Eating", frames=range(4)),
    ]
    s = scored(PROTOCOL, made, [along_x(10), along_x(30), along_x(2)])
    whole = s[""]
    assert whole["absolute_mm"] == pytest.approx((3 * 10 + 30 + 4 * 2) / 8)
    assert s["Directions"]["absolute_mm"] == pytest.approx(15.0)
    assert s["Eating"]["absolute_mm"] == pytest.approx(2.0)
    assert (s["Directions"]["poses"], whole["poses"], whole["absolute_poses"]) == (4, 8, 8)
    assert whole["median_mm"] == pytest.approx(6.0)
    assert whole["ms_per_pose"] == pytest.approx(1500 / 8)
    # The body moved as a whole.
    assert whole["relative_mm"] == pytest.approx(0.0, abs=1e-9)
    assert whole["procrustes_mm"] == pytest.approx(0.0, abs=1e-9)
    assert 2.0 <= whole["absolute_low_mm"] <= whole["absolute_mm"] <= whole["absolute_high_mm"] <= 30.0


def test_damaged_takes_count_for_the_relative_error_only() -> None:
    made = [
        takes.hand_made("S9/Greeting", frames=range(5)),
        takes.hand_made("S9/Greeting 1", frames=range(5)),
    ]
    wrist = np.zeros((17, 3))
    wrist[16] = along_x(170)
    s = scored(PROTOCOL, made, [wrist, 0 * wrist])
    assert [s[""][key] for key in ("absolute_mm", "absolute_poses", "poses")] == [0.0, 5, 10]
    assert s[""]["relative_mm"] == pytest.approx(170 / 17 / 2)
    assert pck(s) == [1.0, 1.0, 1.0]
    assert s["right_wrist"]["relative_mm"] == pytest.approx(85.0)
    assert s["right_wrist"]["absolute_mm"] == pytest.approx(0.0)


def test_missing_joints_are_in_no_distance_and_wrong_in_pck() -> None:
    take = takes.hand_made("S9/Eating")
    error = np.zeros((1, 17, 3))
    error[:, :, 0] = 20.0
    error[0, 3] = np.nan
    s = scored(PROTOCOL, [take], [error])
    assert s[""]["absolute_mm"] == pytest.approx(20.0)
    assert s[""]["missing"] == pytest.approx(1 / 17)
    assert pck(s)[0] == pytest.approx(16 / 17)
    assert np.isnan(s["right_ankle"]["absolute_mm"])


def test_averages_of_some_joints_leave_the_others_to_the_table_of_joints() -> None:
    take = takes.hand_made("S9/Eating", frames=range(8))
    error = np.zeros((8, 17, 3))
    error[:, 16], error[:, 10] = along_x(60), along_x(500)
    arms = ("right_wrist", "right_elbow", "left_wrist", "left_elbow")
    s = scored(replace(PROTOCOL, joints=arms), [take], [error])
    assert s[""]["absolute_mm"] == pytest.approx(15.0)
    assert s[""]["every_joint_mm"] == pytest.approx(560 / 17)
    assert (pck(s)[0], s["head"]["absolute_mm"]) == pytest.approx((0.75, 500.0))
    assert s[""]["procrustes_mm"] < 60.0  # the head turns nothing


def test_an_offset_that_turns_with_the_body_is_told_from_other_errors() -> None:
    take = takes.hand_made("S9/Eating", frames=range(50))
    truth = take.truth
    aside = truth[:, 4] - truth[:, 1]
    error = np.zeros((50, 17, 3))
    error[:, 16] = 40.0 * aside / np.linalg.norm(aside, axis=-1, keepdims=True)
    protocol = replace(PROTOCOL, joints=("right_wrist",))
    s = scored(protocol, [take], [error])[""]
    assert (s["absolute_mm"], s["offsets_out_mm"]) == pytest.approx((40.0, 0.0), abs=1e-9)
    error[::2, 16] *= -1
    s = scored(protocol, [take], [error])[""]
    assert s["offsets_out_mm"] == pytest.approx(40.0)


def test_pcp_is_averaged_over_actors() -> None:
    made = [
        takes.hand_made(f"S0/actor{k}", frames=range(300, 300 + n), n_joints=14, action=f"actor{k}")
        for k, n in enumerate((4, 1))
    ]
    for take in made:
        take.truth[:] = np.arange(14)[:, None] * np.array([0.0, 0.0, 300.0])
    one_end = np.zeros((14, 3))
    one_end[6] = along_x(310.0)  # a wrist: mean of the two ends 155 mm > half of 300 mm
    layout = sk.layouts.SHELF14
    s = scored(protocols.get("shelf"), made, [one_end, 0 * one_end], layout=layout)
    assert s["actor0"]["pcp"] == pytest.approx(0.9)
    assert s[""]["pcp"] == pytest.approx((0.9 + 1.0) / 2)  # not (4 · 0.9 + 1.0) / 5
    one_end[6] = along_x(290.0)
    s = scored(protocols.get("shelf"), made, [one_end, one_end], layout=layout)
    assert s[""]["pcp"] == pytest.approx(1.0)


def test_the_error_of_the_acceleration_is_of_three_consecutive_frames() -> None:
    rng = np.random.default_rng(1)
    take = replace(takes.hand_made("S9/Eating", frames=[0, 1, 2, 3, 7, 8, 9, 20]), fps=10.0)
    error = rng.normal(0, 20, (8, 17, 3))
    key = "acceleration_m_s2"
    s = scored(PROTOCOL, [take], [error])
    second = np.concatenate([np.diff(error[:4], n=2, axis=0), np.diff(error[4:7], n=2, axis=0)])
    # mm per frame² are 10² / 1000 m/s² at 10 Hz
    assert s[""][key] == pytest.approx(0.1 * np.linalg.norm(second, axis=-1).mean())
    assert np.isnan(scored(PROTOCOL, [replace(take, fps=None)], [error])[""][key])
    assert np.isnan(scored(replace(PROTOCOL, every=2), [take], [along_x(5)])[""][key])


def test_takes_weigh_by_their_numbers() -> None:
    """Two takes, of mean 1 over 9 numbers and 11 over 1: the means drawn are 1, 2 (one of each) and 11."""
    low, high = mean_interval([9.0, 11.0], [9, 1], level=0.4, resamples=5000)
    assert (low, high) == (2.0, 2.0)
    assert mean_interval([9.0, 11.0], [9, 1], level=0.9, resamples=5000) == (1.0, 11.0)


def human36m(*keys: str, frames=range(200)) -> Dataset:
    made = tuple(takes.hand_made(key, frames=frames) for key in keys)
    return Dataset("human36m", sk.layouts.H36M17, made)


def test_every_64th_frame_of_each_activity_of_s9_and_s11() -> None:
    cases = protocols.get("human36m").cases(human36m("S1/Eating", "S9/Eating", "S9/Eating 1", "S11/Eating"))
    assert [case.take.key for case in cases] == ["S9/Eating", "S9/Eating 1", "S11/Eating"]
    assert all(case.take.frames.tolist() == [0, 64, 128, 192] for case in cases)


@pytest.mark.parametrize(
    ("frames", "kept"),
    [
        (range(0, 640, 64), list(range(0, 640, 64))),  # thinned out before
        (range(0, 200, 5), [0, 65, 130, 195]),  # every 5th: the next behind 0, 64, 128, 192
    ],
)
def test_frames_are_counted_by_their_numbers(frames, kept) -> None:
    (case,) = protocols.get("human36m").cases(human36m("S9/Eating", frames=frames))
    assert case.take.frames.tolist() == kept


def test_damaged_takes_do_not_count_for_the_absolute_error() -> None:
    damaged = ("S9/SittingDown 1", "S9/Waiting 1", "S9/Greeting")
    sound = ("S9/SittingDown", "S9/Waiting", "S9/Greeting 1", "S11/SittingDown 1", "S11/Greeting")
    cases = protocols.get("human36m").cases(human36m(*damaged, *sound))
    assert [case.absolute for case in cases] == [False] * 3 + [True] * 5


def test_the_simulated_set_has_the_numbers_of_the_published_evaluation() -> None:
    data = sk.synthetic.simulate_set("human36m-like")
    made = tuple(replace(takes.hand_made(r.key, frames=r.frames), action=r.action) for r in data.recordings)
    cases = protocols.get("human36m-like").cases(Dataset("human36m-like", data.layout, made))
    counted = sum(len(case.take) for case in cases if case.absolute), sum(len(case.take) for case in cases)
    assert counted == protocols.get("human36m").expected_poses == (2107, 2181)


def seen_by(*names: str):
    """Return a take of three frames whose detections tell the views apart."""
    cameras = sk.synthetic.dome(len(names))
    rig = sk.CameraRig(
        [sk.Camera(c.K, c.R, c.t, size=c.size, name=n) for c, n in zip(cameras, names, strict=True)]
    )
    blank = takes.hand_made("S0/pose1", frames=range(3), rig=rig, n_joints=19, action="pose1")
    detections = np.ones((3, len(rig), 19, 3))
    detections[..., 0] = np.arange(len(rig))[:, None]
    return replace(blank, detections=detections, monocular=np.zeros((3, len(rig), 19, 3)))


def test_panoptic_adds_its_cameras_in_the_paper_s_order() -> None:
    take = seen_by(*(f"00_{n:02d}" for n in (1, 2, 3, 10, 13, 19, 23, 30)))
    data = Dataset("panoptic", sk.layouts.PANOPTIC19, (take,))
    orders = {4: (1, 2, 10, 13), 5: (1, 2, 10, 13, 3), 8: (1, 2, 10, 13, 3, 23, 19, 30)}
    for n_views, numbers in orders.items():
        (case,) = protocols.get("panoptic").with_options(n_views=n_views).cases(data)
        assert case.take.rig.names == tuple(f"00_{n:02d}" for n in numbers)
    (case,) = protocols.get("panoptic").cases(data)
    assert case.take.detections[0, :, 0, 0].tolist() == [0, 1, 3, 4]
    assert case.take.monocular.shape == (3, 4, 19, 3)


@pytest.mark.parametrize(("name", "counted"), [("shelf", 301), ("campus", 121 + 101)])
def test_shelf_and_campus_count_ranges_and_three_actors(name: str, counted: int) -> None:
    made = [
        takes.hand_made(f"S0/actor{k}", frames=range(800), n_joints=14, action=f"actor{k}") for k in range(3)
    ]
    cases = protocols.get(name).cases(Dataset(name, sk.layouts.SHELF14, tuple(made)))
    assert [case.column for case in cases] == ["actor0", "actor1", "actor2"]
    assert len(cases[0].take) == counted
