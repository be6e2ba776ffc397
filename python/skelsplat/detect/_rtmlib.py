"""RTMPose by rtmlib: several people with 17, 26 or 133 points; it downloads its networks."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._optional import require
from skelsplat.detect._detect import Find
from skelsplat.exceptions import SkelSplatError, one_of
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
