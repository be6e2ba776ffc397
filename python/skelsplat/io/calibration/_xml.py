"""Attributes of XML elements as numbers, with an error that names file and field."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET
    from pathlib import Path

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]


def child(path: Path, key: str, node: ET.Element, tag: str) -> ET.Element:
    """Return the first element of that name beneath `node`; `key` is where `node` stands."""
    found = node.find(tag)
    if found is None:
        raise DatasetError(path, f"{key}.{tag}", f"an element <{tag.rpartition('/')[2]}>", "none")
    return found


def attribute(path: Path, key: str, node: ET.Element, name: str) -> str:
    """Return an attribute that must be there."""
    value = node.get(name)
    if value is None:
        raise DatasetError(path, f"{key}.{name}", "an attribute", "nothing (it is missing)")
    return value


def numbers(path: Path, key: str, node: ET.Element, name: str, count: int) -> Array:
    """Return `count` finite numbers of an attribute, separated by blanks."""
    text = attribute(path, key, node, name)
    what = "a finite number" if count == 1 else f"{count} finite numbers"
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        raise DatasetError(path, f"{key}.{name}", what, repr(text)) from None
    if values.size != count or not np.isfinite(values).all():
        raise DatasetError(path, f"{key}.{name}", what, repr(text))
    return values
