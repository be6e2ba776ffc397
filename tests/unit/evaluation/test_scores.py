"""Figures by hand: errors that are known because they were put there."""

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
