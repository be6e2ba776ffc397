"""The figures for the screen: size, labels, what is drawn where, and files written whole or not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, PathCollection
from matplotlib.image import imread

from people_page import CAMERAS, crowd, person
from skelsplat import viz
from skelsplat.viz import _style

UP = np.array([0.0, 0.0, 1.0])
# hip left, hip right, head: a person who looks along +x, left is +y
BODY = np.array([[0.0, 150.0, 900.0], [0.0, -150.0, 900.0], [20.0, 0.0, 1700.0]])
SKELETON = viz.Skeleton(limbs=((0, 1), (0, 2), (1, 2)), left_right=((0, 1),))
T, M, N = 4, 2, 3


def overview_data(frame=2, **changes):
    """Build the data; poses in mm, error bars of 10, 20 and 30 mm along x, y and z."""
    after = np.repeat(BODY[None], T, axis=0)
    rng = np.random.default_rng(0)
    data = {
        "before": after + 30.0,
        "after": after,
        "error_bar": np.broadcast_to(np.diag([100.0, 400.0, 900.0]), (T, N, 3, 3)),
        "status": np.full((T, N), "ok", dtype="<U10"),
        "up": UP,
        "frame": frame,
        "start": "plain triangulation",
        "error_before": rng.uniform(5, 20, (T, M, N)),
        "error_after": rng.uniform(1, 8, (T, M, N)),
        "camera_names": ("door", "window"),
        "panels": [],
        "caption": "Frame 2",
    }
    return viz.OverviewData(**{**data, **changes})


def camera_panel(name="door", **changes):
    """Three joints, of which the second is rejected and the third not detected."""
    panel = {
        "name": name,
        "size": (300, 200),
        "detections": np.array([[100.0, 80.0], [140.0, 120.0], [np.nan, np.nan]]),
        "reprojection": np.array([[102.0, 81.0], [111.0, 118.0], [120.0, 100.0]]),
        "covariances": np.broadcast_to(np.diag([16.0, 4.0]), (N, 2, 2)),
        "rejected": np.array([False, True, False]),
        "swapped": np.zeros(N, dtype=bool),
    }
    return viz.CameraPanel(**{**panel, **changes})


def offsets(axes, k):
    """Return the points of the k-th scatter of an axes."""
    return np.asarray([c for c in axes.collections if isinstance(c, PathCollection)][k].get_offsets())


def texts(axes):
    return [axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()]


def overview(folder, data=None, skeleton=SKELETON):
    return viz.write_overview(folder / "o.png", data or overview_data(), skeleton=skeleton)


@pytest.mark.painted
def test_overview_has_two_views_and_the_errors(tmp_path, figures):
    image = imread(overview(tmp_path))
    assert image.shape[1] == 1400
    for part in np.array_split(image[..., :3], 3, axis=1):
        assert part.std() > 0.02  # a white third has 0
    front, side, cameras, spread = figures[0].axes
    assert texts(front) == ["front view", "to the body's left [mm]", "height [mm]"]
    assert texts(side)[:2] == ["side view (from the right)", "to the body's front [mm]"]
    assert "[px]" in cameras.get_xlabel()
    assert "[px]" in spread.get_xlabel()
    assert [label.get_text() for label in cameras.get_yticklabels()] == ["door", "window"]
    scales = [axes.bbox.width / np.ptp(axes.get_xlim()) for axes in (front, side)]
    heights = [axes.bbox.height / np.ptp(axes.get_ylim()) for axes in (front, side)]
    np.testing.assert_allclose([*scales, *heights], scales[0], rtol=0.02)  # of a layout in whole pixels


def test_joints_and_ellipses_lie_where_they_are_measured(tmp_path, figures):
    status = np.full((T, N), "ok", dtype="<U10")
    status[2, 1] = "weak"
    overview(tmp_path, overview_data(status=status))
    front, side = figures[0].axes[:2]
    joints = offsets(front, 1)
    np.testing.assert_allclose(joints[:, 0] - joints[2, 0], [150.0, -150.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(joints[:, 1], [900.0, 900.0, 1700.0], atol=1e-9)
    assert np.ptp(offsets(side, 1)[:, 0]) == pytest.approx(20.0)
    for axes, across in ((front, 20.0), (side, 10.0)):
        (drawn,) = [c for c in axes.collections if isinstance(c, EllipseCollection)]
        np.testing.assert_allclose(drawn.get_offsets(), offsets(axes, 1))
        if hasattr(drawn, "get_widths"):  # Matplotlib 3.9
            sizes = np.sort([drawn.get_widths(), drawn.get_heights()], axis=0).T
            np.testing.assert_allclose(
                sizes, [[4 * across, 4 * 30.0]] * N
            )  # two standard deviations each way
    faces = [c for c in front.collections if isinstance(c, PathCollection)][1].get_facecolors()
    assert [face.tolist() == [1.0] * 4 for face in faces] == [False, True, False]


def test_views_are_front_and_side_only_where_the_vertical_and_the_heading_are_known(tmp_path, figures):
    overview(tmp_path, replace(overview_data(), up_known=False))
    alike = np.repeat(BODY[None], T, axis=0)
    alike[:, 1] = alike[:, 0]  # hips in one place: no left and right
    overview(tmp_path, overview_data(after=alike))
    for figure, height in zip(figures, ("z [mm]", "height [mm]"), strict=True):
        first, second = figure.axes[:2]
        assert texts(first) == ["view 1", "widest direction [mm]", height]
        assert texts(second)[:2] == ["view 2", "across it [mm]"]


def test_cameras_show_rejected_and_exchanged_detections(tmp_path, figures):
    panels = [camera_panel(), camera_panel("window", swapped=np.array([True, False, False]))]
    overview(tmp_path, overview_data(panels=panels))
    door, window = figures[0].axes[4:]
    assert [texts(one)[0] for one in (door, window)] == ["door: 1 of 2 rejected", "window: 1 of 2 rejected"]
    taken, rejected, swapped = (offsets(door, k) for k in range(3))
    np.testing.assert_array_equal(taken[np.isfinite(taken).all(axis=1)], [[100.0, 80.0]])
    np.testing.assert_array_equal(rejected, [[140.0, 120.0]])
    assert len(swapped) == 0
    np.testing.assert_array_equal(offsets(window, 2), [[100.0, 80.0]])
    lines = [line.get_xydata() for line in door.lines if line.get_color() == _style.REJECTED]
    np.testing.assert_array_equal(lines, [[[140.0, 120.0], [111.0, 118.0]]])
    assert door.get_ylim()[0] > door.get_ylim()[1]  # v grows downwards


def test_nothing_on_an_overview_overlaps(tmp_path, figures):
    status = np.full((T, N), "ok", dtype="<U10")
    status[2] = ["weak", "filled", "unobserved"]
    panels = [camera_panel(swapped=np.array([True, False, False]))] * 8
    overview(tmp_path, overview_data(status=status, panels=panels))
    (figure,) = figures
    figure.draw_without_rendering()
    legends = [legend for part in figure.subfigs for legend in part.legends]
    boxes = [one.get_window_extent() for one in legends] + [axes.get_tightbbox() for axes in figure.axes]
    for k, one in enumerate(boxes[: len(legends)]):
        assert 0 <= one.x0 < one.x1 <= figure.bbox.x1
        assert not any(one.overlaps(other) for j, other in enumerate(boxes) if j != k)


@pytest.fixture
def written(tmp_path, capfd):
    """Write a picture of people and return its path; nothing may be printed."""

    def write(people, **changes):
        centres = np.array([[-2000.0, 0.0, 1500.0], [2000.0, 0.0, 1500.0]])
        content = {"camera_names": CAMERAS, "centres": centres, "up": UP, "skeleton": SKELETON, "title": "x"}
        path = viz.write_people(tmp_path / "overview.png", viz.PeopleData(people, **{**content, **changes}))
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
def test_every_person_has_a_colour_and_is_pale_where_fewer_cameras_see_them(written):
    half = np.ones((40, 2), dtype=bool)
    half[20:, 0] = False
    first, *others = crowd(3)
    names = (r"cam $\frac$", "window")  # a name is no formula
    image = written([replace(first, seen=half), *others], camera_names=names)
    for colour in _style.PEOPLE[:3]:
        assert near(image, colour) > 1500
    assert near(image, _style.PEOPLE[3]) < 20
    pale = [near(image, _style.tint(colour, 0.5)) for colour in _style.PEOPLE[:2]]
    assert pale[0] > 500 + pale[1]


_NOWHERE = np.full((40, 3, 3), np.nan)


@pytest.mark.parametrize(
    "people",
    [
        [person(start=_NOWHERE, refined=_NOWHERE, seen=np.zeros((40, 2), dtype=bool))],
        [person(frames=[7])],
        [person(frames=[3, 4, 900])],
        crowd(16),
        [person("a name that is much too long for its row"), person("$x_1$ <b>")],
    ],
)
def test_any_people_have_a_picture(written, figures, people):
    written(people)
    figures[0].draw_without_rendering()
    plan, bars, errors, side = figures[0].axes
    assert len(bars.get_yticks()) == len(people)
    assert bars.get_xlim() == errors.get_xlim()
    for axes in (plan, side):
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        across, up = (right - left) / axes.bbox.width, (high - low) / axes.bbox.height
        assert across == pytest.approx(up, rel=0.006)  # as matplotlib keeps it
