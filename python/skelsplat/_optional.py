"""Packages that only some tasks need."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from skelsplat.exceptions import MissingPackageError

if TYPE_CHECKING:
    from types import ModuleType


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
            f"{purpose}: expected the package {module} to be installed, got {error}; "
            f"run: pip install 'skelsplat[{extra}]'"
        ) from error
