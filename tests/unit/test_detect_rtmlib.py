"""rtmlib, imitated: its solutions, and networks from files.

rtmlib itself runs in tests/real/test_detect_rtmlib.py, where it is installed.
"""

from __future__ import annotations

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import skelsplat as sk
from command_line import invoke
from overlay_case import FRAMES, level, need_opencv, write_video

need_opencv()

from skelsplat.detect import RTMLib, _rtmlib  # noqa: E402  after the check
from skelsplat.io import read_detections  # noqa: E402

CAMERAS = ("cam1", "cam2")


class Network:
    """A tool of rtmlib: what its network gives for an image goes through `inference`."""

    def __init__(self, size, outputs):
        self.model_input_size, self.outputs, self.score_thr = "rtmlib's", outputs, 0.7
        self.session = SimpleNamespace(get_inputs=lambda: [SimpleNamespace(shape=["batch", 3, *size])])

    def inference(self, image):
        return self.outputs(image)


class Boxes(Network):
    def __call__(self, image):
        return self.inference(image)[0][0, :, :4]


class Joints(Network):
    def __call__(self, image, bboxes):
        assert len(bboxes)  # none would be the whole image
        _, n_joints, _ = self.inference(image)[0].shape
        pixels = np.arange(len(bboxes) * n_joints * 2.0).reshape(len(bboxes), n_joints, 2)
        return pixels, np.full((len(bboxes), n_joints), 1.07)


class Solution:
    """A solution class of rtmlib: as many people as the image's level."""

    made: list[dict] = []  # noqa: RUF012
    joints = 26

    def __init__(self, **options):
        self.made.append(options)
        print("load it with onnxruntime backend")
        self.det_model = Boxes((416, 640), lambda image: [np.ones((1, level(image), 5))])
        self.pose_model = Joints((256, 192), lambda _: simcc(self.joints))
        if "pose" not in options:
            self.pose_model.model_input_size = (192, 256)


def simcc(n_joints):
    return [np.zeros((1, n_joints, length)) for length in (384, 512)]


@pytest.fixture
def videos(tmp_path):
    for name in CAMERAS:
        write_video(tmp_path / "videos" / f"{name}.mp4")
    return tmp_path / "videos"


@pytest.fixture(autouse=True)
def rtmlib(monkeypatch):
    Solution.made.clear()
    _rtmlib._loaded.cache_clear()
    kinds = {"BodyWithFeet": 26, "Body": 17, "Wholebody": 133}
    module = SimpleNamespace(
        **{name: type(name, (Solution,), {"joints": joints}) for name, joints in kinds.items()}
    )
    monkeypatch.setitem(sys.modules, "rtmlib", module)
    monkeypatch.setitem(sys.modules, "rtmlib.version", SimpleNamespace(__version__="0.0.16"))
    return module


@pytest.fixture
def files(tmp_path):
    folder = tmp_path / "sportmotion"
    folder.mkdir()
    for name in ("yolox.onnx", "rtmpose.onnx"):
        (folder / name).write_text(name)
    return {"det_model": folder / "yolox.onnx", "pose_model": folder / "rtmpose.onnx"}


def test_several_people_from_the_command_line(videos, tmp_path):
    pose = tmp_path / "pose"
    result = invoke("detect", videos, "-o", pose, "--backend", "rtmlib", "--mode", "lightweight", "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["layout"] == "halpe26"
    settings = {"backend": "rtmlib", "version": "0.0.16", "model": "body-feet", "mode": "lightweight"}
    assert document["detector"] == settings
    assert [camera["new"] for camera in document["cameras"]] == [FRAMES, FRAMES]
    assert Solution.made == [{"mode": "lightweight", "backend": "onnxruntime", "device": "cpu"}]
    found = read_detections(pose, CAMERAS)
    assert found.layout == "halpe26"
    assert found.people_per_frame[:, 0].tolist() == list(range(FRAMES))
    assert found.people[5, 0, 1, 0].tolist() == [52.0, 53.0, 1.0]


def test_networks_from_files_have_the_files_input_size_and_rtmlibs_own_threshold(files):
    solution = _rtmlib._loaded(RTMLib(**files))
    given = {"det": str(files["det_model"]), "pose": str(files["pose_model"])}
    assert given.items() <= Solution.made[0].items()
    # rtmlib has YOLOX's as height, width and RTMPose's as width, height
    sizes = (solution.det_model.model_input_size, solution.pose_model.model_input_size)
    assert sizes == ((416, 640), (192, 256))
    assert solution.det_model.score_thr == 0.3
    assert _rtmlib._loaded(RTMLib(model="body")).det_model.model_input_size == "rtmlib's"


def boxes_of(files, outputs):
    network = _rtmlib._loaded(RTMLib(**files)).det_model
    network.outputs = lambda _: outputs
    return network.inference(np.zeros((4, 4, 3)))


def test_of_a_yolox_of_several_classes_people_alone(files):
    cells = np.random.default_rng(0).uniform(size=(1, 5460, 85))
    (found,) = boxes_of(files, [cells])
    assert found.tolist() == cells[..., :6].tolist()
    boxes = np.arange(15.0).reshape(1, 3, 5)  # with NMS
    assert boxes_of(files, [boxes])[0].tolist() == boxes.tolist()
    (found,) = boxes_of(files, [boxes, np.array([[0, 56, 0]])])
    assert found.tolist() == boxes[:, [0, 2]].tolist()


def find_with(detector, **outputs):
    solution = _rtmlib._loaded(detector)
    for name, given in outputs.items():
        getattr(solution, name).outputs = given
    with detector.open() as find:
        find(np.full((240, 320, 3), 60, dtype=np.uint8))


def test_a_pose_network_of_other_joints_is_refused(files):
    with pytest.raises(sk.InvalidInputError, match="pose_model"):
        find_with(RTMLib("body", **files), pose_model=lambda _: simcc(26))


def test_what_onnxruntime_raises_is_one_line(files):
    def fails(_):
        raise RuntimeError("[ONNXRuntimeError] : 2 : INVALID_ARGUMENT :\nexpected: (tensor(float16))")

    with pytest.raises(sk.SkelSplatError, match=r"INVALID_ARGUMENT") as found:
        find_with(RTMLib(**files), det_model=fails)
    assert "\n" not in str(found.value)
