"""The figures in print size: what is drawn, and that the files are PNG and PDF."""

from __future__ import annotations

import re

import numpy as np
import pytest

from skelsplat import viz
from skelsplat.exceptions import DatasetError
from skelsplat.viz import _style
from skelsplat.viz.bones import draw_bones
from skelsplat.viz.error_map import draw_error_map
from skelsplat.viz.trajectories import draw_trajectories

T, N = 12, 3
SKELETON = viz.Skeleton(limbs=((0, 2), (1, 2)), left_right=((0, 1),))
MAGIC = {"png": b"\x89PNG\r\n\x1a\n", "pdf": b"%PDF-"}


def trajectory_data(frames=None, rate=None, **changes):
    """Three joints on a curve, with standard deviations of 10, 20 and 30 mm."""
    frames = np.arange(T) if frames is None else np.asarray(frames)
    steps = len(frames)
    pose = np.cumsum(np.ones((steps, N, 3)), axis=0) * [100.0, 50.0, 10.0]
    data = {
        "pose": pose,
        "sigma": np.broadcast_to([10.0, 20.0, 30.0], pose.shape).copy(),
        "start": pose + 5.0,
        "status": np.full((steps, N), "ok", dtype="<U10"),
        "time": viz.TimeAxis(frames, rate, int(frames[0])),
        "joint_names": ("left_wrist", "right_wrist", "head"),
        "joints": [0],
        "title": "walk",
    }
    return viz.TrajectoryData(**{**data, **changes})


def drawn(data):
    """Return the axes of the first page."""
    return draw_trajectories(data, skeleton=SKELETON)[0].axes


def labelled(artists, label):
    (found,) = [artist for artist in artists if artist.get_label() == label]
    return found


def band(axes, count):
    """Return the corners of the polygons of a band, (K, 2) each."""
    return [path.vertices for path in labelled(axes.collections, f"{count} σ").get_paths()]


@pytest.mark.parametrize("count", [1, 2])
def test_bands_are_the_standard_deviations(count):
    data = trajectory_data()
    for axis, axes in enumerate(drawn(data)):
        (corners,) = band(axes, count)
        for t, value in enumerate(data.pose[:, 0, axis]):
            heights = np.unique(corners[corners[:, 0] == t, 1].round(9))
            expected = value + np.array([-1, 1]) * count * data.sigma[t, 0, axis]
            np.testing.assert_allclose(heights, expected, rtol=1e-12)  # rounded to 1e-9 of some 100 mm


def test_lines_are_position_and_start_and_labels_have_units():
    data = trajectory_data(rate=50.0, frames=np.arange(1000, 1000 + T))
    for axis, axes in enumerate(drawn(data)):
        line = labelled(axes.lines, "position")
        np.testing.assert_array_equal(line.get_xdata(), np.arange(T) / 50.0)
        np.testing.assert_array_equal(line.get_ydata(), data.pose[:, 0, axis])
        np.testing.assert_array_equal(labelled(axes.lines, "start").get_ydata(), data.start[:, 0, axis])
        assert axes.get_title() == f"{'xyz'[axis]} [mm]"
        assert axes.get_xlabel() == "time since frame 1000 [s]"


def test_lines_and_bands_stop_where_positions_or_frames_are_missing():
    frames = [*range(100, 106), *range(70000, 70006)]
    data = trajectory_data(frames=frames)
    data.pose[2, 0] = np.nan
    axes = drawn(data)[0]
    x, y = labelled(axes.lines, "position").get_data()
    assert np.isnan(y[2])
    assert np.isnan(x[6])  # between frames 105 and 70000
    assert x[7] == 70000
    assert [sorted(set(part[:, 0])) for part in band(axes, 1)] == [
        [100, 101],
        [103, 104, 105],
        list(range(70000, 70006)),
    ]
    assert axes.get_xlabel() == "frame"


def test_a_frame_without_neighbours_is_a_point_with_bars():
    axes = drawn(trajectory_data(frames=[7]))[0]
    point = [line for line in axes.lines if line.get_marker() == "o"]
    assert [line.get_xdata().tolist() for line in point] == [[7], [7]]  # start and position
    bars = [c.get_segments()[0][:, 1] for c in axes.collections if hasattr(c, "get_segments")]
    assert sorted(np.ptp(bar) for bar in bars) == pytest.approx([20.0, 40.0])
    assert axes.get_xticks().tolist() == [7]


def test_status_is_marked_and_filled_frames_are_dotted():
    data = trajectory_data(frames=[0, 1, 2, 3, 4, 5, 9, 10])
    data.status[2:4, 0] = "weak"
    data.status[4, 0] = "filled"
    data.status[5:7, 0] = "unobserved"
    axes = drawn(data)[0]
    marks = {
        name: [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in found.get_paths()]
        for name in ("weak", "filled", "unobserved")
        for found in [labelled(axes.collections, name)]
    }
    assert marks == {"weak": [(1.5, 3.5)], "filled": [(3.5, 4.5)], "unobserved": [(4.5, 5.5), (8.5, 9.5)]}
    assert np.isnan(labelled(axes.lines, "position").get_ydata()[4])
    dotted = labelled(axes.lines, "filled").get_ydata()
    assert np.flatnonzero(np.isfinite(dotted)).tolist() == [3, 4, 5]
    (legend,) = axes.figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words[-3:] == ["unobserved", "filled (dotted)", "weak"]


