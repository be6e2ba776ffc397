"""OpenCV for videos and drawing, which only some commands need."""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING

from skelsplat._optional import require

if TYPE_CHECKING:
    from types import ModuleType


@cache
def opencv() -> ModuleType:
    """Import OpenCV and keep its own messages off stderr: what fails is an exception of ours.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # read once, when the first video is opened
    module = require("cv2", "videos", "video")
    module.utils.logging.setLogLevel(module.utils.logging.LOG_LEVEL_SILENT)
    return module
