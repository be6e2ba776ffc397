"""People meet as asked, near each other but not inside each other, and walk as people do."""

from __future__ import annotations

import numpy as np
import pytest

from skelsplat import InvalidInputError, synthetic
from skelsplat.synthetic.crowds import ROOM_MM

FPS = 30.0
WRISTS = [13, 16]


def nearest(people):
    """Least distance of two pelvises, mm, and the frame."""
    gap = np.linalg.norm(people[0, :, 0, :2] - people[1, :, 0, :2], axis=-1)
    return np.nanmin(gap), int(np.nanargmin(gap))


@pytest.mark.parametrize("kind", synthetic.meeting_names)
@pytest.mark.parametrize("count", [1, 5])
def test_people_stay_in_the_room_on_the_floor_and_walk_at_a_human_pace(kind, count):
    people = synthetic.crowd(count, 300, fps=FPS, meetings=[kind], seed=count)
    assert people.shape == (count, 300, 17, 3)
    pelvis = people[:, :, 0]
    assert np.nanmax(np.linalg.norm(pelvis[..., :2], axis=-1)) < ROOM_MM + 100.0
    assert np.nanmax(np.linalg.norm(np.diff(pelvis, axis=1), axis=-1)) * FPS < 3000.0
    feet = people[..., 2].min(axis=2)
    assert np.nanmin(feet) > 30.0
    assert np.nanmax(feet) < 130.0
    assert np.isnan(people).any() == (kind == "leave" and count > 1)


@pytest.mark.parametrize("seed", range(2))
def test_people_who_cross_pass_at_arms_length(seed):
    gap, frame = nearest(synthetic.crowd(2, 150, fps=FPS, meetings=["cross"], seed=seed))
    assert 295.0 < gap < 610.0
    assert frame == pytest.approx(2.5 * FPS, abs=2)


def test_one_stands_behind_the_other_seen_from_a_camera():
    eyes = np.array([[4500.0, 0.0, 1500.0]])
    people = synthetic.crowd(2, 150, fps=FPS, meetings=["behind"], eyes=eyes, seed=2)
    towards = eyes[0, :2] - people[:, 75, 0, :2]
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    assert towards[0] @ towards[1] > np.cos(np.deg2rad(1.0))


@pytest.mark.parametrize(
    ("arguments", "argument"),
    [({"n_people": 0}, "n_people, n_frames"), ({"meetings": ["dance"]}, "meetings")],
)
def test_what_makes_no_crowd_is_refused(arguments, argument):
    with pytest.raises(InvalidInputError) as caught:
        synthetic.crowd(**{"n_people": 2, "n_frames": 60, **arguments})
    assert caught.value.argument == argument
