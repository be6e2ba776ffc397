"""Following one person by agreement between the views."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.association import choose_person
from skelsplat.findings import FindingWarning

RNG_SEED = 5
FRAMES, VIEWS, JOINTS = 6, 4, 12
K = [[1000.0, 0.0, 500.0], [0.0, 1000.0, 500.0], [0.0, 0.0, 1.0]]


def camera(angle_deg, distance):
    """Place a camera at `distance` from the origin, looking at it; its y axis points down (world −z)."""
    angle = np.radians(angle_deg)
    forward = -np.array([np.cos(angle), np.sin(angle), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    R = np.stack([np.cross(down, forward), down, forward])
    return sk.Camera(K, R, [0.0, 0.0, distance], size=(1000, 1000))


@pytest.fixture
def rig():
    return sk.CameraRig([camera(angle, 5.0) for angle in (0, 80, 170, 250)], unit="m")


def body(place):
    """Points (K, 3) in a box of a person's size, metres, around `place`."""
    rng = np.random.default_rng(RNG_SEED)
    return np.asarray(place) + rng.uniform([-0.3, -0.3, -0.9], [0.3, 0.3, 0.9], (JOINTS, 3))


def walk(place, step=(0.05, 0.0, 0.0)):
    """Points (T, K, 3) of someone who moves by `step` every frame."""
    return body(place) + np.arange(FRAMES)[:, None, None] * np.asarray(step)


def seen(points, rig, views=range(VIEWS), noise_px=2.0):
    """Make the detections (T, M, K, 3) of one person; NaN outside `views`."""
    pixels = np.moveaxis(sk.project(points, rig), 0, 1)
    pixels = pixels + np.random.default_rng(1).normal(scale=noise_px, size=pixels.shape)
    found = np.concatenate([pixels, np.full((*pixels.shape[:-1], 1), 0.9)], axis=-1)
    hidden = [view for view in range(VIEWS) if view not in views]
    found[:, hidden] = np.nan
    return found


def crowd(*detections):
    """People (T, M, P, K, 3) from detections (T, M, K, 3) each."""
    return np.stack(detections, axis=2)


def shuffled(people):
    """People in another order in every view and frame, and where each went (T, M, P)."""
    order = np.argsort(np.random.default_rng(2).random(people.shape[:3]), axis=2)
    return np.take_along_axis(people, order[..., None, None], axis=2), np.argsort(order, axis=2)


def test_a_bystander_in_two_views_is_left_out(rig):
    person, bystander = seen(walk((0, 0, 0)), rig), seen(walk((0.9, 1.2, 0)), rig, views=(0, 1))
    people, place = shuffled(crowd(person, bystander))
    detections, index = choose_person(people, rig)
    np.testing.assert_array_equal(index, place[:, :, 0])
    np.testing.assert_array_equal(detections, person)


def test_someone_else_alone_in_a_view_is_not_taken_for_the_person(rig):
    person = seen(walk((0, 0, 0)), rig, views=(0, 1, 2))
    person[:, 3] = seen(walk((0, -1.5, 0)), rig)[:, 3]
    detections, index = choose_person(crowd(person), rig)
    np.testing.assert_array_equal(index, np.tile([0, 0, 0, -1], (FRAMES, 1)))
    assert np.isnan(detections[:, 3]).all()


def test_the_same_person_is_followed_when_two_are_seen_alike(rig):
    one, two = walk((-0.8, 0, 0)), walk((0.8, 0.2, 0), step=(-0.05, 0.0, 0.0))
    people, place = shuffled(crowd(seen(one, rig, noise_px=4.0), seen(two, rig, noise_px=4.0)))
    _, index = choose_person(people, rig)
    followed = [np.array_equal(index, place[:, :, p]) for p in (0, 1)]
    assert followed.count(True) == 1


def test_a_view_lost_for_one_frame_does_not_change_the_person(rig):
    chosen, other = seen(walk((-0.8, 0, 0)), rig), seen(walk((0.8, 0.2, 0)), rig, views=(0, 1, 2))
    chosen[3, 2:] = np.nan
    people = crowd(chosen, other)
    _, index = choose_person(people, rig)
    expected = np.zeros((FRAMES, VIEWS), dtype=int)
    expected[3, 2:] = -1
    np.testing.assert_array_equal(index, expected)


