"""The maps: weights by camera and joint or frame, and heat maps beside their renderings."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.image import imread

from skelsplat import viz
from skelsplat.viz.heatmaps import crop_window

SKELETON = viz.Skeleton(limbs=((0, 1), (0, 2), (1, 2)), left_right=((0, 1),))
T, M, N = 4, 2, 3


def weight_data(**changes):
    weights = np.full((T, M, N), 0.9)
    weights[:, 1] = 0.5
    weights[:2, 1, 0] = 0.1
    weights[:, 1, 2] = np.nan
    data = {
        "weights": weights,
        "frames": np.arange(T) + 7,
        "camera_names": ("door", "window"),
        "joint_names": ("hip_left", "hip_right", "head"),
        "rejected_below": 0.25,
    }
    return viz.WeightData(**{**data, **changes})


@pytest.mark.painted
def test_weights_are_means_over_frames_and_over_joints(tmp_path, figures):
    path = viz.write_weights(tmp_path / "w.png", weight_data())
    by_joint, by_frame = figures[0].axes[:2]
    shown = np.ma.filled(by_joint.images[0].get_array(), np.nan)
    np.testing.assert_allclose(shown, [[0.9, 0.9, 0.9], [0.3, 0.5, np.nan]])
    shown = np.ma.filled(by_frame.images[0].get_array(), np.nan)
    np.testing.assert_allclose(shown, [[0.9] * 4, [0.3, 0.3, 0.5, 0.5]])
    written = [text.get_text() for text in by_joint.texts]
    assert written == ["0% rejected", "25% rejected", "0.90", "0.90", "0.90", "0.30", "0.50"]
    assert [label.get_text() for label in by_frame.get_xticklabels()] == ["7", "8", "9", "10"]
    assert imread(path).shape[1] == 1400


def heatmap_row(name="door", height=200, width=300, **changes):
    image = np.zeros((height, width), dtype=np.float32)
    image[85:140, 95:120] = 1.0
    row = {
        "name": name,
        "pseudo": image,
        "rendering": image,
        "detections": np.array([[100.0, 80.0], [110.0, 120.0], [np.nan, np.nan]]),
        "reprojection": np.array([[102.0, 81.0], [111.0, 118.0], [120.0, 100.0]]),
        "median_error_px": 2.25,
    }
    return viz.HeatmapRow(**{**row, **changes})


@pytest.mark.painted
def test_heatmaps_have_a_row_of_two_images_per_camera(tmp_path, figures):
    rows = [heatmap_row("door"), heatmap_row("window", median_error_px=float("nan"))]
    path = viz.write_heatmaps(tmp_path / "h.png", rows, skeleton=SKELETON, caption="Frame 2")
    titles = [axes.get_title() for axes in figures[0].axes]
    assert titles == [
        "door, pseudo\nground truth",
        "door, rendering\nmedian error 2.2 px",
        "window, pseudo\nground truth",
        "window, rendering\nno detections",
    ]
    assert all((axes.get_xlabel(), axes.get_ylabel()) == ("u [px]", "v [px]") for axes in figures[0].axes)
    assert imread(path).shape[1] == 1400


def test_heatmap_pixels_lie_at_their_coordinates(tmp_path, figures):
    row = heatmap_row()
    viz.write_heatmaps(tmp_path / "h.png", [row], skeleton=SKELETON)
    axes = figures[0].axes[0]
    image = axes.images[0]
    left, right, bottom, top = image.get_extent()
    shown = np.asarray(image.get_array())
    assert shown.shape == (bottom - top, right - left)
    v, u = np.argwhere(shown == 1.0)[0]
    assert (left + 0.5 + u, top + 0.5 + v) == (95.0, 85.0)
    assert axes.get_ylim()[0] > axes.get_ylim()[1]  # v grows downwards
    crosses = np.asarray(axes.collections[1].get_offsets())
    np.testing.assert_array_equal(crosses, row.detections)


def test_the_crop_holds_the_person_and_stays_in_the_image():
    (left, right), (top, bottom) = crop_window(heatmap_row())
    assert 0 <= left < 100
    assert 120 < right < 299
    assert 0 <= top < 80
    assert 120 < bottom < 199
    edge = heatmap_row(detections=np.array([[-0.4, 0.0], [299.0, 199.4], [400.0, 50.0]]))
    assert crop_window(edge) == ((0, 299), (0, 199))
