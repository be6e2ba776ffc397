"""Cases of parametrised tests that repeat with other numbers what others show: for `make test-all` only."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest


def swept(*arguments: Any) -> Any:
    """Return one case, marked."""
    return pytest.param(*arguments, marks=pytest.mark.sweep)


def diagonal(*axes: Any) -> list[Any]:
    """All combinations, marked but for as many as the longest axis has: among those every value occurs."""
    axes = tuple(tuple(axis) for axis in axes)
    kept = {tuple(k % len(axis) for axis in axes) for k in range(max(map(len, axes)))}
    return [
        pytest.param(
            *(axis[i] for axis, i in zip(axes, at, strict=True)),
            marks=() if at in kept else pytest.mark.sweep,
        )
        for at in product(*(range(len(axis)) for axis in axes))
    ]
