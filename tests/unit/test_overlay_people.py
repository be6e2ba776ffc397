"""``skelsplat overlay`` of several people, and on plain frames where there are no videos."""

from __future__ import annotations

import json

import numpy as np
import pytest

from command_line import invoke
from overlay_case import (
    FRAMES,
    LAYOUT,
    NAMES,
    SIZE,
    at,
    need_opencv,
    read_image,
    read_video,
    write_people,
    write_run,
)

need_opencv()

from skelsplat.viz import _style  # noqa: E402
from skelsplat.viz.overlay import Shown, legend_strip  # noqa: E402
from skelsplat.viz.overlay._marks import bgr  # noqa: E402

BARE = ["--plain", "--png", "--no-legend", "--quiet"]
PLAIN = 226


@pytest.fixture
def people(tmp_path):
    return write_people(tmp_path / "out")


def overlay(tmp_path, *args):
    result = invoke("overlay", tmp_path / "out", *args)
    assert result.exit_code == 0, result.output
    return result


def image_of(tmp_path, number, view=0):
    return read_image(tmp_path / "out" / "overlay" / NAMES[view] / f"{number:06d}.png")


def near(image, colour):
    return int((np.abs(image.astype(int) - bgr(colour)).max(axis=2) < 12).sum())


def test_every_person_is_drawn_in_one_colour_in_the_frames_of_their_run(people, tmp_path):
    overlay(tmp_path, *BARE, "--no-detections", "--no-ellipses")
    for number in range(FRAMES):
        image = image_of(tmp_path, number)
        for case, colour, there in zip(people, _style.PEOPLE, (True, number >= 2), strict=False):
            assert (near(image, colour) > 50) == there
            joints = case.pixels(0)[number]
            left, right = LAYOUT.left_right[0]
            if there and colour == _style.PEOPLE[1]:  # nothing is in front of the nearer one
                assert all(np.abs(at(image, joints[j]) - bgr(colour)).max() <= 8 for j in (left, right))
        assert near(image, _style.PEOPLE[2]) == 0


@pytest.mark.usefixtures("people")
def test_legend_and_names_tell_who_is_who(tmp_path):
    overlay(tmp_path, "--plain", "--png", "--no-detections", "--no-pose", "--no-ellipses", "--quiet")
    image = image_of(tmp_path, 3)
    assert image.shape[0] > SIZE[1]
    for colour in _style.PEOPLE[:2]:
        assert near(image[: SIZE[1]], colour) > 50  # the ground of a number
        assert near(image[SIZE[1] :], colour) > 10
    two, none = ([("a", "#0072b2"), ("b", "#d55e00")], [])
    shown = Shown(rejected_below=0.25, pose=False, ellipses=False, detections=False)
    assert near(legend_strip(400, SIZE, shown, two), "#d55e00") > 10
    assert legend_strip(400, SIZE, shown, none).size == 0


def test_plain_frames_replace_the_videos_of_any_run(tmp_path):
    write_run(tmp_path / "out", frames=np.arange(10, 10 + 5 * FRAMES, 5))
    said = overlay(tmp_path, "--plain", "--no-legend", "--fps", 25, "--json").stdout
    assert json.loads(said)["videos"] is None
    for name in NAMES:
        frames, rate = read_video(tmp_path / "out" / "overlay" / f"{name}.mp4")
        assert (len(frames), rate, frames[0].shape) == (FRAMES, 25.0, (SIZE[1], SIZE[0], 3))
        assert abs(int(np.median(frames[0])) - PLAIN) < 4
