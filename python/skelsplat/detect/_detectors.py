"""The detectors: MediaPipe Pose, whose wheel brings its model, and RTMPose by rtmlib, which downloads it."""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._optional import pip_line, require
from skelsplat.detect._detect import Find
from skelsplat.exceptions import MissingPackageError, SkelSplatError, one_of
from skelsplat.io.video import Image

_COMPLEXITY = {"lite": 0, "full": 1, "heavy": 2}  # of MediaPipe
# rtmlib's class, and the layout
_MODELS = {
    "body-feet": ("BodyWithFeet", "halpe26"),
    "body": ("Body", "coco17"),
    "whole-body": ("Wholebody", "wholebody133"),
}
_MODES = ("balanced", "lightweight", "performance")


@dataclass(frozen=True)
class MediaPipe:
    """MediaPipe Pose (BlazePose): the most prominent person of each image, 33 points.

    The confidence is MediaPipe's visibility. Points outside of the image are where the model expects them. In
    a video the person is followed from image to image, without MediaPipe's own smoothing. The model ``full``
    is in MediaPipe's wheel; MediaPipe downloads ``lite`` and ``heavy`` when they are first used.
    """

    model: str = "full"

    layout: ClassVar[str] = "mediapipe33"
    follows: ClassVar[bool] = True

    def __post_init__(self) -> None:
        one_of("model", self.model, _COMPLEXITY)

    @property
    def settings(self) -> Mapping[str, str]:
        """Backend, its version and the model."""
        return {"backend": "mediapipe", "version": str(_module().__version__), "model": self.model}

    @contextmanager
    def open(self) -> Iterator[Find]:
        """Begin a camera."""
        try:
            pose = _module().solutions.pose.Pose(
                static_image_mode=False,
                model_complexity=_COMPLEXITY[self.model],
                smooth_landmarks=False,  # the refinement over time knows the noise better
            )
        except (OSError, RuntimeError, ValueError) as error:
            expected = f"expected MediaPipe to load '{self.model}' (it downloads lite and heavy at first)"
            raise SkelSplatError(f"model: {expected}, got {error}") from error
        with contextlib.closing(pose):
            yield lambda image: _people(pose, image)


def _module() -> Any:
    """Import MediaPipe, of a version that still has the interface whose model it brings."""
    os.environ.setdefault("GLOG_minloglevel", "2")  # read once, when it is loaded
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, of packages that it imports
        module = require("mediapipe", "detect", "mediapipe")
    if not hasattr(module, "solutions"):
        raise MissingPackageError(
            "detect: expected a MediaPipe with mediapipe.solutions (0.10.21 is the last), got version "
            f"{module.__version__}; run: {pip_line('mediapipe')}"
        )
    return module


def _people(pose: Any, image: Image) -> Array:
    """Return the person in an image, (1, 33, 3), or nobody, (0, 33, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # protobuf's
        found = pose.process(np.ascontiguousarray(image[..., ::-1])).pose_landmarks
    if not found:
        return np.empty((0, 33, 3))
    points = np.array([(point.x, point.y, point.visibility) for point in found.landmark])
    scaled: Array = points * (image.shape[1], image.shape[0], 1.0)
    return scaled[None]


@dataclass(frozen=True)
class RTMLib:
    """RTMPose as rtmlib runs it: YOLOX finds people, RTMPose their joints.

    Every image is on its own. The confidence is RTMPose's score, clipped to [0, 1]. rtmlib downloads the
    networks when they are first used, and keeps them.

    Parameters
    ----------
    model : {"body-feet", "body", "whole-body"}
        rtmlib's `BodyWithFeet` (layout ``halpe26``), `Body` (``coco17``) or `Wholebody` (133 points).
    mode : {"balanced", "lightweight", "performance"}
        rtmlib's choice of networks.
    device : str
        What onnxruntime computes on, such as ``cpu`` or ``cuda``.
    """

    model: str = "body-feet"
    mode: str = "balanced"
    device: str = "cpu"

    follows: ClassVar[bool] = False

    def __post_init__(self) -> None:
        one_of("model", self.model, _MODELS)
        one_of("mode", self.mode, _MODES)

    @property
    def layout(self) -> str:
        """Name of the joint layout."""
        return _MODELS[self.model][1]

    @property
    def settings(self) -> Mapping[str, str]:
        """Backend, its version and the networks."""
        require("rtmlib", "detect", "rtmlib")
        version = import_module("rtmlib.version").__version__
        return {"backend": "rtmlib", "version": version, "model": self.model, "mode": self.mode}

    @contextmanager
    def open(self) -> Iterator[Find]:
        """Begin a camera; the networks are loaded once."""
        solution = _loaded(self)
        yield lambda image: self._people(solution, image)

    def _people(self, solution: Any, image: Image) -> Array:
        """Return the people in an image (P, N, 3)."""
        boxes = solution.det_model(image)
        if len(boxes) == 0:  # without boxes, RTMPose takes the whole image for a person
            return np.empty((0, sk.layouts.get(self.layout).n_joints, 3))
        pixels, scores = solution.pose_model(image, bboxes=boxes)
        return np.concatenate([pixels, np.clip(scores, 0.0, 1.0)[..., None]], axis=-1)


@cache
def _loaded(detector: RTMLib) -> Any:
    """Return rtmlib's solution with its networks loaded."""
    kind = getattr(require("rtmlib", "detect", "rtmlib"), _MODELS[detector.model][0])
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints what it loads
            return kind(mode=detector.mode, backend="onnxruntime", device=detector.device)
    except Exception as error:  # whatever downloading, loading and onnxruntime meet
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SkelSplatError(f"rtmlib: expected it to load its networks, got {reason}") from error
