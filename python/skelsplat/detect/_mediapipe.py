"""MediaPipe Pose, one person with 33 points; its wheel brings the model, so that nothing is downloaded."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from skelsplat._arrays import Array
from skelsplat._optional import pip_line, require
from skelsplat.detect._detect import Find
from skelsplat.exceptions import MissingPackageError, SkelSplatError, one_of
from skelsplat.io.video import Image

_COMPLEXITY = {"lite": 0, "full": 1, "heavy": 2}


@dataclass(frozen=True)
class MediaPipe:
    """MediaPipe Pose (BlazePose): the most prominent person of each image, 33 points.

    The confidence is MediaPipe's visibility. Points outside of the image are where the model expects them.
    The landmarks in metres are not used: the cameras' calibration says more. In a video the person is
    followed from image to image, without MediaPipe's own smoothing.

    Parameters
    ----------
    model : {"full", "lite", "heavy"}
        ``full`` is in MediaPipe's wheel; MediaPipe downloads the others when they are first used.
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
            expected = f"expected MediaPipe to load '{self.model}'"
            hint = "" if self.model == "full" else " (it downloads this model when it is first used)"
            raise SkelSplatError(f"model: {expected}{hint}, got {error}") from error
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
