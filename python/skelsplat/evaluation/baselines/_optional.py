"""Modules that only the baselines need."""

from __future__ import annotations

import importlib
from types import ModuleType


def require(module: str) -> ModuleType:
    """Import ``module`` of the optional extra ``evaluation``.

    Raises
    ------
    ImportError
        If it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f"this baseline needs {module}: expected it to be installed, got {error}; "
            "run: pip install 'skelsplat[evaluation]'"
        ) from error
