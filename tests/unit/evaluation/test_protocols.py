"""Which views, frames and takes of each benchmark count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
import takes
from skelsplat.datasets import Dataset
from skelsplat.evaluation import protocols


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


@pytest.mark.parametrize(("name", "choice"), [("panoptic", {"n_views": 3}), ("human36m", {"every": 0})])
def test_choices_that_are_none(name: str, choice) -> None:
    with pytest.raises(sk.InvalidInputError, match=r"views|every"):
        protocols.get(name).with_options(**choice)
