"""RTMPose by rtmlib: several people with 17, 26 or 133 points; networks are downloaded, or files given."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._optional import require
from skelsplat.detect._detector import Find
from skelsplat.exceptions import DatasetError, InvalidInputError, SkelSplatError, one_of
from skelsplat.io.video import Image

# rtmlib's class, and the layout
_MODELS = {
    "body-feet": ("BodyWithFeet", "halpe26"),
    "body": ("Body", "coco17"),
    "whole-body": ("Wholebody", "wholebody133"),
}
_MODES = ("balanced", "lightweight", "performance")


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
        ONNX files of YOLOX and of a two-stage RTMPose to use instead.
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
        if self.pose_model is not None and "rtmo" in self.pose_model.name.lower():
            expected = "a two-stage model (RTMPose), whose people --det-model finds"
            raise InvalidInputError(f"pose_model: expected {expected}, got {self.pose_model}")

    @property
    def layout(self) -> str:
        """Name of the joint layout."""
        return _MODELS[self.model][1]

    @property
    def settings(self) -> Mapping[str, str]:
        """Backend, its version and the networks."""
        require("rtmlib", "detect", "rtmlib")
        files = {"det_model": self.det_model, "pose_model": self.pose_model}
        given = {name: path.name for name, path in files.items() if path is not None}
        return {"backend": "rtmlib", "version": _version(), "model": self.model, "mode": self.mode, **given}

    @contextmanager
    def open(self) -> Iterator[Find]:
        """Begin a camera; the networks are loaded once."""
        solution = _loaded(self)
        yield lambda image: self._people(solution, image)

    def _people(self, solution: Any, image: Image) -> Array:
        """Return the people in an image (P, N, 3)."""
        n_joints = sk.layouts.get(self.layout).n_joints
        boxes = solution.det_model(image)
        if len(boxes) == 0:  # without boxes, RTMPose takes the whole image for a person
            return np.empty((0, n_joints, 3))
        pixels, scores = solution.pose_model(image, bboxes=boxes)
        if np.shape(pixels)[1:] != (n_joints, 2):
            expected = f"a network of {n_joints} points (the model {self.model})"
            raise InvalidInputError(f"pose_model: expected {expected}, got one of {np.shape(pixels)[1]}")
        return np.concatenate([pixels, np.clip(scores, 0.0, 1.0)[..., None]], axis=-1)


def _version() -> str:
    try:
        return version("rtmlib")
    except PackageNotFoundError:
        return "unknown"


@cache
def _loaded(detector: RTMLib) -> Any:
    """Return rtmlib's solution with its networks loaded."""
    kind = getattr(require("rtmlib", "detect", "rtmlib"), _MODELS[detector.model][0])
    files = {"det": detector.det_model, "pose": detector.pose_model}
    given = {name: str(path) for name, path in files.items() if path is not None}
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints what it loads
            solution = kind(**given, mode=detector.mode, backend="onnxruntime", device=detector.device)
    except Exception as error:  # whatever downloading and loading meet
        expected = "expected rtmlib to download and load its networks, or files (det_model, pose_model)"
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SkelSplatError(f"rtmlib: {expected}, got {reason}") from error
    # a file says for which size it was made; rtmlib knows only those of its own networks
    if detector.det_model is not None:
        _resize(solution.det_model, slice(None))
    if detector.pose_model is not None:
        _resize(solution.pose_model, slice(None, None, -1))
    return solution


def _resize(network: Any, order: slice) -> None:
    """Set the input size to the file's, height and width in this order, unless the file leaves it open."""
    size = tuple(network.session.get_inputs()[0].shape[-2:])
    if all(isinstance(side, int) for side in size):
        network.model_input_size = size[order]
