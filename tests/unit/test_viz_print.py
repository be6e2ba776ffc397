"""Curves and matrices: what is drawn, and that the files are PNG and PDF."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.image import imread

from skelsplat import viz

T = 12
MAGIC = {"png": b"\x89PNG\r\n\x1a\n", "pdf": b"%PDF-"}


def curve(steps=T, **changes):
    """Return a value that grows by 100 mm a frame, with a standard deviation of 10 mm."""
    values = 100.0 * np.arange(steps)
    data = {"values": values, "side": "left", "sigma": np.full(steps, 10.0), "start": values + 5.0}
    return viz.Curve(**{**data, "status": np.full(steps, "ok", dtype="<U10"), **changes})


def drawn(*curves, frames=None, rate=None):
    """Return the axes of a panel with these curves."""
    frames = np.arange(len(curves[0].values)) if frames is None else np.asarray(frames)
    panel = viz.CurvePanel("wrist, x", "mm", curves)
    (page,) = viz.draw_curves([panel], viz.TimeAxis(frames, rate, int(frames[0])), title="walk")
    return page.axes[0]


def labelled(artists, label):
    (found,) = [artist for artist in artists if artist.get_label() == label]
    return found


def band(axes, count):
    """Return the corners of the polygons of a band, (K, 2) each."""
    return [path.vertices for path in labelled(axes.collections, f"{count} σ").get_paths()]


@pytest.mark.parametrize("count", [1, 2])
def test_bands_are_the_standard_deviations(count):
    one = curve()
    (corners,) = band(drawn(one), count)
    for t, value in enumerate(one.values):
        heights = np.unique(corners[corners[:, 0] == t, 1])
        np.testing.assert_allclose(heights, value + np.array([-1, 1]) * count * 10.0)


def test_lines_are_value_and_start_and_labels_have_units():
    one = curve()
    axes = drawn(one, frames=np.arange(1000, 1000 + T), rate=50.0)
    line = labelled(axes.lines, "value")
    np.testing.assert_array_equal(line.get_xdata(), np.arange(T) / 50.0)
    np.testing.assert_array_equal(line.get_ydata(), one.values)
    np.testing.assert_array_equal(labelled(axes.lines, "start").get_ydata(), one.start)
    labels = [axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()]
    assert labels == ["wrist, x", "time since frame 1000 [s]", "mm"]


def test_lines_and_bands_stop_where_values_or_frames_are_missing():
    one = curve()
    one.values[2] = np.nan
    axes = drawn(one, frames=[*range(100, 106), *range(70000, 70006)])
    x, y = labelled(axes.lines, "value").get_data()
    assert np.isnan(y[2])
    assert np.isnan(x[6])  # between frames 105 and 70000
    assert x[7] == 70000
    assert [sorted(set(part[:, 0])) for part in band(axes, 1)] == [
        [100, 101],
        [103, 104, 105],
        list(range(70000, 70006)),
    ]
    assert axes.get_xlabel() == "frame"


def test_a_frame_without_neighbours_is_a_point_with_a_bar():
    axes = drawn(curve(1), frames=[7])
    assert labelled(axes.lines, "value").get_markevery() == [0]
    bars = [c.get_segments()[0][:, 1] for c in axes.collections if hasattr(c, "get_segments")]
    assert [np.ptp(bar) for bar in bars] == [40.0]


def test_status_is_marked():
    one = curve(8)
    one.status[2:4], one.status[4], one.status[5:7] = "weak", "filled", "unobserved"
    axes = drawn(one, frames=[0, 1, 2, 3, 4, 5, 9, 10])
    marks = {
        name: [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in found.get_paths()]
        for name in ("weak", "filled", "unobserved")
        for found in [labelled(axes.collections, name)]
    }
    assert marks == {"weak": [(1.5, 3.5)], "filled": [(3.5, 4.5)], "unobserved": [(4.5, 5.5), (8.5, 9.5)]}
    (legend,) = axes.figure.legends
    assert [text.get_text() for text in legend.get_texts()][-3:] == ["unobserved", "filled", "weak"]


@pytest.mark.painted
def test_every_format_is_written_and_older_pages_go(tmp_path):
    for number in (2, 3, 5):
        (tmp_path / f"t_{number}.png").write_bytes(b"old")
    panels = [viz.CurvePanel("a", "mm", [curve()])]

    def write(stem):
        pages = viz.draw_curves(panels, viz.TimeAxis(np.arange(T)), notes=["Low-pass: a filter."])
        return viz.write_pages(pages, tmp_path / stem, ("png", "pdf"))

    files = write("t")
    assert [path.name for path in files] == ["t.png", "t.pdf"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.pdf", "t.png", "t_5.png"]
    for path, again in zip(files, write("u"), strict=True):
        assert path.read_bytes().startswith(MAGIC[path.suffix[1:]])
        assert path.read_bytes() == again.read_bytes()


def test_lengths_that_do_not_count_are_pale_and_do_not_set_the_scale():
    bone = viz.Curve(np.array([100.0, 5000.0, 90.0]), "left", sure=np.array([True, False, True]))
    (page,) = viz.draw_curves([viz.bone_panel("elbow – wrist", [bone])], viz.TimeAxis(np.arange(3)))
    axes = page.axes[0]
    assert np.isnan(labelled(axes.lines, "value").get_ydata()[1])
    assert labelled(axes.lines, "all").get_alpha() < 0.5
    assert axes.get_ylim()[1] < 200


@pytest.mark.parametrize("shape", [(2, 4), (16, 67)])
def test_maps_show_the_values_and_fit_the_page(shape):
    cameras, joints = shape
    rng = np.random.default_rng(0)
    data = viz.ErrorMapData(
        median_px=rng.uniform(1.0, 9.0, (cameras + 1, joints + 1)),
        rejected=rng.uniform(0.0, 0.5, (cameras + 1, joints + 1)),
        camera_names=[f"cam_{i:02d}" for i in range(cameras)],
        joint_names=[f"joint_{j}" for j in range(joints)],
    )
    figure = viz.draw_error_map(data)
    figure.draw_without_rendering()
    maps = [axes for axes in figure.axes if axes.images]
    np.testing.assert_array_equal(maps[0].images[0].get_array(), data.median_px.T)
    np.testing.assert_array_equal(maps[1].images[0].get_array(), 100 * data.rejected.T)
    for axes in figure.axes:
        box = axes.get_tightbbox().transformed(figure.transFigure.inverted())
        assert min(box.x0, box.y0) >= 0
        assert max(box.x1, box.y1) <= 1
    assert [label.get_text() for label in maps[0].get_xticklabels()] == [*data.camera_names, "all"]
    assert maps[0].get_title(loc="left") == "Median reprojection error [px]"


@pytest.mark.painted
def test_weights_are_means_over_frames_and_over_joints(tmp_path, figures):
    weights = np.full((4, 2, 3), 0.9)
    weights[:, 1] = 0.5
    weights[:2, 1, 0] = 0.1
    weights[:, 1, 2] = np.nan
    names = ("door", "window"), ("hip_left", "hip_right", "head")
    path = viz.write_weights(tmp_path / "w.png", viz.WeightData(weights, np.arange(4) + 7, *names, 0.25))
    assert imread(path).shape[1] == 1400
    by_joint, by_frame = figures[0].axes[:2]
    shown = np.ma.filled(by_joint.images[0].get_array(), np.nan)
    np.testing.assert_allclose(shown, [[0.9, 0.9, 0.9], [0.3, 0.5, np.nan]])
    shown = np.ma.filled(by_frame.images[0].get_array(), np.nan)
    np.testing.assert_allclose(shown, [[0.9] * 4, [0.3, 0.3, 0.5, 0.5]])
    written = [text.get_text() for text in by_joint.texts]
    assert written == ["0.90", "0.90", "0.90", "0.30", "0.50", "0% rejected", "25% rejected"]
    assert [label.get_text() for label in by_frame.get_xticklabels()] == ["7", "8", "9", "10"]
