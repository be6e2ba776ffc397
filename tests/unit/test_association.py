"""Following one person by agreement between the views."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
import two_people
from skelsplat import synthetic
from skelsplat.association import choose_person, separate_people, take_people
from skelsplat.synthetic import look_at

FRAMES, VIEWS, JOINTS = 6, 4, 12
K = [[1000.0, 0.0, 500.0], [0.0, 1000.0, 500.0], [0.0, 0.0, 1.0]]
PLACES = [5.0 * np.array([np.cos(a), np.sin(a), 0.0]) for a in np.radians((0, 80, 170, 250))]
RIG = sk.CameraRig(
    [sk.Camera(K, *look_at(place, np.zeros(3)), size=(1000, 1000)) for place in PLACES], unit="m"
)


def walk(place, step=(0.05, 0.0, 0.0)):
    """Points (T, K, 3) in a box of a person's size, metres, around `place`, which moves by `step`."""
    body = np.random.default_rng(5).uniform([-0.3, -0.3, -0.9], [0.3, 0.3, 0.9], (JOINTS, 3))
    return np.asarray(place) + body + np.arange(FRAMES)[:, None, None] * np.asarray(step)


def seen(points, views=range(VIEWS), noise_px=2.0):
    """Make the detections (T, M, K, 3) of one person; NaN outside `views`."""
    pixels = np.moveaxis(sk.project(points, RIG), 0, 1)
    pixels = pixels + np.random.default_rng(1).normal(scale=noise_px, size=pixels.shape)
    found = np.concatenate([pixels, np.full((*pixels.shape[:-1], 1), 0.9)], axis=-1)
    found[:, [view for view in range(VIEWS) if view not in views]] = np.nan
    return found


def crowd(*detections):
    """People (T, M, P, K, 3) from detections (T, M, K, 3) each."""
    return np.stack(detections, axis=2)


def shuffled(people):
    """People in another order in every view and frame, and where each went (T, M, P)."""
    order = np.argsort(np.random.default_rng(2).random(people.shape[:3]), axis=2)
    return np.take_along_axis(people, order[..., None, None], axis=2), np.argsort(order, axis=2)


def chosen(*detections, **options):
    return choose_person(crowd(*detections), RIG, **options)


def test_a_bystander_in_two_views_is_left_out():
    person, bystander = seen(walk((0, 0, 0))), seen(walk((0.9, 1.2, 0)), views=(0, 1))
    people, place = shuffled(crowd(person, bystander))
    detections, index = choose_person(people, RIG)
    np.testing.assert_array_equal(index, place[:, :, 0])
    np.testing.assert_array_equal(detections, person)


def test_someone_else_alone_in_a_view_is_not_taken_for_the_person():
    person = seen(walk((0, 0, 0)), views=(0, 1, 2))
    person[:, 3] = seen(walk((0, -1.5, 0)))[:, 3]
    detections, index = chosen(person)
    np.testing.assert_array_equal(index, np.tile([0, 0, 0, -1], (FRAMES, 1)))
    assert np.isnan(detections[:, 3]).all()


def test_the_same_person_is_followed_when_two_are_seen_alike():
    one, two = walk((-0.8, 0, 0)), walk((0.8, 0.2, 0), step=(-0.05, 0.0, 0.0))
    people, place = shuffled(crowd(seen(one, noise_px=4.0), seen(two, noise_px=4.0)))
    _, index = choose_person(people, RIG)
    assert [np.array_equal(index, place[:, :, p]) for p in (0, 1)].count(True) == 1


def test_a_view_lost_for_one_frame_does_not_change_the_person():
    person, other = seen(walk((-0.8, 0, 0))), seen(walk((0.8, 0.2, 0)), views=(0, 1, 2))
    person[3, 2:] = np.nan
    expected = np.zeros((FRAMES, VIEWS), dtype=int)
    expected[3, 2:] = -1
    np.testing.assert_array_equal(chosen(person, other)[1], expected)


def test_joints_of_low_confidence_do_not_take_part_but_are_returned():
    person = seen(walk((0, 0, 0)))
    person[:, 1, :8, :2] += 400.0  # two thirds of the joints, so that the median would go with them
    person[:, 1, :8, 2] = 0.1
    detections, index = chosen(person)
    np.testing.assert_array_equal(index, 0)
    np.testing.assert_array_equal(detections, person)


def test_a_few_joints_at_the_right_place_are_those_of_the_person():
    person = seen(walk((0, 0, 0)))
    person[:, 3, 3:] = np.nan
    np.testing.assert_array_equal(chosen(person)[1], 0)
    person[:, 3, :3, :2] += 300.0
    np.testing.assert_array_equal(chosen(person)[1], np.tile([0, 0, 0, -1], (FRAMES, 1)))


@pytest.mark.parametrize("larger", [0, 1])
def test_of_two_who_fit_equally_well_the_larger_is_chosen(larger):
    still = (0.0, 0.0, 0.0)
    sizes = [1.0 if place == larger else 0.6 for place in (0, 1)]
    both = [size * walk((0, 0, 0), still) + [x, 0, 0] for size, x in zip(sizes, (-0.8, 0.8), strict=True)]
    np.testing.assert_array_equal(chosen(*(seen(points, noise_px=0.0) for points in both))[1], larger)


def test_a_view_with_exchanged_sides_is_the_same_person_if_the_layout_is_known():
    """Joints 0 to 5 are left, 6 to 11 their right twins, half a metre apart."""
    names = [f"left_{k}" for k in range(6)] + [f"right_{k}" for k in range(6)]
    layout = sk.Layout("pairs", names, left_right=[(k, k + 6) for k in range(6)])
    points = walk((0.0, 0.0, 0.0))
    points[:, :6] -= [0.25, 0.25, 0.0]
    points[:, 6:] += [0.25, 0.25, 0.0]
    person = seen(points)
    person[:, 2] = person[:, 2][:, [*range(6, 12), *range(6)]]
    assert (chosen(person)[1][:, 2] == -1).all()
    np.testing.assert_array_equal(chosen(person, layout=layout)[1], 0)


# several people


ROOM = synthetic.human36m_like()


@pytest.fixture(scope="module")
def people():
    return two_people.seen(two_people.crossing(), ROOM)


def test_people_are_told_apart(people):
    mixed = two_people.shuffled(people)
    index = separate_people(mixed, ROOM, layout=two_people.LAYOUT)
    assert index.shape == (2, two_people.FRAMES, 4)
    apart = [take_people(mixed, found) for found in index]
    first = int(not np.array_equal(apart[0], people[:, :, 0]))
    for found, own in zip(apart, (people[:, :, first], people[:, :, 1 - first]), strict=True):
        np.testing.assert_array_equal(found, own)


def test_a_body_detected_twice_is_one_person(people):
    twice = np.stack([people[:, :, 0], people[:, :, 0] + [3.0, -2.0, 0.0]], axis=2)
    assert len(separate_people(twice, ROOM)) == 1
