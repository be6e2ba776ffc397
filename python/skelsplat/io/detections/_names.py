"""Names in arrays: of joints and of cameras."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    from pathlib import Path


def array_names(path: Path, field: str, value: object, count: int) -> tuple[str, ...]:
    """Return `count` different names, text or bytes, or raise `DatasetError`."""
    array = np.asarray(value)
    if array.shape != (count,) or array.dtype.kind not in "USO":
        raise DatasetError(path, field, f"{count} names", f"{array.dtype} of shape {array.shape}")
    names = tuple(
        entry.decode("utf-8", "replace") if isinstance(entry, bytes) else str(entry)
        for entry in array.tolist()
    )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DatasetError(path, field, "different names", f"{twice[0]!r} twice")
    return names