def test_joints_of_low_confidence_do_not_take_part_but_are_returned(rig):
    person = seen(walk((0, 0, 0)), rig)
    person[:, 1, :8, :2] += 400.0  # two thirds of the joints, so that the median would go with them
    person[:, 1, :8, 2] = 0.1
    detections, index = choose_person(crowd(person), rig)
    np.testing.assert_array_equal(index, 0)
    np.testing.assert_array_equal(detections, person)


def test_too_few_joints_are_no_evidence(rig):
    person = seen(walk((0, 0, 0)), rig)
    person[:, 3, 3:] = np.nan
    np.testing.assert_array_equal(choose_person(crowd(person), rig)[1], np.tile([0, 0, 0, -1], (FRAMES, 1)))


@pytest.mark.parametrize("larger", [0, 1])
def test_of_two_who_fit_equally_well_the_larger_is_chosen(rig, larger):
    still = (0.0, 0.0, 0.0)
    sizes = [1.0 if place == larger else 0.6 for place in (0, 1)]
    both = [size * walk((0, 0, 0), still) + [x, 0, 0] for size, x in zip(sizes, (-0.8, 0.8), strict=True)]
    people = crowd(*(seen(points, rig, noise_px=0.0) for points in both))
    np.testing.assert_array_equal(choose_person(people, rig)[1], larger)


def test_frames_with_fewer_than_two_views_have_nobody(rig):
    person = seen(walk((0, 0, 0)), rig)
    person[2, 1:] = np.nan
    person[4] = np.nan
    detections, index = choose_person(crowd(person), rig)
    np.testing.assert_array_equal(index[[2, 4]], -1)
    assert np.isnan(detections[[2, 4]]).all()
    np.testing.assert_array_equal(index[[0, 1, 3, 5]], 0)


@pytest.mark.parametrize(
    "shape",
    [
        (FRAMES, 3, 1, JOINTS, 3),
        (FRAMES, VIEWS, 1, JOINTS, 2),
        (FRAMES, VIEWS, JOINTS, 3),
        (FRAMES, VIEWS, 0, JOINTS, 3),
    ],
)
def test_people_of_a_wrong_shape(rig, shape):
    with pytest.raises(sk.InvalidInputError, match="people: "):
        choose_person(np.zeros(shape), rig)


def test_a_view_with_exchanged_sides_is_the_same_person_if_the_layout_is_known(rig):
    """Joints 0 to 5 are left, 6 to 11 their right twins, half a metre apart."""
    names = [f"left_{k}" for k in range(6)] + [f"right_{k}" for k in range(6)]
    layout = sk.Layout("pairs", names, left_right=[(k, k + 6) for k in range(6)])
    points = walk((0.0, 0.0, 0.0))
    points[:, :6] -= [0.25, 0.25, 0.0]
    points[:, 6:] += [0.25, 0.25, 0.0]
    person = seen(points, rig)
    person[:, 2] = person[:, 2][:, [*range(6, 12), *range(6)]]
    assert (choose_person(crowd(person), rig)[1][:, 2] == -1).all()
    np.testing.assert_array_equal(choose_person(crowd(person), rig, layout=layout)[1], 0)


def test_too_many_people_to_compare_are_said(rig, monkeypatch):
    """The search is bounded by work (tests/choice.rs in the core); what it then says is tested here."""
    people = crowd(seen(walk([0.0, 0.0, 1.0]), rig), seen(walk([1.0, 0.0, 1.0]), rig))

    def cut(*_given, **_options):
        return np.zeros((FRAMES, VIEWS), dtype=np.int64), np.arange(FRAMES) < 2

    monkeypatch.setattr("skelsplat.association.people_chosen", cut)
    with pytest.warns(FindingWarning) as told:
        _, index = choose_person(people, rig)
    assert [one.message.finding.kind for one in told] == ["people_uncompared"]
    assert (index == 0).all()
