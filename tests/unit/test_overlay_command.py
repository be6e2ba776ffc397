"""``skelsplat overlay``: which frame is drawn on which, where, and the files that come out."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from command_line import succeed
from overlay_case import (
    FRAMES,
    LAYOUT,
    NAMES,
    SIZE,
    at,
    level,
    need_opencv,
    read_image,
    read_video,
    write_images,
    write_people,
    write_run,
    write_video,
)
from skelsplat.viz import _style

need_opencv()

from skelsplat.run.files import videos_of_run  # noqa: E402
from skelsplat.run.overlay import project_covariances  # noqa: E402  after the check
from skelsplat.viz.overlay import Shown, legend_strip  # noqa: E402
from skelsplat.viz.overlay._marks import bgr  # noqa: E402

BARE = ["--no-legend", "--quiet"]
LEFT = LAYOUT.left_right[0][0]


def overlay(case, videos, out, *args):
    return succeed("overlay", case.folder, videos, "-o", out, *args)


def image_of(out, view, number):
    return read_image(out / NAMES[view] / f"{number:06d}.png")


@pytest.mark.parametrize("view", [0, 1])
def test_joints_and_detections_lie_where_the_lens_puts_them(case, images, tmp_path, view):
    """The second camera's distortion moves the outer joints by up to 20 px."""
    overlay(case, images, tmp_path / "joints", "--png", "--no-detections", "--no-ellipses", *BARE)
    overlay(case, images, tmp_path / "seen", "--png", "--no-pose", "--no-ellipses", *BARE)
    for number in (0, 5):
        joints = case.pixels(view)[number]
        pose, seen = (image_of(tmp_path / name, view, number) for name in ("joints", "seen"))
        assert np.abs(at(pose, joints[LEFT]) - bgr(_style.LEFT)).max() <= 8
        for place in case.detections[number, view, :, :2]:
            assert np.abs(at(seen, place) - bgr(_style.DETECTION)).max() <= 8


def test_without_undistortion_the_camera_is_a_pinhole(images, tmp_path):
    case = write_run(tmp_path / "run", undistort=False)
    overlay(case, images, tmp_path / "out", "--png", "--no-detections", "--no-ellipses", *BARE)
    lens = case.rig[1]
    plain = sk.Camera(lens.K, lens.R, lens.t, size=SIZE)
    ideal, bent = (sk.project(case.pose[0], [camera])[0] for camera in (plain, lens))
    far = int(np.argmax(np.linalg.norm(ideal - bent, axis=1)))
    image = image_of(tmp_path / "out", 1, 0)
    drawn = (np.abs(image.astype(int) - level(image) * 20 - 40) > 20).any(axis=2)
    assert drawn[tuple(np.rint(ideal[far]).astype(int)[::-1])]
    assert np.linalg.norm(ideal[far] - bent[far]) > 8


def test_ellipses_follow_the_lens():
    """Against points drawn from the covariance; 3 % is three standard errors of 20,000 of them."""
    from overlay_case import rig

    rng = np.random.default_rng(0)
    axes = np.array([[20.0, 0.0, 0.0], [12.0, 10.0, 0.0], [-8.0, 6.0, 15.0]])
    point, covariance = np.array([700.0, 500.0, 0.0]), axes @ axes.T
    pixel, projected = project_covariances(point[None], covariance[None], rig()[1])
    sample = sk.project(rng.multivariate_normal(point, covariance, 20_000), [rig()[1]])[0]
    np.testing.assert_allclose(pixel[0], sk.project(point, [rig()[1]])[0], atol=1e-9)
    np.testing.assert_allclose(projected[0], np.cov(sample.T), rtol=0.03, atol=0.03 * projected[0].max())


def test_one_video_per_camera_with_the_frames_in_order(case, videos, tmp_path):
    result = overlay(case, videos, tmp_path / "out", "--no-legend")
    for name in NAMES:
        frames, rate = read_video(tmp_path / "out" / f"{name}.mp4")
        assert [level(image) for image in frames] == list(range(FRAMES))
        assert rate == pytest.approx(25.0)
        assert frames[0].shape[:2] == SIZE[::-1]
    assert f"cam_01.mp4: {FRAMES} frames of 320×240" in "".join(result.stdout.splitlines())
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["cam_01.mp4", "cam_02.mp4"]


