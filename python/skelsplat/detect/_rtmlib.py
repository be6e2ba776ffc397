"""RTMPose by rtmlib: several people with 17, 26 or 133 points; networks are downloaded, or files given."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar
from zlib import crc32

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._budget import read_bytes
from skelsplat._optional import require
from skelsplat.detect._detect import Find
from skelsplat.exceptions import DatasetError, InvalidInputError, SkelSplatError, one_of
from skelsplat.io.video import Image

# rtmlib's class, and the layout
_MODELS = {
    "body-feet": ("BodyWithFeet", "halpe26"),
    "body": ("Body", "coco17"),
    "whole-body": ("Wholebody", "wholebody133"),
}
_MODES = ("balanced", "lightweight", "performance")
_SCORE = 0.3  # of a person, as rtmlib has it for its own networks; for others it has 0.7, which loses people


@dataclass(frozen=True)
class RTMLib:
    """RTMPose as rtmlib runs it: YOLOX finds people, RTMPose their joints.

    Every image is on its own. The confidence is RTMPose's score, clipped to [0, 1].

    Parameters
    ----------
    model : {"body-feet", "body", "whole-body"}
        rtmlib's `BodyWithFeet` (layout ``halpe26``), `Body` (``coco17``) or `Wholebody` (133 points).
    mode : {"balanced", "lightweight", "performance"}
        rtmlib's choice of networks, which it downloads when they are first used.
    det_model, pose_model : path, optional
        ONNX files of YOLOX and of a two-stage RTMPose to use instead. The first class of a YOLOX is a person,
        as in COCO; others are left out.
    device : str
        What onnxruntime computes on, such as ``cpu`` or ``cuda``.
    """

    model: str = "body-feet"
    mode: str = "balanced"
    det_model: Path | None = None
    pose_model: Path | None = None
    device: str = "cpu"

    follows: ClassVar[bool] = False

    def __post_init__(self) -> None:
        one_of("model", self.model, _MODELS)
        one_of("mode", self.mode, _MODES)
        for path in (self.det_model, self.pose_model):
            if path is not None and not path.is_file():
                raise DatasetError(path, "model", "an ONNX file", "no such file")

    @property
    def layout(self) -> str:
        """Name of the joint layout."""
        return _MODELS[self.model][1]

    @property
    def settings(self) -> Mapping[str, str]:
        """Backend, its version and the networks."""
        require("rtmlib", "detect", "rtmlib")
        files = {"det_model": self.det_model, "pose_model": self.pose_model}
        # with a checksum, since MMDeploy calls every network end2end.onnx
        given = {name: f"{path.name} {crc32(read_bytes(path)):08x}" for name, path in files.items() if path}
        version = import_module("rtmlib.version").__version__
        return {"backend": "rtmlib", "version": version, "model": self.model, "mode": self.mode, **given}

    @contextmanager
    def open(self) -> Iterator[Find]:
        """Begin a camera; the networks are loaded once."""
        solution = _loaded(self)
        yield lambda image: self._people(solution, image)

    def _people(self, solution: Any, image: Image) -> Array:
        """Return the people in an image (P, N, 3)."""
        n_joints = sk.layouts.get(self.layout).n_joints
        with _failing("rtmlib: expected networks that run on an image"):
            boxes = solution.det_model(image)
            if len(boxes) == 0:  # without boxes, RTMPose takes the whole image for a person
                return np.empty((0, n_joints, 3))
            pixels, scores = solution.pose_model(image, bboxes=boxes)
        if pixels.shape[1] != n_joints:
            expected = f"RTMPose of {n_joints} points"
            raise InvalidInputError(f"pose_model: expected {expected}, got {pixels.shape[1]} points")
        return np.concatenate([pixels, np.clip(scores, 0.0, 1.0)[..., None]], axis=-1)


@contextmanager
def _failing(expected: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # whatever downloading, loading and onnxruntime meet
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SkelSplatError(f"{expected}, got {reason}") from error


@cache
def _loaded(detector: RTMLib) -> Any:
    """Return rtmlib's solution with its networks loaded."""
    module, name = require("rtmlib", "detect", "rtmlib"), _MODELS[detector.model][0]
    if name == "Body" and detector.pose_model is not None:
        name = "BodyWithFeet"  # the same two networks; Body downloads another if "rtmo" is anywhere in a path
    files = {"det": detector.det_model, "pose": detector.pose_model}
    given = {name: str(path) for name, path in files.items() if path is not None}
    expected = "rtmlib: expected it to download and load its networks, or files (det_model, pose_model)"
    with _failing(expected), contextlib.redirect_stdout(io.StringIO()):  # it prints what it loads
        kind = getattr(module, name)
        solution = kind(**given, mode=detector.mode, backend="onnxruntime", device=detector.device)
    boxes, joints = solution.det_model, solution.pose_model
    # a file states its size, if any; rtmlib has YOLOX's as height, width and RTMPose's as width, height
    for network, path, order in ((boxes, detector.det_model, 1), (joints, detector.pose_model, -1)):
        size = tuple(network.session.get_inputs()[0].shape[-2:])
        if path is not None and all(isinstance(side, int) for side in size):
            network.model_input_size = size[::order]
    boxes.score_thr = _SCORE
    infer = boxes.inference
    boxes.inference = lambda image: _people_alone(infer(image))
    return solution


def _people_alone(outputs: list[Array]) -> list[Array]:
    """Return YOLOX's boxes of people alone, since rtmlib mixes all classes; the first is a person."""
    boxes, *labels = outputs
    if labels:  # with NMS
        return [boxes[:, labels[0][0] == 0]]
    return [boxes[..., :6]]  # place, size and score, then a number per class
