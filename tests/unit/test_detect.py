"""``skelsplat.detect``: files, resuming and refusals with a detector of the test.

MediaPipe and rtmlib are imitated; MediaPipe itself is in tests/real/test_detect.py.
"""

from __future__ import annotations

import contextlib
import json
import struct
import sys
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

import skelsplat as sk
from command_line import assert_fails, invoke, succeed
from overlay_case import FRAMES, SIZE, level, need_opencv, write_video

need_opencv()

from skelsplat.detect import MediaPipe, _detectors, detect  # noqa: E402  after the check
from skelsplat.io import read_detections  # noqa: E402
from skelsplat.run.found import look  # noqa: E402

CAMERAS = ("cam1", "cam2")


@dataclass
class Counting:
    """Finds as many people as the frame's number, up to two, and can be interrupted after some images."""

    layout: str = "coco17"
    follows: bool = False
    version: str = "1"
    stop_after: int = 99
    seen: list[int] = field(default_factory=list)

    @property
    def settings(self):
        return {"backend": "counting", "version": self.version}

    @contextlib.contextmanager
    def open(self):
        yield self._find

    def _find(self, image):
        if len(self.seen) == self.stop_after:
            raise KeyboardInterrupt
        self.seen.append(level(image))
        people = np.full((min(level(image), 2), 17, 3), 0.5)
        people[:, :, 0] = 10 * level(image) + np.arange(17)
        people[:, 3] = np.nan
        return people


@pytest.fixture
def videos(tmp_path):
    for name in CAMERAS:
        write_video(tmp_path / "videos" / f"{name}.mp4")
    return tmp_path / "videos"


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.json")}


def test_openpose_files_that_state_their_layout_and_rate(videos, tmp_path):
    steps = []
    written = detect(videos, tmp_path / "pose", Counting(), progress=lambda *step: steps.append(step))
    assert [(one.camera, one.frames, one.new, one.empty, one.size) for one in written] == [
        (name, FRAMES, FRAMES, 1, SIZE) for name in CAMERAS
    ]
    assert steps[0] == ("cam1", 0, FRAMES)
    assert steps[-1] == ("cam2", FRAMES, FRAMES)
    path = tmp_path / "pose" / "cam1_json" / "cam1_000000000001.json"
    (person,) = json.loads(path.read_text())["people"]
    assert person["pose_keypoints_2d"][:12] == [10, 0.5, 0.5, 11, 0.5, 0.5, 12, 0.5, 0.5, 0, 0, 0]
    found = read_detections(tmp_path / "pose", CAMERAS)
    assert (found.format, found.layout, found.frame_rate) == ("openpose", "coco17", 25.0)
    assert found.people_per_frame.tolist() == [[0, 0], [1, 1], [2, 2], [2, 2], [2, 2], [2, 2]]
    assert np.isnan(found.people[:, :, :, 3]).all()


@pytest.mark.parametrize("follows", [False, True])
def test_what_is_there_after_an_interruption_is_not_detected_again(videos, tmp_path, follows):
    with pytest.raises(KeyboardInterrupt):
        detect(videos, tmp_path / "pose", Counting(follows=follows, stop_after=FRAMES + 2))
    assert len(contents(tmp_path / "pose")) == FRAMES + 2 + 1  # and detect.json
    assert look(tmp_path, {}).lacks[0].command == "detect"  # is offered again
    (tmp_path / "pose" / "cam2_json" / "cam2_000000000001.json").write_bytes(b"")  # after a power failure
    again = Counting(follows=follows)
    written = detect(videos, tmp_path / "pose", again)
    rest = list(range(FRAMES)) if follows else list(range(1, FRAMES))
    assert again.seen == rest
    assert [(one.frames, one.new) for one in written] == [(FRAMES, 0), (FRAMES, len(rest))]
    detect(videos, tmp_path / "whole", Counting())
    assert contents(tmp_path / "pose") == contents(tmp_path / "whole")
    assert "detect" not in [lack.command for lack in look(tmp_path, {}).lacks]
    nothing = Counting(follows=follows)
    detect(videos, tmp_path / "pose", nothing)
    assert nothing.seen == []


def test_other_detections_are_neither_mixed_nor_lost(videos, tmp_path):
    pose = tmp_path / "pose"
    detect(videos, pose, Counting())
    before = contents(pose)

    def refused(source, **options):
        with pytest.raises(sk.InvalidInputError) as caught:
            detect(source, pose, **options)
        assert caught.value.argument == "output"
        return str(caught.value)

    refused(videos, detector=Counting(version="2"))
    refused(videos / "cam1.mp4", detector=Counting(version="2"), overwrite=True)  # cam2's would be mixed
    write_video(tmp_path / "other" / "cam1.mp4", count=FRAMES + 1)  # recorded once more
    refused(tmp_path / "other", detector=Counting())
    own = pose / "cam1_json" / "mine.json"
    own.write_text("{}")
    assert "mine.json" in refused(videos, detector=Counting(version="2"), overwrite=True)
    own.unlink()
    assert contents(pose) == before
    again = Counting(version="2")
    detect(videos, pose, again, last=2, overwrite=True)
    assert again.seen == [0, 1, 2] * 2
    assert len(contents(pose)) == 7


