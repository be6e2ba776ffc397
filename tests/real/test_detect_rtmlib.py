"""rtmlib itself, where it is installed, on networks made here: from boxes and scores to pixels."""

from __future__ import annotations

import json

import numpy as np
import pytest

from command_line import invoke
from overlay_case import SIZE, write_images
from skelsplat.io import read_detections

onnx = pytest.importorskip("onnx", reason="makes networks")
pytest.importorskip("rtmlib", reason="needs the extra rtmlib")

MODELS = {"body": ("coco17", 17), "body-feet": ("halpe26", 26), "whole-body": ("wholebody133", 133)}
NETWORK = (64, 96)  # height and width of the images that YOLOX takes
CROP = (192, 256)  # width and height of those that RTMPose takes
PERSON, CHAIR = (40.0, 20.0, 140.0, 220.0), (200.0, 100.0, 300.0, 200.0)  # left, top, right, bottom
PERSON_CLASS, CHAIR_CLASS = 0, 56
AT = (96.0, 64.0)  # of all joints, in the crop
SCORE = 1.25


def network(path, size, outputs):
    """Write a network that gives the same whatever it sees."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    tensor = onnx.numpy_helper.from_array
    tensors = {name: tensor(values.astype(np.float32)) for name, values in outputs.items()}
    nodes = [helper.make_node("Constant", [], [name], value=value) for name, value in tensors.items()]
    graph = helper.make_graph(
        nodes,
        "made",
        [helper.make_tensor_value_info("images", kind, ("batch", 3, *size))],
        [helper.make_tensor_value_info(name, kind, values.shape) for name, values in outputs.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, path)
    return path


def yolox(*found):
    """Return YOLOX's boxes for boxes with a class: relative to a cell of 8 px, sizes as logarithms."""
    cells = [(NETWORK[0] // stride, NETWORK[1] // stride) for stride in (8, 16, 32)]
    boxes = np.zeros((1, sum(height * width for height, width in cells), 85))
    ratio = min(NETWORK[0] / SIZE[1], NETWORK[1] / SIZE[0])
    for (left, top, right, bottom), kind in found:
        x, y = ratio * (left + right) / 16, ratio * (top + bottom) / 16
        row = boxes[0, int(y) * cells[0][1] + int(x)]
        row[:4] = x % 1, y % 1, np.log(ratio * (right - left) / 8), np.log(ratio * (bottom - top) / 8)
        row[[4, 5 + kind]] = 0.8  # together 0.64, which rtmlib leaves out on its own
    return {"output": boxes}


def simcc(n_joints):
    outputs = {}
    for name, at, side in zip(("simcc_x", "simcc_y"), AT, CROP, strict=True):
        outputs[name] = np.zeros((1, n_joints, 2 * side))
        outputs[name][:, :, int(2 * at)] = SCORE
    return outputs


@pytest.fixture(params=["body"])
def model(request):
    return request.param


@pytest.fixture
def options(tmp_path, model):
    folder = tmp_path / "sportmotion"  # rtmlib finds "rtmo" in it
    folder.mkdir()
    people = yolox((PERSON, PERSON_CLASS), (CHAIR, CHAIR_CLASS))
    det_model = network(folder / "yolox.onnx", NETWORK, people)
    pose_model = network(folder / "rtmpose.onnx", CROP[::-1], simcc(MODELS[model][1]))
    write_images(tmp_path / "images" / "cam1")
    start = ["detect", tmp_path / "images" / "cam1", "-o", tmp_path / "pose", "--backend", "rtmlib"]
    return [*start, "--model", model, "--det-model", det_model, "--pose-model", pose_model]


@pytest.mark.parametrize("model", MODELS, indirect=True)
def test_joints_are_where_the_networks_find_them_and_chairs_are_no_people(options, model, tmp_path):
    result = invoke(*options, "--json")
    assert result.exit_code == 0, result.output
    (camera,) = json.loads(result.stdout)["cameras"]
    assert camera["empty"] == 0
    found = read_detections(tmp_path / "pose", ("cam1",))
    layout, n_joints = MODELS[model]
    assert found.layout == layout
    assert found.people_per_frame.tolist() == [[1]] * camera["frames"]
    # the crop is the box, 1.25 times as large and made as slim as 192 × 256, around its middle
    height = 1.25 * max(PERSON[3] - PERSON[1], (PERSON[2] - PERSON[0]) * CROP[1] / CROP[0])
    expected = (90.0, 120.0 + height * (AT[1] / CROP[1] - 0.5), 1.0)
    np.testing.assert_allclose(found.people[0, 0, 0], [expected] * n_joints, atol=1e-3)


def test_an_image_without_a_person(options, tmp_path):
    network(tmp_path / "sportmotion" / "yolox.onnx", NETWORK, yolox((CHAIR, CHAIR_CLASS)))
    result = invoke(*options, "--json")
    (camera,) = json.loads(result.stdout)["cameras"]
    assert camera["empty"] == camera["frames"]
