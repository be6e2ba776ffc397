"""What OpenCV's ``FileStorage`` writes as YAML or XML, read without OpenCV.

Its YAML is not what other parsers read: the header is ``%YAML:1.0`` and matrices carry the tag
``!!opencv-matrix``. Read here: numbers, texts, lists of texts (``- a`` lines or ``[a, b]``) and matrices, at
the top level; of XML the matrices.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import whole_number

_KEY = re.compile(r"^([^\s:#%-][^:]*?)\s*:(?:\s+(.*))?$")
_MATRIX = "!!opencv-matrix"


def matrices_of_xml(path: Path, root: ET.Element) -> dict[str, list[list[float]]]:
    """Return the matrices beneath the root of an XML document, rows × columns."""
    parts = {node.tag: {child.tag: child.text or "" for child in node} for node in root if len(node)}
    return {key: _matrix(path, key, matrix) for key, matrix in parts.items()}


def is_opencv_yaml(text: str) -> bool:
    """Whether a text is what ``FileStorage`` writes: the header ``%YAML`` or a matrix with OpenCV's tag."""
    return text.lstrip().startswith("%YAML") or _MATRIX in text


def parse_opencv_yaml(path: Path, text: str) -> dict[str, Any]:
    """Return the top-level entries: matrices and lists as nested lists, numbers, texts."""
    entries: dict[str, Any] = {}
    for key, line, value, block in _blocks(path, text):
        if key in entries:
            raise DatasetError(path, f"{key} (line {line})", "a key once", "the same key again")
        if value.startswith(_MATRIX):
            parts = dict(re.findall(r"(\w+)\s*:\s*(\[[^\]]*\]?|\S+)", " ".join(block)))
            entries[key] = _matrix(path, key, parts, closed=True)
        elif value.startswith("["):
            inside = " ".join([value, *block]).strip("[] ")
            entries[key] = [_scalar(part.strip()) for part in inside.split(",") if part.strip()]
        elif value:
            entries[key] = _scalar(value)
        else:
            entries[key] = [_scalar(item.removeprefix("-").strip()) for item in block]
    return entries


def _blocks(path: Path, text: str) -> Iterator[tuple[str, int, str, list[str]]]:
    """Yield key, line number, what stands behind the key, and the stripped indented lines below it."""
    current: tuple[str, int, str, list[str]] | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if not stripped or stripped.startswith(("%YAML", "#")) or stripped in ("---", "..."):
            continue
        indented = line[:1].isspace() or stripped.startswith("- ")
        found = None if indented else _KEY.match(stripped)
        if found:
            if current is not None:
                yield current
            current = (found[1].strip("\"'"), number, (found[2] or "").strip(), [])
        elif indented and current is not None:
            current[3].append(stripped)
        else:
            raise DatasetError(path, f"line {number}", "key: value", repr(stripped[:60]))
    if current is not None:
        yield current


def _matrix(path: Path, key: str, parts: Mapping[str, str], *, closed: bool = False) -> list[list[float]]:
    """Return rows × columns of a matrix, whose data, if `closed`, must end in a bracket."""
    missing = [name for name in ("rows", "cols", "data") if not parts.get(name)]
    if missing:
        raise DatasetError(path, key, "a matrix with rows, cols and data", f"no {', '.join(missing)}")
    data = parts["data"]
    try:
        shape = int(parts["rows"]), int(parts["cols"])
        values = [float(part) for part in data.strip("[]").replace(",", " ").split()]
    except ValueError as error:
        raise DatasetError(path, key, "a matrix of numbers", error) from error
    if (closed and not data.endswith("]")) or min(shape) < 0 or len(values) != shape[0] * shape[1]:
        expected = f"{shape[0]}×{shape[1]} numbers{' in a closed list' if closed else ''}"
        raise DatasetError(path, key, expected, f"{len(values)} numbers")
    rows: list[list[float]] = np.reshape(values, shape).tolist()
    return rows


def _scalar(text: str) -> Any:
    """Return a number or a text; a quoted number stays a text, and so does one with leading zeros."""
    if text[:1] in "\"'":
        return text[1:-1] if text[-1:] == text[:1] and len(text) > 1 else text
    if re.fullmatch(r"[-+]?(0|[1-9]\d*)", text):
        return whole_number(text)
    if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text) and not text.isdigit():
        return float(text)
    return text
