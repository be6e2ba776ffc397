"""``skelsplat overlay`` with videos that are missing, damaged, of another size or of another recording."""

from __future__ import annotations

import json

import numpy as np
import pytest

from command_line import assert_fails, invoke
from overlay_case import FRAMES, NAMES, need_opencv, read_video, write_run, write_video

need_opencv()

from skelsplat.exceptions import DatasetError  # noqa: E402
from skelsplat.io.video import open_sink  # noqa: E402


def overlay(case, videos, *args):
    return invoke("overlay", case.folder, videos, "-o", case.folder.parent / "out", *args)


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ((240, 320), ("320×240 like the camera cam_01", "240×320, width and height exchanged", "turned")),
        ((640, 360), ("320×240 like the camera cam_01, or a copy of it in another size", "got 640×360")),
    ],
)
def test_a_size_that_does_not_fit(case, tmp_path, size, words):
    for name in ("cam01", "cam02"):
        write_video(tmp_path / "videos" / f"{name}.mp4", size=size)
    assert_fails(overlay(case, tmp_path / "videos"), 1, "cam01.mp4: size: expected", *words)
    assert not (case.folder.parent / "out").exists()


def test_a_camera_without_a_video(case, videos):
    (videos / "cam02.mp4").unlink()
    (videos / "door.mp4").write_bytes(b"")
    assert_fails(overlay(case, videos), 1, "a file for every camera (files: cam01.mp4, door.mp4)", "cam_02")
    assert overlay(case, videos, "--camera", "cam_01").exit_code == 0
    assert_fails(overlay(case, videos, "--camera", "cam_02"), 1, "cam01.mp4, door.mp4", "none for cam_02")
    said = "--camera: expected a camera, one of cam_01, cam_02, got 'cam_9'"
    assert_fails(overlay(case, videos, "--camera", "cam_9"), 2, said)


@pytest.mark.parametrize("content", [b"", b"this is no video", None])
def test_a_damaged_video_is_named(case, videos, content):
    path = videos / "cam02.mp4"
    path.write_bytes(path.read_bytes()[:1500] if content is None else content)
    assert_fails(overlay(case, videos), 1, "cam02.mp4: video: expected")
    assert not (case.folder.parent / "out").exists()


def test_a_video_of_another_time(case, videos):
    result = overlay(case, videos, "--first-frame", 50)
    assert_fails(result, 1, "frames from 0 to 5, which the run has of cam_01", "50 to 55", "--first-frame")


def test_a_detector_that_counts_from_one_is_suspected(tmp_path, videos):
    case = write_run(tmp_path / "from_one", frames=np.arange(1, FRAMES + 1))
    result = overlay(case, videos)
    said = " ".join(result.stderr.split())
    assert "cam01.mp4: frames 0 to 5, and the run has 1 to 6 of cam_01: if its detector counts from 1" in said
    findings = json.loads(overlay(case, videos, "--json").stdout)["findings"]
    kinds = [finding["kind"] for finding in findings]
    assert kinds == ["video_one_frame_late"] * 2 + ["video_frames_missing"] * 2


def test_images_that_cannot_be_read_are_left_out(case, images):
    (images / "cam01" / "take2_002.png").write_bytes(b"no image")
    result = overlay(case, images, "--fps", 5)
    assert result.exit_code == 0
    assert "cam01: 1 of the frames 0 to 5" in result.stderr
    for path in (images / "cam01").iterdir():
        path.write_bytes(b"")
    assert_fails(overlay(case, images), 1, "cam01: images: expected", "6 that it cannot")


def test_a_result_never_replaces_a_video_that_is_read(case, tmp_path):
    for name in NAMES:
        write_video(tmp_path / "videos" / f"{name}.mp4")
    before = (tmp_path / "videos" / "cam_01.mp4").read_bytes()
    result = invoke("overlay", case.folder, tmp_path / "videos", "-o", tmp_path / "videos")
    assert_fails(result, 1, "--output: expected a folder in which no result replaces a video that is read")
    assert (tmp_path / "videos" / "cam_01.mp4").read_bytes() == before


def test_a_stop_leaves_finished_videos_and_no_half_one(case, videos, tmp_path, monkeypatch):
    from skelsplat.run.overlay import Scene

    frame = Scene.frame

    def stop_in_the_second_camera(self, view, number):
        if view == 1 and number == 3:
            raise KeyboardInterrupt
        return frame(self, view, number)

    monkeypatch.setattr(Scene, "frame", stop_in_the_second_camera)
    result = overlay(case, videos)
    assert result.exit_code == 130
    assert "interrupted; files already written are complete" in result.stderr
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["cam_01.mp4"]
    assert len(read_video(tmp_path / "out" / "cam_01.mp4")[0]) == FRAMES


def write_mp4(path, count, size):
    noise = np.random.default_rng(0)
    with open_sink(path, 25.0) as sink:
        for number in range(count):
            sink.write(number, noise.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8))


def test_videos_are_what_browsers_play(tmp_path):
    write_mp4(tmp_path / "short.mp4", 5, (63, 40))
    with pytest.importorskip("av", reason="PyAV is not installed").open(str(tmp_path / "short.mp4")) as video:
        (stream,) = video.streams
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height, stream.frames, stream.average_rate) == (64, 40, 5, 25)


def test_a_video_that_does_not_fit_is_an_error(tmp_path):
    """As on a full disk."""
    resource = pytest.importorskip("resource", reason="no limits of file sizes on this platform")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(DatasetError, match=r"long\.mp4: output: expected a path that can be written"):
            write_mp4(tmp_path / "long.mp4", 60, (160, 120))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
