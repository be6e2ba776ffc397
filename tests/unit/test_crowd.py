"""Telling people apart, and the numbers of a choice that mixes them."""

from __future__ import annotations

import numpy as np
import pytest

from skelsplat import association, synthetic
from skelsplat.association import separate_people, take_people
from skelsplat.findings import FindingWarning
from skelsplat.run.people import limb_spread
from skelsplat.run.person import sampled
from two_people import FRAMES, LAYOUT, crossing, crowd_of, seen, shuffled

RIG = synthetic.human36m_like()


@pytest.fixture(scope="module")
def people():
    return seen(crossing(), RIG)


def test_people_are_told_apart(people):
    mixed = shuffled(people)
    index = separate_people(mixed, RIG, layout=LAYOUT)
    assert index.shape == (2, FRAMES, 4)
    apart = [take_people(mixed, found) for found in index]
    first = int(not np.array_equal(apart[0], people[:, :, 0]))
    for found, own in zip(apart, (people[:, :, first], people[:, :, 1 - first]), strict=True):
        np.testing.assert_array_equal(found, own)


def test_a_body_detected_twice_is_one_person(people):
    twice = np.stack([people[:, :, 0], people[:, :, 0] + [3.0, -2.0, 0.0]], axis=2)
    assert len(separate_people(twice, RIG)) == 1


def test_too_many_people_to_compare_are_said_once_with_their_number(people, monkeypatch):
    bounded = association.people_chosen

    def cut(*given, **options):
        return bounded(*given, **options)[0], np.arange(len(given[1])) < 5

    monkeypatch.setattr(association, "people_chosen", cut)
    for person in ("consistent", "largest"):
        with pytest.warns(FindingWarning, match="In 5 frames") as told:
            assert crowd_of(people, RIG, person).visible == 2
        assert [remedy.setting for one in told for remedy in one.message.finding.remedy] == ["without"]


@pytest.mark.parametrize("frames", [1, 2, 200, 201, 5000])
def test_a_long_recording_is_sampled_in_pairs_of_neighbours(frames):
    steps = sampled(frames)
    assert len(steps) == len(set(steps.tolist())) <= 200
    assert steps[0] == 0
    assert steps[-1] == frames - 1
    if frames > 200:
        assert (np.diff(steps) == 1).sum() >= 99


def test_two_people_are_seen_together_in_all_frames(people):
    crowd = crowd_of(people, RIG, "1")
    assert (crowd.visible, crowd.together) == (2, 1.0)


LIMBS = [(0, 1), (1, 2)]


def spread_of(lengths, sigma=10.0):
    """Of a body whose first limb has these lengths and its second one 400."""
    pose = np.zeros((len(lengths), 3, 3))
    pose[:, 1, 0] = lengths
    pose[:, 2] = pose[:, 1] + [0.0, 400.0, 0.0]
    uncertainty = np.broadcast_to(np.eye(3) * sigma**2, (*pose.shape, 3))
    return limb_spread(pose, uncertainty, np.ones(pose.shape[:2], dtype=bool), LIMBS)


def test_a_length_is_off_beyond_four_standard_deviations():
    # √(2·10² + (0.05·400)²) = 24.49: four are 98
    lengths = np.full(20, 400.0)
    lengths[3], lengths[7] = 497.0, 303.0
    assert spread_of(lengths).off == 0.0
    lengths[3], lengths[7] = 499.0, 301.0
    assert spread_of(lengths).off == 2 / 40
    assert spread_of(lengths, sigma=12.0).off == 0.0


def test_error_bars_count_along_the_limb():
    pose = np.zeros((20, 2, 3))
    pose[:, 1, 0] = 400.0
    pose[5, 1, 0] = 520.0
    known = np.ones((20, 2), dtype=bool)
    for axis, off in ((0, 0.0), (1, 1 / 20)):
        uncertainty = np.zeros((20, 2, 3, 3))
        uncertainty[..., axis, axis] = 30.0**2
        assert limb_spread(pose, uncertainty, known, [(0, 1)]).off == off