def test_frame_numbers_offsets_and_the_first_frame(tmp_path):
    """Common frame 107 is the camera's own 107 − 2; a video that starts at 100 has it in place 5."""
    case = write_run(tmp_path / "run", frames=np.arange(102, 108), offsets={"cam_02": 2})
    for name in ("cam01", "cam02"):
        write_video(tmp_path / "videos" / f"{name}.mp4", count=8)
    args = ("--png", "--first-frame", 100, *BARE)
    overlay(case, tmp_path / "videos", tmp_path / "out", *args)
    for number in range(102, 108):
        assert level(image_of(tmp_path / "out", 0, number)) == number - 100
        assert level(image_of(tmp_path / "out", 1, number)) == number - 102


def rated(case, **given):
    """State in the report how cameras of different rates are counted, and the rate of the run."""
    path, rates = case.folder / "report.json", {"cam_01": 25.0, "cam_02": 45.0}
    report = json.loads(path.read_text())
    report["input"] |= {"frame_rates_hz": rates, "frame_rate_hz": 25.0, **given}
    path.write_text(json.dumps(report))
    return case


@pytest.mark.parametrize("first", [0, 1])
def test_a_camera_of_another_rate_shows_its_nearest_frame(tmp_path, first):
    """Frame f of a run at 25 Hz is frame 1.8 f of a camera at 45 Hz, here ten frames of it late."""
    numbers = first + np.arange(FRAMES)
    case = rated(write_run(tmp_path / "run", frames=numbers, offsets={"cam_02": -10}), counted_from=first)
    write_images(tmp_path / "images" / "cam01", numbers, first=first)
    write_images(tmp_path / "images" / "cam02", first + np.arange(10, 20), first=first + 10)
    overlay(case, tmp_path / "images", tmp_path / "out", "--png", *BARE)
    for number in numbers:
        assert level(image_of(tmp_path / "out", 0, number)) == number - first
        assert level(image_of(tmp_path / "out", 1, number)) == round(1.8 * (number - first))
    overlay(case, tmp_path / "images", tmp_path / "grid", "--png", "--grid", *BARE)
    assert len(list((tmp_path / "grid" / "grid").iterdir())) == FRAMES


def test_the_video_of_a_faster_camera_has_the_frames_of_the_run(tmp_path):
    case = rated(write_run(tmp_path / "run", frame_rate=25.0))
    write_video(tmp_path / "videos" / "cam01.mp4")
    write_video(tmp_path / "videos" / "cam02.mp4", count=10, rate=45.0)
    overlay(case, tmp_path / "videos", tmp_path / "out", "--camera", "cam_02", *BARE)
    frames, rate = read_video(tmp_path / "out" / "cam_02.mp4")
    assert [level(image) for image in frames] == [0, 2, 4, 5, 7, 9]
    assert rate == pytest.approx(25.0)
    plain = tmp_path / "plain"
    result = succeed("overlay", case.folder, "--plain", "-o", plain, "--png", "--no-legend", "--json")
    assert [len(list((plain / name).iterdir())) for name in NAMES] == [FRAMES, FRAMES]
    assert not json.loads(result.stdout)["findings"]


@pytest.mark.parametrize(("frames", "expected"), [("2-3", [2, 3]), ("-1", [0, 1]), ("3-99", [3, 4, 5])])
def test_some_frames(case, images, tmp_path, frames, expected):
    args = ("--png", "--camera", "cam_01", f"--range={frames}", *BARE)
    overlay(case, images, tmp_path / "out", *args)
    written = sorted(path.name for path in (tmp_path / "out" / "cam_01").iterdir())
    assert written == [f"{number:06d}.png" for number in expected]
    assert not (tmp_path / "out" / "cam_02").exists()


