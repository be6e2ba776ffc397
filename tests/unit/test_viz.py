"""The figures: size, labels, what is drawn where, and that a file is written whole or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from matplotlib.image import imread

from skelsplat import viz
from skelsplat.exceptions import DatasetError
from skelsplat.viz import _style

UP = np.array([0.0, 0.0, 1.0])
# hip left, hip right, head: a person who looks along +x, left is +y
BODY = np.array([[0.0, 150.0, 900.0], [0.0, -150.0, 900.0], [20.0, 0.0, 1700.0]])
SKELETON = viz.Skeleton(limbs=((0, 1), (0, 2), (1, 2)), left_right=((0, 1),))
T, M, N = 4, 2, 3


def overview_data(before=None, after=None, error_bar=None, status=None, frame=2, **changes):
    """Build the data; poses in mm, error bars of 10, 20 and 30 mm along x, y and z."""
    after = np.repeat(BODY[None], T, axis=0) if after is None else after
    joints = after.shape[1]
    known = np.broadcast_to(np.diag([100.0, 400.0, 900.0]), (T, joints, 3, 3))
    rng = np.random.default_rng(0)
    data = {
        "before": after + 30.0 if before is None else before,
        "after": after,
        "error_bar": known if error_bar is None else error_bar,
        "status": np.full((T, joints), "ok") if status is None else status,
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
    """Return the points of the k-th scatter of an axes; collections of ellipses are not counted."""
    scatters = [c for c in axes.collections if not isinstance(c, PatchCollection)]
    return np.asarray(scatters[k].get_offsets())


def ellipses(axes):
    """Return (x0, y0, x1, y1) of every error ellipse."""
    (collection,) = [c for c in axes.collections if isinstance(c, PatchCollection)]
    # the control points of the Bézier curves reach the extremes in the middle of each side
    return np.array([path.get_extents().extents for path in collection.get_paths()])


def texts(axes):
    return [axes.get_title(), axes.get_xlabel(), axes.get_ylabel()]


def test_overview_has_two_views_and_the_errors(tmp_path, figures):
    viz.write_overview(tmp_path / "o.png", overview_data(), skeleton=SKELETON)
    front, side, cameras, spread = figures[0].axes
    assert texts(front) == ["front view", "to the body's left [mm]", "height [mm]"]
    assert texts(side)[:2] == ["side view (from the right)", "to the body's front [mm]"]
    assert "[px]" in cameras.get_xlabel()
    assert "[px]" in spread.get_xlabel()
    assert [label.get_text() for label in cameras.get_yticklabels()] == ["door", "window"]
    assert figures[0].texts[0].get_text() == "Frame 2"


@pytest.mark.painted
def test_overview_is_1400_px_wide_and_not_blank(tmp_path):
    path = viz.write_overview(tmp_path / "o.png", overview_data(), skeleton=SKELETON)
    image = imread(path)
    assert image.shape[1] == 1400
    for part in np.array_split(image[..., :3], 3, axis=1):
        assert part.std() > 0.02  # a white third has 0


def test_views_share_one_scale_and_show_the_sides(tmp_path, figures):
    viz.write_overview(tmp_path / "o.png", overview_data(), skeleton=SKELETON)
    front, side = figures[0].axes[:2]
    scales = [axes.bbox.width / np.ptp(axes.get_xlim()) for axes in (front, side)]
    heights = [axes.bbox.height / np.ptp(axes.get_ylim()) for axes in (front, side)]
    np.testing.assert_allclose([*scales, *heights], scales[0], rtol=1e-9)
    joints = offsets(front, 1)
    np.testing.assert_allclose(joints[:, 0], [150.0, -150.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(joints[:, 1], [900.0, 900.0, 1700.0], atol=1e-9)
    ahead = offsets(side, 1)[:, 0]
    assert ahead[2] - ahead[0] == pytest.approx(20.0)


def test_joints_that_are_not_ok_are_hollow(tmp_path, figures):
    status = np.full((T, N), "ok", dtype="<U10")
    status[2, 1] = "weak"
    viz.write_overview(tmp_path / "o.png", overview_data(status=status), skeleton=SKELETON)
    faces = figures[0].axes[0].collections[1].get_facecolors()
    np.testing.assert_array_equal(faces[1], [1.0, 1.0, 1.0, 1.0])
    assert not (faces[[0, 2], :3] == 1.0).all(axis=1).any()


@pytest.mark.painted
def test_overview_of_unknown_joints_and_without_pairs(tmp_path, figures):
    nothing = np.full((T, N, 3), np.nan)
    viz.write_overview(tmp_path / "a.png", overview_data(before=nothing, after=nothing), skeleton=SKELETON)
    viz.write_overview(tmp_path / "b.png", overview_data(), skeleton=viz.Skeleton())
    assert figures[1].axes[0].get_title() == "view 1"
    assert imread(tmp_path / "a.png").shape[1] == imread(tmp_path / "b.png").shape[1] == 1400


def test_error_ellipses_are_two_standard_deviations_in_each_view(tmp_path, figures):
    viz.write_overview(tmp_path / "o.png", overview_data(), skeleton=SKELETON)
    # the front view shows y and z, the side view x and z
    for axes, across in ((figures[0].axes[0], 20.0), (figures[0].axes[1], 10.0)):
        boxes = ellipses(axes)
        assert len(boxes) == N
        np.testing.assert_allclose(boxes[:, 2] - boxes[:, 0], 4 * across, rtol=1e-6)
        np.testing.assert_allclose(boxes[:, 3] - boxes[:, 1], 4 * 30.0, rtol=1e-6)
        np.testing.assert_allclose((boxes[:, :2] + boxes[:, 2:]) / 2, offsets(axes, 1), atol=1e-6)


def test_a_tilted_error_ellipse_lies_along_its_longer_axis(tmp_path, figures):
    turned = camera_panel(covariances=np.broadcast_to([[10.0, 6.0], [6.0, 10.0]], (N, 2, 2)))
    viz.write_overview(tmp_path / "o.png", overview_data(panels=[turned]), skeleton=SKELETON)
    (collection,) = [c for c in figures[0].axes[4].collections if isinstance(c, PatchCollection)]
    points = collection.get_paths()[0].vertices - turned.reprojection[0]
    # σ² along the diagonal is 16, across it 4
    assert np.abs(points @ [1, 1]).max() / np.sqrt(2) == pytest.approx(2 * 4.0, rel=1e-3)
    assert np.abs(points @ [1, -1]).max() / np.sqrt(2) == pytest.approx(2 * 2.0, rel=1e-3)


def test_cameras_mark_rejected_and_exchanged_detections(tmp_path, figures):
    panels = [camera_panel("door"), camera_panel("window", swapped=np.array([True, False, False]))]
    viz.write_overview(tmp_path / "o.png", overview_data(panels=panels), skeleton=SKELETON)
    door, window = figures[0].axes[4:]
    assert [door.get_title(), window.get_title()] == ["door: 1 of 2 rejected", "window: 1 of 2 rejected"]
    taken, rejected, swapped = (offsets(door, k) for k in range(3))
    np.testing.assert_array_equal(taken[np.isfinite(taken).all(axis=1)], [[100.0, 80.0]])
    np.testing.assert_array_equal(rejected, [[140.0, 120.0]])
    assert len(swapped) == 0
    np.testing.assert_array_equal(offsets(window, 2), [[100.0, 80.0]])
    lines = [line.get_xydata() for line in door.lines if line.get_color() == _style.REJECTED]
    np.testing.assert_array_equal(lines, [[[140.0, 120.0], [111.0, 118.0]]])
    assert door.get_ylim()[0] > door.get_ylim()[1]  # v grows downwards
    labels = [text.get_text() for legend in figures[0].legends for text in legend.get_texts()]
    assert "error ellipsoid, 2 σ" in labels
    assert "left and right exchanged" in labels
    heads = [text.get_text() for text in figures[0].texts]
    assert "Cameras, same frame, cropped to the pose" in heads  # of a person or an animal


def test_body_axes_are_left_and_forward():
    left, forward, _ = viz.body_axes(np.repeat(BODY[None], T, axis=0), ((0, 1),), UP)
    np.testing.assert_allclose(left, [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(forward, [1.0, 0.0, 0.0], atol=1e-12)


def test_body_axes_of_a_turning_person_are_those_of_the_frame():
    turned = BODY * [-1.0, -1.0, 1.0]
    left, _, _ = viz.body_axes(np.stack([BODY, turned]), ((0, 1),), UP, frame=1)
    np.testing.assert_allclose(left, [0.0, -1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("pose", [BODY, np.full((3, 3), np.nan), np.zeros((3, 3))])
def test_body_axes_without_pairs_are_horizontal_unit_vectors(pose):
    left, forward, _ = viz.body_axes(pose[None], (), UP)
    np.testing.assert_allclose([left @ UP, forward @ UP, left @ forward], 0.0, atol=1e-9)
    np.testing.assert_allclose([left @ left, forward @ forward], 1.0, atol=1e-9)


def test_a_failed_write_leaves_the_former_file_and_nothing_else(tmp_path, monkeypatch):
    path = viz.write_overview(tmp_path / "o.png", overview_data(), skeleton=SKELETON)
    before = path.read_bytes()

    def full(_path, _target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(
        DatasetError, match=r"o\.png: output: expected a path that can be written, got no space"
    ):
        viz.write_overview(path, overview_data(frame=0), skeleton=SKELETON)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["o.png"]


def test_the_legends_of_an_overview_overlap_nothing(tmp_path, figures):
    status = np.full((T, N), "ok", dtype="<U10")
    status[2] = ["weak", "filled", "unobserved"]
    panels = [camera_panel(swapped=np.array([True, False, False]))] * 8
    data = overview_data(status=status, panels=panels)
    viz.write_overview(tmp_path / "o.png", data, skeleton=SKELETON)
    (figure,) = figures
    renderer = figure.canvas.get_renderer()
    placed = [*figure.legends, *figure.texts]
    boxes = [artist.get_window_extent(renderer) for artist in placed]
    boxes += [axes.get_tightbbox(renderer) for axes in figure.axes]
    for k, one in enumerate(boxes[: len(placed)]):
        assert 0 <= one.x0 < one.x1 <= figure.bbox.x1
        assert not any(one.overlaps(other) for j, other in enumerate(boxes) if j != k)


def test_views_are_front_and_side_only_where_the_vertical_and_the_heading_are_known(tmp_path, figures):
    known = overview_data()
    tilted = replace(known, up_known=False)
    viz.write_overview(tmp_path / "o.png", tilted, skeleton=SKELETON)
    alike = np.repeat(BODY[None], T, axis=0)
    alike[:, 1] = alike[:, 0]  # hips in one place: no left and right
    viz.write_overview(tmp_path / "p.png", overview_data(after=alike), skeleton=SKELETON)
    for figure, height in zip(figures, ("z [mm]", "height [mm]"), strict=True):
        first, second = figure.axes[:2]
        assert texts(first) == ["view 1", "widest direction [mm]", height]
        assert texts(second)[:2] == ["view 2", "across it [mm]"]
