"""Cameras placed by the people who are filmed: a first guess, adjusted; of several people, who is who."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat._arrays import Array
from skelsplat._skelsplat import Camera, Layout, RefineConfig
from skelsplat._start import LEAST_JOINTS, Start, first_guess
from skelsplat._who import GAP, one_after_another, taken, told_by_lines, told_by_rig
from skelsplat.cameras import altered
from skelsplat.exceptions import DegenerateGeometryError

# How often several people are told apart by the cameras that were found.
_ROUNDS = 1


@dataclass(frozen=True)
class Task:
    """What is known, and what to find."""

    cameras: Sequence[Camera]  # without places
    lenses: Sequence[Camera]  # the same, as their images are read
    layout: Layout
    focal: bool
    same_focal: bool
    clock: bool
    most_lag: int
    fps: float | None
    config: RefineConfig

    def solved(self, people: Array) -> tuple[list[Array], Start, list[Camera], dict[str, Any]]:
        """Return everybody's detections (T', M, N, D) among people (T, M, P, N, D), a first guess, and a rig.

        Several people are told apart by pairs of views, and then by the cameras that were found.
        """
        several = people.shape[2] > 1
        places = told_by_lines(people, self.lenses, self.most_lag) if several else []
        everyone = taken(people, places) if several else [people[:, :, 0]]
        start = self.guessed(everyone, several)
        guess = {i: (start.cameras[i], float(start.clocks[i])) for i in start.cameras}
        cameras, found = self.adjusted(everyone, guess)
        for _ in range(_ROUNDS if several else 0):
            used = [int(i) for i in np.flatnonzero(found["used"])]
            clocks = {i: float(found["clock"][i]) for i in used}
            again = told_by_rig(people, {i: cameras[i] for i in used}, clocks, self.layout, self.fps)
            if not again or np.array_equal(again, places):
                break
            places, everyone = again, taken(people, again)
            cameras, found = self.adjusted(everyone, {i: (cameras[i], clocks[i]) for i in used})
        return everyone, start, cameras, found

    def together(self, everyone: Sequence[Array]) -> Array:
        """Return the detections of everybody as those of one recording."""
        return one_after_another(everyone, max(GAP, self.most_lag))

    def guessed(self, everyone: Sequence[Array], several: bool) -> Start:
        """Return a first guess of the rig."""
        start = None
        if everyone:
            start = first_guess(self.together(everyone), self.lenses, self.layout, self.most_lag)
        if start is None:
            expected, got = f"at least {LEAST_JOINTS} joints that two views see in the same frames", "fewer"
            if several:
                expected = "people whom two views see at the same time"
                got = "none that can be told apart: film one person who walks about, or choose a person"
            raise DegenerateGeometryError(f"detections: expected {expected}, got {got}")
        return start

    def adjusted(
        self, everyone: Sequence[Array], guess: Mapping[int, tuple[Camera, float]]
    ) -> tuple[list[Camera], dict[str, Any]]:
        """Return all cameras, adjusted from a guess of some and their clocks."""
        placed = list(self.cameras)
        clocks: list[float | None] = [None] * len(placed)
        for i, (camera, clock) in guess.items():
            placed[i], clocks[i] = altered(placed[i], R=camera.R, t=camera.t), clock
        unknown = {"focal": self.focal, "same_focal": self.same_focal, "clock": self.clock or any(clocks)}
        seen = self.together(everyone)
        return _skelsplat.calibrate_cameras(seen, placed, clocks, self.layout, **unknown, config=self.config)
