"""The picture of several people: colours, bars, paths, and people of whom little is known."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.image import imread

from colour_vision import DEFICIENCIES, closest
from people_page import CAMERAS, SKELETON, crowd, nobody, person
from skelsplat import viz
from skelsplat.viz import _style
from skelsplat.viz.people import _widest_gaps, all_frames, spread_out, thinned

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("kind", DEFICIENCIES)
def test_colours_of_people_differ_for_everyone(kind):
    assert closest(_style.PEOPLE, DEFICIENCIES[kind]) > 15


@pytest.fixture
def written(tmp_path, capfd):
    """Write a picture and return its path; nothing may be printed."""

    def write(people, **changes):
        centres = np.array([[-2000.0, 0.0, 1500.0], [2000.0, 0.0, 1500.0]])
        content = {"camera_names": CAMERAS, "centres": centres, "up": UP, "skeleton": SKELETON, "title": "x"}
        data = viz.PeopleData(people, **{**content, **changes})
        path = viz.write_people(tmp_path / "overview.png", data)
        assert capfd.readouterr() == ("", "")
        return path

    return write


def near(path, colour):
    """Return how many pixels of a picture have a colour."""
    image = imread(path)[..., :3]
    assert image.shape[1] == 1400
    wanted = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return int((np.abs(image - wanted).max(axis=-1) < 0.02).sum())


@pytest.mark.painted
def test_every_person_has_a_colour(written):
    image = written(crowd(3))
    for colour in _style.PEOPLE[:3]:
        assert near(image, colour) > 2000
    assert near(image, _style.PEOPLE[3]) < 20


@pytest.mark.painted
def test_bars_are_paler_where_fewer_cameras_see_the_person(written):
    half = np.ones((40, 2), dtype=bool)
    half[20:, 0] = False
    colours = [_style.tint(_style.PEOPLE[0], share) for share in (1.0, 0.5)]
    both = written([person(seen=half)])
    dark, pale = (near(both, colour) for colour in colours)
    assert pale > 1000
    assert abs(dark - pale) / pale < 0.6  # the rest are labels and lines
    assert near(written([person()]), colours[1]) < 0.05 * pale


@pytest.mark.parametrize(
    "people",
    [
        [nobody()],
        [person(), nobody()],
        [person(frames=[7])],
        [person(frames=[3, 4, 900])],
        crowd(16),
        [person("a name that is much too long for its row"), person("$x_1$ <b>")],
    ],
    ids=["nobody", "one and nobody", "one frame", "a gap", "16 people", "names"],
)
def test_any_people_have_a_picture(written, figures, people):
    written(people)
    plan, bars, errors, side = figures[0].axes
    assert len(bars.get_yticks()) == len(people)
    assert bars.get_xlim() == errors.get_xlim()
    for axes in (plan, side):
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        across, up = axes.get_position().size * figures[0].get_size_inches()
        assert (right - left) / across == pytest.approx((high - low) / up)


@pytest.mark.painted
def test_the_name_of_a_camera_is_no_formula(written):
    assert near(written(crowd(1), camera_names=(r"cam $\frac$", "window")), _style.PEOPLE[0]) > 1000


@pytest.mark.painted
def test_a_camera_far_away_does_not_shrink_the_plan(written):
    close, far = (np.array([[-2000.0, 0.0, 1500.0], [x, 0.0, 1500.0]]) for x in (2000.0, 2e6))
    paths = [near(written(crowd(2), centres=centres), _style.PEOPLE[0]) for centres in (close, far)]
    assert paths[1] > 0.8 * paths[0]


def test_the_frame_drawn_has_most_people_with_room_between_them():
    people = crowd(3)
    number, along = _widest_gaps(people, np.eye(3))
    assert 110 <= number < 120  # all three are there
    assert abs(along[0]) > 0.9  # they are apart along x
    together = person("person 1", at=(0.0, 0.0))
    apart = together.refined + np.linspace(0.0, 900.0, 40)[:, None, None] * [1.0, 0.0, 0.0]
    number, _ = _widest_gaps([person(), person("person 1", refined=apart)], np.eye(3))
    assert number == 139


def test_values_are_put_on_the_frames_of_all():
    people = crowd(3)
    frames = all_frames(people)
    np.testing.assert_array_equal(frames, np.arange(100, 140))
    views = spread_out(frames, people[1].frames, people[1].views, -1)
    np.testing.assert_array_equal(views, [-1] * 10 + [2] * 30)


def test_the_middle_is_that_of_joints_that_are_ok():
    pose, status = person().refined.copy(), person().status.copy()
    pose[0, 1], status[0, 1] = 1e5, "weak"
    status[1] = "weak"
    middle = person(refined=pose, status=status).middle
    np.testing.assert_allclose(middle[0], [0.0, -75.0, 675.0])
    np.testing.assert_allclose(middle[1], np.median(pose[1], axis=0))
    assert np.isnan(nobody().middle).all()


def test_long_recordings_are_thinned_out_alike():
    people = [person("person 0", range(100, 10_100)), person("person 1", range(5001, 5002))]
    first, *others = thinned(people, 3000)
    assert len(first.frames) == 2500
    assert set(np.diff(first.frames)) == {4}
    np.testing.assert_array_equal(first.refined, people[0].refined[::4])
    assert [one.frames.tolist() for one in others] == [[5001]]  # between two that are kept
    assert thinned(people, 20_000) == people
