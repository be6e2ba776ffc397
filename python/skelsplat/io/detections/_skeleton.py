"""The skeleton that a detector's file holds: names of its joints and, where it has them, its edges."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skelsplat._budget import check_document, read_text
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import array_names, as_numbers
from skelsplat.io.detections._animals import is_sleap, sleap_file
from skelsplat.io.detections._format import DetectionFormat, View
from skelsplat.io.detections._registry import find_format, first_file

_YAML = (".yaml", ".yml")
# single- and multi-animal projects; the latter writes "MULTI!" under the former
_PARTS = ("multianimalbodyparts", "bodyparts")


class Skeleton(NamedTuple):
    """Names of N joints in the order of the file, and pairs of places that are connected (none: unknown)."""

    names: tuple[str, ...]
    edges: tuple[tuple[int, int], ...]


def read_skeleton(path: str | os.PathLike[str]) -> Skeleton:
    """Read the skeleton of detections: of a file, or of the first in a folder that `read_detections` takes.

    SLEAP's analysis h5 has names and edges; DeepLabCut's h5 and csv, and other formats in which joints have
    names, only these; DeepLabCut's project file ``config.yaml`` has both.
    """
    file = Path(path)
    if file.suffix.lower() in _YAML:
        return _dlc_project(file)
    form = find_format(file, None)
    file = first_file(file, form)
    if is_sleap(file):
        return _sleap(file)
    joints = _first_view(file, form).joints
    if joints is None:
        actual = f"{form.name}, where they have numbers"
        raise DatasetError(file, "joint names", "a format in which joints have names", actual)
    return Skeleton(joints, ())


def _first_view(path: Path, form: DetectionFormat) -> View:
    """Return the view of a camera, or the first one in a file of all."""
    try:
        if form.file is not None:
            return form.file(path)
    except DatasetError:
        if form.recording is None:
            raise
    if form.recording is None:
        return View(path, (), lambda _: ())
    return next(iter(form.recording(path, None).views.values()))


def _sleap(path: Path) -> Skeleton:
    arrays = sleap_file(path)["arrays"]
    names, edges = np.asarray(arrays.get("node_names", [])), np.asarray(arrays.get("edge_inds", []))
    known = array_names(path, "node_names", names, names.size)
    places = as_numbers(path, "edge_inds", edges) if edges.size else np.empty((0, 2))
    if places.ndim != 2 or places.shape[1] != 2 or not np.isin(places, range(len(known))).all():
        raise DatasetError(path, "edge_inds", f"pairs of places from 0 to {len(known) - 1}", edges.tolist())
    return Skeleton(known, tuple((int(a), int(b)) for a, b in places))


def _dlc_project(path: Path) -> Skeleton:
    text = read_text(path)
    check_document(path, text)
    lists = _yaml_lists(text)
    names = next((lists[key] for key in _PARTS if lists.get(key)), [])
    if not names or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
        expected = "a list of different names, as in a DeepLabCut project's config.yaml"
        raise DatasetError(path, "bodyparts", expected, names or "none")
    edges, places = [], {name: place for place, name in enumerate(names)}
    for pair in lists.get("skeleton", []):
        if not isinstance(pair, list) or len(pair) != 2:
            raise DatasetError(path, "skeleton", "pairs of parts", pair)
        if all(
            isinstance(part, str) and part in places for part in pair
        ):  # else of the template, or a part of no individual
            edges.append((places[pair[0]], places[pair[1]]))
    return Skeleton(tuple(names), tuple(edges))


def _yaml_lists(text: str) -> dict[str, list[Any]]:
    """Return the top-level lists of names, or of lists of names, of a YAML document; all else is passed over.

    Lists are written as a line ``- item`` per item, or ``[item, item]``; of a list of lists, ``- - item``
    begins one.
    """
    lists: dict[str, list[Any]] = {}
    current: list[Any] = []
    for line in text.splitlines():
        bare = re.sub(r"(^|\s)#.*", "", line).rstrip()
        key = re.match(r"(\w+):\s*(.*)$", bare)
        if key:
            current = lists[key[1]] = _flow(key[2]) if key[2].startswith("[") else []
            continue
        item = re.match(r"\s*((?:-\s+)+)(.+)$", bare)
        if item is None:
            continue
        value: Any = _flow(item[2]) if item[2].startswith("[") else _unquoted(item[2])
        nested = bool(current) and isinstance(current[-1], list)
        if item[1].count("-") > 1:
            current.append([value])
        elif nested and bare.startswith(" ") and isinstance(value, str):
            current[-1].append(value)
        else:
            current.append(value)
    return lists


def _flow(text: str) -> list[Any]:
    """Return a list in brackets, or one of such lists."""
    inner = re.findall(r"\[([^\[\]]*)\]", text)
    lists = [[_unquoted(part) for part in one.split(",") if part.strip()] for one in inner]
    return lists if text.startswith("[[") else (lists[0] if lists else [])


def _unquoted(text: str) -> str:
    return text.strip().strip("'\"")
