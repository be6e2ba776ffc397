"""DeepLabCut's table, whichever file it comes from: columns (scorer, [individual,] bodypart, coordinate)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.detections._format import View, array_view, joints_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skelsplat.io.detections._format import Array

LEVELS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
# DeepLabCut's own name for parts that belong to no individual
_UNIQUE = "single"
_COORDS = ("x", "y", "likelihood")


@dataclass(frozen=True)
class Table:
    """A table as it is read.

    Attributes
    ----------
    path : Path
    levels : tuple of str
        Names of the header's levels.
    columns : sequence of tuple of str
        One entry per level and column, C of them.
    frames : sequence of int
        T frame numbers.
    values : (T, C)
    """

    path: Path
    levels: tuple[str, ...]
    columns: Sequence[tuple[str, ...]]
    frames: Sequence[int]
    values: Array

    def view(self) -> View:
        """Return the view of the camera, one place per individual.

        Raises
        ------
        DatasetError
            If the header is not DeepLabCut's, a coordinate is missing or there twice, individuals have
            different parts, or a likelihood lies outside [0, 1].
        """
        if self.levels not in LEVELS:
            expected = " or ".join("/".join(levels) for levels in LEVELS)
            raise DatasetError(self.path, "header", expected, "/".join(self.levels))
        places = self._places()
        parts = self._parts(places)
        people = np.stack([self._joints(places[who], parts) for who in self._people(places)], axis=1)
        return array_view(self.path, "likelihood", people, frames=self._checked_frames(), names=parts)

    def _places(self) -> dict[str, dict[str, dict[str, int]]]:
        """Column of each individual, part and coordinate."""
        places: dict[str, dict[str, dict[str, int]]] = {}
        scorers = {column[0] for column in self.columns}
        if len(scorers) != 1:
            raise DatasetError(self.path, "scorer", "one scorer", ", ".join(sorted(scorers)) or "none")
        for place, column in enumerate(self.columns):
            who, part, coord = column[1] if len(column) == 4 else "", column[-2], column[-1]
            if coord not in _COORDS:
                raise DatasetError(self.path, "coords", f"{', '.join(_COORDS)} (pixels)", repr(coord))
            there = places.setdefault(who, {}).setdefault(part, {})
            if coord in there:
                raise DatasetError(self.path, f"{part}.{coord}", "one column", "two")
            there[coord] = place
        return places

    def _people(self, places: dict[str, dict[str, dict[str, int]]]) -> list[str]:
        animals = [who for who in places if who != _UNIQUE]
        return animals or list(places)

    def _parts(self, places: dict[str, dict[str, dict[str, int]]]) -> tuple[str, ...]:
        """Names of the parts that every individual has, in the order of the first."""
        people = self._people(places)
        parts = tuple(places[people[0]])
        for who in people:
            if set(places[who]) != set(parts):
                odd = ", ".join(sorted(set(places[who]) ^ set(parts)))
                expected = f"the same parts for every individual ({people[0]}, {who})"
                raise DatasetError(self.path, "bodyparts", expected, f"{odd} for one of them")
            for part, there in places[who].items():
                lacking = [coord for coord in ("x", "y") if coord not in there]
                if lacking:
                    raise DatasetError(self.path, f"{part}.{lacking[0]}", "a column", "none")
        return parts

    def _joints(self, columns: dict[str, dict[str, int]], parts: tuple[str, ...]) -> Array:
        """Joints (T, K, 3) of one individual."""
        xy = np.stack([self.values[:, [columns[p]["x"], columns[p]["y"]]] for p in parts], axis=1)
        sure = [columns[part].get("likelihood") for part in parts]
        likelihood = [np.ones(len(xy)) if place is None else self.values[:, place] for place in sure]
        return joints_of(self.path, "likelihood", xy, np.stack(likelihood, axis=1), clip=False)

    def _checked_frames(self) -> list[int]:
        frames = list(self.frames)
        if not frames or any(b <= a for a, b in pairwise(frames)):
            expected = "frame numbers that ascend"
            raise DatasetError(self.path, "index", expected, "none" if not frames else "others")
        return frames


def camera_part(stem: str) -> str:
    """Cut the name of the network off the name of a result: ``cam1DLC_resnet50_…`` → ``cam1``."""
    return stem.partition("DLC_")[0] or stem