def test_videos_that_differ_and_a_camera_without_anybody(tmp_path):
    write_video(tmp_path / "videos" / "a.mp4", count=1)
    write_video(tmp_path / "videos" / "b.mp4", count=2, rate=30.0)
    with pytest.warns(UserWarning) as found:  # noqa: PT030  the kinds are below
        detect(tmp_path / "videos", tmp_path / "pose", Counting())
    assert [one.message.finding.kind for one in found] == [
        "no_detections",
        "videos_differ_in_length",
        "frame_rates_differ",
    ]


def turned(path, degrees):
    """Write the turn into an MP4's track header, as a phone does: a matrix of 16.16 and 2.30 numbers."""
    data = bytearray(path.read_bytes())
    place = data.index(b"tkhd") + 4 + 40
    cos, sin = {90: (0, 1), 180: (-1, 0), 270: (0, -1)}[degrees]
    one = 1 << 16
    data[place : place + 36] = struct.pack(
        ">9i", cos * one, sin * one, 0, -sin * one, cos * one, 0, 0, 0, 1 << 30
    )
    path.write_bytes(data)


def test_a_turned_video_is_detected_upright_and_said(videos, tmp_path):
    turned(videos / "cam1.mp4", 90)
    with pytest.warns(UserWarning, match=r"cam1.mp4"):
        (one,) = detect(videos / "cam1.mp4", tmp_path / "pose", Counting())
    assert one.size == SIZE[::-1]
    assert one.rotation in (90, 270)


# MediaPipe, imitated


class Pose:
    """`mediapipe.solutions.pose.Pose`: somebody in every image that is not black."""

    made: list[dict] = []  # noqa: RUF012

    def __init__(self, **options):
        self.made.append(options)
        self.closed = False

    def process(self, image):
        assert image.flags.c_contiguous
        point = SimpleNamespace(x=0.5, y=1.25, visibility=float(image[0, 0, 0]) / 255)
        there = SimpleNamespace(landmark=[point] * 33) if image.any() else None
        return SimpleNamespace(pose_landmarks=there)

    def close(self):
        self.closed = True


@pytest.fixture
def mediapipe(monkeypatch):
    Pose.made.clear()
    module = SimpleNamespace(
        __version__="0.10.21", solutions=SimpleNamespace(pose=SimpleNamespace(Pose=Pose))
    )
    monkeypatch.setitem(sys.modules, "mediapipe", module)
    return module


@pytest.mark.usefixtures("mediapipe")
def test_mediapipes_landmarks_in_pixels():
    image = np.zeros((240, 320, 3), dtype=np.uint8)
    with MediaPipe("heavy").open() as find:
        assert find(image).shape == (0, 33, 3)
        image[:, :, 2] = 51  # blue first
        assert find(image).tolist() == [[[160.0, 300.0, 0.2]] * 33]
    assert Pose.made == [{"static_image_mode": False, "model_complexity": 2, "smooth_landmarks": False}]
    assert MediaPipe().settings == {"backend": "mediapipe", "version": "0.10.21", "model": "full"}
    assert sk.layouts.get(MediaPipe().layout).n_joints == 33


# rtmlib, imitated


class Solution:
    """A solution class of rtmlib: as many people as the image's level."""

    made: list[dict] = []  # noqa: RUF012

    def __init__(self, **options):
        self.made.append(options)
        print("load it with onnxruntime backend")

    def det_model(self, image):
        return np.ones((level(image), 4))

    def pose_model(self, _image, bboxes):
        assert len(bboxes)  # none would be the whole image
        pixels = np.arange(len(bboxes) * 26 * 2.0).reshape(len(bboxes), 26, 2)
        return pixels, np.full((len(bboxes), 26), 1.07)


def test_several_people_by_rtmlib(videos, tmp_path, monkeypatch):
    _detectors._loaded.cache_clear()
    monkeypatch.setitem(sys.modules, "rtmlib", SimpleNamespace(BodyWithFeet=Solution))
    monkeypatch.setitem(sys.modules, "rtmlib.version", SimpleNamespace(__version__="0.0.16"))
    pose = tmp_path / "pose"
    result = succeed("detect", videos, "-o", pose, "--backend", "rtmlib", "--mode", "lightweight", "--json")
    document = json.loads(result.stdout)
    settings = {"backend": "rtmlib", "version": "0.0.16", "model": "body-feet", "mode": "lightweight"}
    assert (document["layout"], document["detector"]) == ("halpe26", settings)
    assert [camera["new"] for camera in document["cameras"]] == [FRAMES, FRAMES]
    assert Solution.made == [{"mode": "lightweight", "backend": "onnxruntime", "device": "cpu"}]
    found = read_detections(pose, CAMERAS)
    assert found.layout == "halpe26"
    assert found.people_per_frame[:, 0].tolist() == list(range(FRAMES))
    assert found.people[5, 0, 1, 0].tolist() == [52.0, 53.0, 1.0]


# The command


@pytest.mark.parametrize("name", ["mediapipe", "rtmlib"])
def test_a_missing_package_and_its_extra(monkeypatch, tmp_path, name):
    monkeypatch.setitem(sys.modules, name, None)
    result = invoke("detect", tmp_path / "no videos", "-o", tmp_path / "pose", "--backend", name)
    assert_fails(result, 1, f"pip install 'skelsplat[{name}]'")
    assert not (tmp_path / "pose").exists()
