"""OpenCV for videos and drawing, which only some commands need."""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING

from skelsplat._optional import require

if TYPE_CHECKING:
    from types import ModuleType

_SILENT = 0
_MOST_PIXELS = 2**27  # 400 MB; a file of a few kilobytes can claim more


@cache
def opencv() -> ModuleType:
    """Import OpenCV and keep its own messages off stderr: what fails is an exception of ours.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # read once, when the first video is opened
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(_MOST_PIXELS))  # read once, at the import
    module = require("cv2", "videos", "video")
    getattr(module.utils, "logging", module).setLogLevel(_SILENT)  # in OpenCV 5, and 4
    return module
