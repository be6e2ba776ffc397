"""Telling people apart."""

from __future__ import annotations

import numpy as np
import pytest

from skelsplat import synthetic
from skelsplat.association import separate_people, take_people
from two_people import FRAMES, LAYOUT, crossing, seen, shuffled

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
