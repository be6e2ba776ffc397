"""Packages that only some tasks need, and the extras of this package that install them."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from typing import TYPE_CHECKING

from skelsplat.exceptions import MissingPackageError

if TYPE_CHECKING:
    from types import ModuleType

DRAWING = ("matplotlib", "plotly")  # what figures and report.html need: the extra viz


def pip_line(extra: str) -> str:
    """Return the command that installs an extra, and where to run it if that matters."""
    own = " in an environment of its own, as it needs NumPy 1" if extra == "mediapipe" else ""
    return f"pip install 'skelsplat[{extra}]'{own}"


def can_draw() -> bool:
    """Tell whether the packages of the extra ``viz`` are installed, without importing them."""
    return all(importlib.util.find_spec(name) is not None for name in DRAWING)


def check_installed(module: str, purpose: str) -> None:
    """Raise as `require` does if a module is not installed, without importing it."""
    package = module.partition(".")[0]
    if package not in sys.modules and importlib.util.find_spec(package) is not None:
        return
    require(module, purpose)


def require(module: str, purpose: str, extra: str = "formats") -> ModuleType:
    """Import `module`, which `purpose` needs and the optional `extra` of this package installs.

    Raises
    ------
    MissingPackageError
        If it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackageError(
            f"{purpose}: expected the package {module} to be installed, got {error}; run: {pip_line(extra)}"
        ) from error
