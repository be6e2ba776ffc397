"""rtmlib, imitated: its solutions, networks that are none of its own, and what of them is refused.

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
CELLS = 52 * 80 + 26 * 40 + 13 * 20  # of YOLOX for 416 × 640 pixels


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
    assert {"det": str(files["det_model"]), "pose": str(files["pose_model"])}.items() <= Solution.made[
        0
    ].items()
    # rtmlib has YOLOX's as height, width and RTMPose's as width, height
    assert (solution.det_model.model_input_size, solution.pose_model.model_input_size) == (
        (416, 640),
        (192, 256),
    )
    assert solution.det_model.score_thr == 0.3
    assert _rtmlib._loaded(RTMLib(model="body")).det_model.model_input_size == "rtmlib's"


# Networks from files. Refused is what real ones gave: tracebacks, or thousands of people.


def yolox(classes=80, cells=CELLS):
    """Return what YOLOX gives: centre, logarithms of the size, and probabilities."""
    boxes = np.zeros((1, cells, 5 + classes), dtype=np.float32)
    boxes[..., :4] = (0.5, 0.5, 3.2, -0.9)
    boxes[0, 7, [4, 5]] = 0.9  # a person
    boxes[0, 9, [4, 5 + classes - 1]] = 0.9  # something else
    return boxes


def boxes_of(files, outputs):
    network = _rtmlib._loaded(RTMLib(**files)).det_model
    network.outputs = lambda _: outputs
    return network.inference(np.zeros((4, 4, 3)))


def test_of_a_yolox_of_several_classes_people_alone(files):
    (found,) = boxes_of(files, [yolox()])
    assert found.tolist() == yolox()[..., :6].tolist()
    assert boxes_of(files, [yolox(classes=1)])[0].shape == (1, CELLS, 6)


def test_of_a_yolox_with_nms_people_alone(files):
    boxes = np.arange(15.0).reshape(1, 3, 5)
    assert boxes_of(files, [boxes])[0].tolist() == boxes.tolist()
    (found,) = boxes_of(files, [boxes, np.array([[0, 56, 0]])])
    assert found.tolist() == boxes[:, [0, 2]].tolist()


def logits():
    return yolox() * 4 - 3


def pixels():
    boxes = yolox()
    boxes[..., 2:4] = 90.0
    return boxes


@pytest.mark.parametrize(
    "outputs",
    [
        [logits()],
        [pixels()],
        [yolox(cells=8400)],
        [yolox().transpose(0, 2, 1)],
        simcc(17),
        [np.zeros((1, 1, 80, 80))],
    ],
    ids=["logits", "pixels", "another size", "YOLOv8", "a pose network", "heads"],
)
def test_other_detectors_are_refused(files, outputs):
    with pytest.raises(sk.InvalidInputError) as caught:
        boxes_of(files, outputs)
    assert caught.value.argument == "det_model"


@pytest.mark.parametrize(
    "outputs",
    [
        simcc(26),
        [np.zeros((1, 17, 64, 48))],
        [np.zeros((1, 9, 5)), np.zeros((1, 9, 17, 3))],
        [*simcc(17), simcc(17)[0]],
        simcc(17)[::-1],
    ],
    ids=["other joints", "heat maps", "RTMO", "three axes", "y first"],
)
def test_other_pose_networks_are_refused(files, outputs):
    image = np.full((240, 320, 3), 60, dtype=np.uint8)
    detector = RTMLib("body", **files)
    _rtmlib._loaded(detector).pose_model.outputs = lambda _: outputs
    with detector.open() as find, pytest.raises(sk.InvalidInputError) as caught:
        find(image)
    assert caught.value.argument == "pose_model"


def test_what_onnxruntime_raises_is_one_line(files):
    def fails(_):
        raise RuntimeError("[ONNXRuntimeError] : 2 : INVALID_ARGUMENT :\nexpected: (tensor(float16))")

    network = _rtmlib._loaded(RTMLib(**files)).det_model
    network.outputs = fails
    with pytest.raises(sk.SkelSplatError, match=r"^det_model: .*INVALID_ARGUMENT") as found:
        network.inference(np.zeros((4, 4, 3)))
    assert "\n" not in str(found.value)
