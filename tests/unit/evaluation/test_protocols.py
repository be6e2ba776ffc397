"""Which views, frames and takes of each benchmark count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
import takes
from skelsplat.datasets import Dataset
from skelsplat.evaluation import protocols


def human36m(*keys: str, frames: int = 200) -> Dataset:
    made = tuple(takes.hand_made(key, frames=range(frames)) for key in keys)
    return Dataset("human36m", sk.layouts.H36M17, made)


def test_every_64th_frame_of_each_activity_of_s9_and_s11() -> None:
    cases = protocols.get("human36m").cases(human36m("S1/Eating", "S9/Eating", "S9/Eating 1", "S11/Eating"))
    assert [case.take.key for case in cases] == ["S9/Eating", "S9/Eating 1", "S11/Eating"]
    assert all(case.take.frames.tolist() == [0, 64, 128, 192] for case in cases)


@pytest.mark.parametrize(
    ("frames", "kept"),
    [
        (range(0, 640, 64), list(range(0, 640, 64))),  # thinned out before
        (range(1, 130), [1, 65, 129]),  # counted from the first
        (range(0, 200, 5), [0, 65, 130, 195]),  # every 5th: the next behind 0, 64, 128, 192
        ([0, 1, 2, 70, 71, 200], [0, 70, 200]),
    ],
)
def test_frames_are_counted_by_their_numbers(frames, kept) -> None:
    data = Dataset("human36m", sk.layouts.H36M17, (takes.hand_made("S9/Eating", frames=frames),))
    (case,) = protocols.get("human36m").cases(data)
    assert case.take.frames.tolist() == kept


def test_damaged_takes_do_not_count_for_the_absolute_error() -> None:
    keys = [
        *("S9/SittingDown 1", "S9/Waiting 1", "S9/Greeting"),
        *(
            "S9/SittingDown",
            "S9/Waiting",
            "S9/Greeting 1",
            "S11/SittingDown 1",
            "S11/Waiting 1",
            "S11/Greeting",
        ),
    ]
    cases = protocols.get("human36m").cases(human36m(*keys))
    assert [case.absolute for case in cases] == [False] * 3 + [True] * 6
    by_subaction = human36m("S9/SittingDown-2", "S9/Waiting-1", "S9/Greeting-2", "S9/SittingDown-1")
    by_subaction = replace(
        by_subaction,
        takes=tuple(replace(take, action=take.action.rstrip("-12")) for take in by_subaction),
    )
    assert [case.absolute for case in protocols.get("human36m").cases(by_subaction)] == [False] * 3 + [True]


def test_the_simulated_set_has_the_numbers_of_the_published_evaluation() -> None:
    data = sk.synthetic.simulate_set("human36m-like")
    made = tuple(replace(takes.hand_made(r.key, frames=r.frames), action=r.action) for r in data.recordings)
    cases = protocols.get("human36m-like").cases(Dataset("human36m-like", data.layout, made))
    counted = sum(len(case.take) for case in cases if case.absolute), sum(len(case.take) for case in cases)
    assert counted == protocols.get("human36m").expected_poses == (2107, 2181)


def named_rig(*names: str) -> sk.CameraRig:
    cameras = sk.synthetic.dome(len(names))
    return sk.CameraRig(
        [sk.Camera(c.K, c.R, c.t, size=c.size, name=n) for c, n in zip(cameras, names, strict=True)]
    )


def seen_by(rig: sk.CameraRig, key: str = "S0/pose1", frames: int = 3):
    blank = takes.hand_made(key, frames=range(frames), rig=rig, n_joints=19, action=key.split("/")[1])
    detections = np.ones((frames, len(rig), 19, 3))
    detections[..., 0] = np.arange(len(rig))[:, None]  # tells views apart
    return replace(blank, detections=detections, monocular=np.zeros((frames, len(rig), 19, 3)))


def test_panoptic_adds_its_cameras_in_the_paper_s_order() -> None:
    take = seen_by(named_rig(*(f"00_{n:02d}" for n in (1, 2, 3, 10, 13, 19, 23, 30))))
    data = Dataset("panoptic", sk.layouts.PANOPTIC19, (take,))
    orders = {4: (1, 2, 10, 13), 5: (1, 2, 10, 13, 3), 8: (1, 2, 10, 13, 3, 23, 19, 30)}
    for n_views, numbers in orders.items():
        (case,) = protocols.get("panoptic").with_options(n_views=n_views).cases(data)
        assert case.take.rig.names == tuple(f"00_{n:02d}" for n in numbers)
    (case,) = protocols.get("panoptic").cases(data)
    assert case.take.rig.names == ("00_01", "00_02", "00_10", "00_13")
    assert case.take.detections[0, :, 0, 0].tolist() == [0, 1, 3, 4]
    assert case.take.monocular.shape == (3, 4, 19, 3)


def test_occlusion_person_has_four_views_or_all() -> None:
    take = seen_by(named_rig(*(f"cam{k}" for k in range(8))))
    data = Dataset("occlusion-person", sk.layouts.PANOPTIC19, (take,))
    protocol = protocols.get("occlusion-person")
    assert len(protocol.cases(data)[0].take.rig) == 8
    assert protocol.with_options(n_views=4).cases(data)[0].take.rig.names == ("cam1", "cam3", "cam5", "cam7")


@pytest.mark.parametrize(
    ("name", "first_and_last"),
    [("shelf", [(300, 600)]), ("campus", [(350, 470), (650, 750)])],
)
def test_shelf_and_campus_count_ranges_and_three_actors(name: str, first_and_last) -> None:
    made = tuple(
        takes.hand_made(f"S0/actor{k}", frames=range(0, 800), n_joints=14, action=f"actor{k}")
        for k in range(3)
    )
    protocol = protocols.get(name)
    cases = protocol.cases(Dataset(name, sk.layouts.SHELF14, made))
    assert [case.column for case in cases] == ["actor0", "actor1", "actor2"]
    expected = [frame for first, last in first_and_last for frame in range(first, last + 1)]
    assert cases[0].take.frames.tolist() == expected
    assert len(protocol.parts) == 10


@pytest.mark.parametrize(
    ("name", "choice", "message"),
    [
        ("panoptic", {"n_views": 3}, "views: expected one of 4, 5, 6, 7, 8 for panoptic, got 3"),
        ("human36m", {"n_views": 3}, r"views: expected one of no number \(all views are used\)"),
        ("human36m", {"every": 0}, "every: expected an integer >= 1, got 0"),
    ],
)
def test_choices_that_are_none(name: str, choice, message: str) -> None:
    with pytest.raises(sk.InvalidInputError, match=message):
        protocols.get(name).with_options(**choice)
