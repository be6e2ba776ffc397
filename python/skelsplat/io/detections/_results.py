"""Lists of ``{"image_id", "keypoints": [x, y, c, …], "score"}``: what AlphaPose and COCO results share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import Person, View, list_view
from skelsplat.io.detections._json import as_list, load_json, member
from skelsplat.io.detections.openpose import triples

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@dataclass(frozen=True)
class Entry:
    """One person as the file has it: frame number, where it stands, and its keypoints."""

    frame: int
    field: str
    keypoints: Any


def read_entries(path: Path, document: str, frame_of: Callable[[Path, str, object], int]) -> list[Entry]:
    """Return the people of a results file; `frame_of` turns an image_id into a frame number."""
    found = as_list(path, "document", load_json(path, document), f"{document}, a list of people")
    entries = []
    for index, person in enumerate(found):
        where = f"[{index}]"
        image = member(path, where, person, "image_id", "the image of the person")
        keypoints = member(path, where, person, "keypoints", "a list of numbers x, y, confidence")
        entries.append(Entry(frame_of(path, f"{where}.image_id", image), f"{where}.keypoints", keypoints))
    if not entries:
        raise DatasetError(path, "document", f"{document}, a list of people", "an empty list")
    return entries


def view_of(path: Path, entries: list[Entry]) -> View:
    """Return the view; confidences above 1, maxima of heat maps, are clipped.

    An image in which nobody was found is not in the file.
    """
    people: dict[int, list[Person]] = {}
    for entry in entries:
        person = triples(path, entry.field, entry.keypoints, clip=True)
        people.setdefault(entry.frame, []).append(person)
    return replace(list_view(path, people), flat=True, sparse=True)
