"""Packages that only some tasks need, and the extras of this package that install them."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import os
import re
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, requires
from typing import TYPE_CHECKING

from skelsplat.exceptions import MissingPackageError

if TYPE_CHECKING:
    from types import ModuleType

_MOST_PIXELS = 2**27  # of an image, 400 MB; a file of a few kilobytes can claim more
DRAWING = ("matplotlib", "plotly")  # what figures and report.html need: the extra viz


def pip_line(extra: str) -> str:
    """Return the command that installs an extra, and where to run it if that matters."""
    own = " in an environment of its own, as it needs NumPy 1" if extra == "mediapipe" else ""
    return f"pip install 'skelsplat[{extra}]'{own}"


def requirements(extra: str) -> list[str]:
    """Return what an extra adds, as pip takes it; its name where this package is not installed itself."""
    with contextlib.suppress(PackageNotFoundError):
        of_extra = re.compile(rf"extra == ['\"]{extra}['\"]")
        return [one.partition(";")[0] for one in requires("skelsplat") or () if of_extra.search(one)]
    return [extra]


def pip_words(extra: str) -> list[str]:
    """Return pip with the words that install what an extra adds, and say only what goes wrong."""
    return ["pip", "install", "--quiet", "--disable-pip-version-check", *requirements(extra)]


def can_draw() -> bool:
    """Tell whether the packages of the extra ``viz`` are installed, without importing them."""
    return all(importlib.util.find_spec(name) is not None for name in DRAWING)


def check_installed(module: str, purpose: str, extra: str = "formats") -> None:
    """Raise as `require` does if a module is not installed, without importing it."""
    package = module.partition(".")[0]
    if package not in sys.modules and importlib.util.find_spec(package) is not None:
        return
    require(module, purpose, extra)


def require(module: str, purpose: str, extra: str = "formats") -> ModuleType:
    """Import `module`, which `purpose` needs and `extra` installs, or raise `MissingPackageError`."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackageError(
            f"{purpose}: expected the package {module} to be installed, got {error}; run: {pip_line(extra)}"
        ) from error


@cache
def opencv(purpose: str = "videos") -> ModuleType:
    """Import OpenCV, or raise as `require`; what fails in it is an exception, without messages of its own."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # read once, when the first video is opened
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(_MOST_PIXELS))  # read once, at the import
    module = require("cv2", purpose, "video")
    getattr(module.utils, "logging", module).setLogLevel(0)  # in OpenCV 5, and 4
    return module