@pytest.mark.painted
def test_every_format_is_written_and_older_pages_go(tmp_path):
    data = trajectory_data(joints=[0, 1, 2], notes=["Low-pass: a filter."])
    for number in (2, 3, 5):
        (tmp_path / f"t_{number}.png").write_bytes(b"old")
    pages = viz.draw_trajectories(data, skeleton=SKELETON)
    files = viz.write_pages(pages, tmp_path / "t", ("png", "pdf"))
    assert [path.name for path in files] == ["t.png", "t.pdf"]
    for path in files:
        assert path.read_bytes().startswith(MAGIC[path.suffix[1:]])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.pdf", "t.png", "t_5.png"]


@pytest.mark.painted
@pytest.mark.parametrize("rate", [50.0, 1e-9])
def test_the_numbers_on_an_axis_over_time_are_plain(tmp_path, rate):
    (page,) = viz.draw_trajectories(trajectory_data(rate=rate), skeleton=SKELETON)
    viz.write_pages([page], tmp_path / "t", ("png", "pdf"))
    for axis in (axis for axes in page.axes for axis in (axes.xaxis, axes.yaxis)):
        numbers = [label.get_text() for label in axis.get_ticklabels()] + [axis.get_offset_text().get_text()]
        assert any(numbers)
        assert [number for number in numbers if re.fullmatch(r"[−.0-9]*(1e\d+)?", number) is None] == []


@pytest.mark.painted
def test_the_same_data_give_the_same_pdf(tmp_path):
    files = [
        viz.write_pages(
            viz.draw_trajectories(trajectory_data(), skeleton=SKELETON), tmp_path / name, ("pdf",)
        )[0]
        for name in "ab"
    ]
    assert files[0].read_bytes() == files[1].read_bytes()


def bone(side="", lengths=(100.0, 110.0, 90.0), sure=(True, True, True)):
    return viz.Bone(side, np.array(lengths), np.array(sure))


def bone_axes(*panels, frames=3):
    (page,) = draw_bones(panels, viz.TimeAxis(np.arange(frames)))
    return page.axes


def words(axes):
    return [text.get_text() for text in axes.texts]


def test_a_panel_has_both_sides_and_their_numbers():
    right = bone("right", (99.0, 109.0, 89.0))
    (axes,) = bone_axes(viz.BonePanel("elbow – wrist", [bone("left"), right]))
    assert labelled(axes.lines, "left").get_ydata().tolist() == [100.0, 110.0, 90.0]
    assert labelled(axes.lines, "right").get_ydata().tolist() == [99.0, 109.0, 89.0]
    assert words(axes) == [
        "elbow – wrist",
        "left − right +1.0 mm",
        "left 100 ± 8.2 mm (8.2 %)",
        "right 99.0 ± 8.2 mm (8.2 %)",
    ]
    assert axes.get_ylabel() == "mm"


def test_bones_of_a_fly_have_digits_and_fill_their_panel():
    left, right = bone("left", (0.25, 0.26, 0.24)), bone("right", (0.30, 0.31, 0.29))
    (axes,) = bone_axes(viz.BonePanel("a – b", [left, right]))
    assert words(axes)[1:] == [
        "left − right −0.050 mm",
        "left 0.250 ± 0.008 mm (3.3 %)",
        "right 0.300 ± 0.008 mm (2.7 %)",
    ]
    assert np.ptp(axes.get_ylim()) < 0.2


def test_lengths_that_do_not_count_are_pale_and_do_not_set_the_scale():
    (axes,) = bone_axes(viz.BonePanel("a – b", [bone("left", (100.0, 5000.0, 90.0), (True, False, True))]))
    assert np.isnan(labelled(axes.lines, "left").get_ydata()[1])
    assert labelled(axes.lines, "all").get_alpha() < 0.5
    assert axes.get_ylim()[1] < 200


def error_data(cameras=4, joints=17, **changes):
    rng = np.random.default_rng(0)
    shape = (cameras + 1, joints + 1)
    data = {
        "median_px": rng.uniform(1.0, 9.0, shape),
        "rejected": rng.uniform(0.0, 0.5, shape),
        "camera_names": [f"cam_{i:02d}" for i in range(cameras)],
        "joint_names": [f"joint_{j}" for j in range(joints)],
    }
    return viz.ErrorMapData(**{**data, **changes})


@pytest.mark.parametrize("shape", [(2, 4), (60, 133)])
def test_maps_show_the_values_and_fit_the_page(shape):
    data = error_data(*shape)
    figure = draw_error_map(data)
    maps = [axes for axes in figure.axes if axes.images]
    np.testing.assert_array_equal(maps[0].images[0].get_array(), data.median_px.T)
    np.testing.assert_array_equal(maps[1].images[0].get_array(), 100 * data.rejected.T)
    for axes in figure.axes:
        box = axes.get_tightbbox(figure.canvas.get_renderer()).transformed(figure.transFigure.inverted())
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= 1
        assert box.y1 <= 1
    assert [label.get_text() for label in maps[0].get_xticklabels()] == [*data.camera_names, "all"]
    assert maps[0].get_title(loc="left") == "Median reprojection error [px]"


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "bones.png").mkdir()
    with pytest.raises(
        DatasetError, match=r"bones\.png: output: expected a path that can be written, got is a"
    ):
        _style.save_png(_style.new_figure(1.0), tmp_path / "bones.png")
    assert [path.name for path in tmp_path.iterdir()] == ["bones.png"]