def test_a_copy_in_another_size_scales_the_drawing(case, tmp_path):
    half = (SIZE[0] // 2, SIZE[1] // 2)
    for name in ("cam01", "cam02"):
        write_images(tmp_path / "images" / name, size=half)
    args = ("--png", "--no-pose", "--no-ellipses", *BARE)
    overlay(case, tmp_path / "images", tmp_path / "out", *args)
    overlay(case, tmp_path / "images", tmp_path / "large", "--scale", 2, *args)
    for view in (0, 1):
        place = case.detections[3, view, LEFT, :2]
        small = image_of(tmp_path / "out", view, 3)
        assert small.shape[:2] == half[::-1]
        assert np.abs(at(small, (place + 0.5) / 2 - 0.5) - bgr(_style.DETECTION)).max() <= 30
        assert np.abs(at(image_of(tmp_path / "large", view, 3), place) - bgr(_style.DETECTION)).max() <= 8


def test_the_grid_holds_all_cameras_and_says_where_an_image_is_missing(case, tmp_path):
    write_images(tmp_path / "images" / "cam01")
    write_images(tmp_path / "images" / "cam02", [0, 1, 2, 5])
    args = ("--grid", "--no-legend", "--json")
    document = json.loads(overlay(case, tmp_path / "images", tmp_path / "out", *args, "--fps", 10).stdout)
    frames, rate = read_video(tmp_path / "out" / "grid.mp4")
    assert rate == pytest.approx(10.0)
    assert len(frames) == FRAMES
    assert [level(image[: SIZE[1]]) for image in frames] == list(range(FRAMES))
    assert document["files"][0]["cameras"] == {"cam_01": 6, "cam_02": 4}
    assert [finding["kind"] for finding in document["findings"]] == ["video_frames_missing"]
    assert "2 of the frames 0 to 5" in document["findings"][0]["text"]
    assert (document["files"][0]["height"], document["files"][0]["width"]) == frames[0].shape[:2]


@pytest.mark.parametrize("what", ["pose", "detections", "error bars"])
def test_missing_data_are_outcomes(images, tmp_path, what):
    shape = (FRAMES, len(NAMES), LAYOUT.n_joints)
    nothing = {
        "pose": {
            "pose": np.full((FRAMES, LAYOUT.n_joints, 3), np.nan),
            "joint_status": np.full((FRAMES, LAYOUT.n_joints), "unobserved"),
        },
        "detections": {"detections": np.full((*shape, 3), np.nan), "view_weights": np.full(shape, np.nan)},
        "error bars": {"uncertainty": np.full((FRAMES, LAYOUT.n_joints, 3, 3), np.nan)},
    }
    case = write_run(tmp_path / "run", **nothing[what])
    for extra in ([], ["--grid"]):
        overlay(case, images, tmp_path / "out", "--before", "--quiet", *extra)


# several people, on plain frames


@pytest.fixture
def people(tmp_path):
    return write_people(tmp_path / "out")


def draw(tmp_path, *args):
    succeed("overlay", tmp_path / "out", "--plain", *args)


def near(image, colour):
    return int((np.abs(image.astype(int) - bgr(colour)).max(axis=2) < 12).sum())


def test_every_person_is_drawn_in_one_colour_in_the_frames_of_their_run(people, tmp_path):
    draw(tmp_path, "--png", "--no-detections", "--no-ellipses", *BARE)
    for number in range(FRAMES):
        image = image_of(tmp_path / "out" / "overlay", 0, number)
        for case, colour, there in zip(people, _style.PEOPLE, (True, number >= 2), strict=False):
            assert (near(image, colour) > 50) == there
            joints = case.pixels(0)[number]
            left, right = LAYOUT.left_right[0]
            if there and colour == _style.PEOPLE[1]:  # nothing is in front of the nearer one
                assert all(np.abs(at(image, joints[j]) - bgr(colour)).max() <= 8 for j in (left, right))
        assert near(image, _style.PEOPLE[2]) == 0


@pytest.mark.usefixtures("people")
def test_legend_and_names_tell_who_is_who(tmp_path):
    draw(tmp_path, "--png", "--no-detections", "--no-pose", "--no-ellipses", "--quiet")
    image = image_of(tmp_path / "out" / "overlay", 0, 3)
    assert image.shape[0] > SIZE[1]
    for colour in _style.PEOPLE[:2]:
        assert near(image[: SIZE[1]], colour) > 50  # the ground of a number
        assert near(image[SIZE[1] :], colour) > 10
    two, none = ([("a", "#0072b2"), ("b", "#d55e00")], [])
    shown = Shown(rejected_below=0.25, pose=False, ellipses=False, detections=False)
    assert near(legend_strip(400, SIZE, shown, two), "#d55e00") > 10
    assert legend_strip(400, SIZE, shown, none).size == 0


def test_a_video_says_of_which_run_it_is(tmp_path):
    folder = write_run(tmp_path / "out").folder
    succeed("overlay", folder, "--plain")
    assert videos_of_run(folder) == dict.fromkeys(NAMES, True)
    report = json.loads((folder / "report.json").read_text())
    (folder / "report.json").write_text(json.dumps({**report, "run": "another"}))
    (folder / "overlay" / "broken.mp4").write_bytes(b"none")
    assert videos_of_run(folder) == dict.fromkeys(("broken", *NAMES), False)
