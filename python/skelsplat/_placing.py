"""Cameras placed by the people who are filmed: a first guess, adjusted; of several people, who is who."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat._arrays import Array, Index, take_people
from skelsplat._refine import Progress
from skelsplat._skelsplat import Camera, Layout, RefineConfig
from skelsplat._start import LEAST_JOINTS, Start, first_guess
from skelsplat._who import GAP, first_frames, one_after_another, taken, told_by_lines, told_by_rig
from skelsplat.cameras import altered
from skelsplat.exceptions import DegenerateGeometryError


@dataclass
class Steps:
    """How many steps are done, of those known: a pair of views is one, all of them are as long as a fit."""

    report: Progress
    pairs: int
    done: int = 0
    known: int = 0

    def take(self, count: int = 1) -> None:
        """Report so many more as done."""
        self.done += count
        self.report(self.done, self.known)


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
    steps: Steps

    def solved(self, people: Array) -> tuple[list[Array], Start, list[Camera], dict[str, Any]]:
        """Return everybody's detections (T', M, N, D) among people (T, M, P, N, D), a first guess, and a rig.

        A camera that was moved while it recorded is placed by the longer part of its detections: ``spans``
        has the first frame and the end of those that count, by view.
        """
        spans: dict[int, tuple[int, int]] = {}
        for _ in self.cameras:
            everyone, start, cameras, found = self.told_apart(people)
            if found["moved"] is None:
                break
            view, since = found["moved"]
            first, end = spans.get(view, (0, len(people)))
            spans[view] = (first, since) if since - first > end - since else (since, end)
            people = people.copy()
            people[: spans[view][0], view] = people[spans[view][1] :, view] = np.nan
        self.steps.take(self.steps.known - self.steps.done)
        return everyone, start, cameras, found | {"spans": spans}

    def told_apart(self, people: Array) -> tuple[list[Array], Start, list[Camera], dict[str, Any]]:
        """Return what `solved` does, of cameras that stay.

        Several people are told apart by pairs of views, and then by the cameras that were found.
        """
        several = people.shape[2] > 1
        self.steps.known += self.steps.pairs * (4 if several else 2)
        places = told_by_lines(people, self.lenses, self.most_lag, self.compared()) if several else []
        everyone = taken(people, places) if several else [people[:, :, 0]]
        start = self.guessed(everyone, several)
        guess = {i: (start.cameras[i], float(start.clocks[i])) for i in start.cameras}
        cameras, found = self.adjusted(everyone, first_frames(places), guess)
        used = {int(i): cameras[i] for i in np.flatnonzero(found["used"])}
        clocks = {i: float(found["clock"][i]) for i in used}
        again = told_by_rig(people, used, clocks, self.layout, self.fps) if several else []
        if again and not np.array_equal(again, places):
            places, everyone = again, taken(people, again)
            guess = {i: (camera, clocks[i]) for i, camera in used.items()}
            cameras, found = self.adjusted(everyone, first_frames(places), guess)
        everybody = [take_people(people, one) for one in places] if several else everyone
        return everyone, start, cameras, found | {"people": everybody}

    def compared(self) -> Iterator[tuple[int, int]]:
        """Yield every pair of views, and report a step after each."""
        for pair in combinations(range(len(self.cameras)), 2):
            yield pair
            self.steps.take()

    def together(self, everyone: Sequence[Array]) -> Array:
        """Return the detections of everybody as those of one recording."""
        return one_after_another(everyone, max(GAP, self.most_lag))

    def times(self, everyone: Sequence[Array], first: Sequence[int]) -> Index:
        """Return the frame of the video for each of `together`, of people who appear in these frames."""
        gap = max(GAP, self.most_lag)
        spans = [np.arange(t - gap, t + len(one)) for t, one in zip(first, everyone, strict=True)]
        return np.maximum(np.concatenate(spans)[gap:], 0)

    def guessed(self, everyone: Sequence[Array], several: bool) -> Start:
        """Return a first guess of the rig."""
        start = None
        if everyone:
            together = self.together(everyone)
            start = first_guess(together, self.lenses, self.layout, self.most_lag, self.compared())
        if start is None:
            expected, got = f"at least {LEAST_JOINTS} joints that two views see in the same frames", "fewer"
            film = "film one person who walks about"
            if several:
                expected, got = "people whom two views see at the same time", "none that can be told apart"
                film += ", or choose a person"
            raise DegenerateGeometryError(f"detections: expected {expected}, got {got}: {film}")
        return start

    def adjusted(
        self, everyone: Sequence[Array], first: Sequence[int], guess: Mapping[int, tuple[Camera, float]]
    ) -> tuple[list[Camera], dict[str, Any]]:
        """Return all cameras, adjusted from a guess of some, by people who appear in these frames first."""
        placed = list(self.cameras)
        clocks: list[float | None] = [None] * len(placed)
        for i, (camera, clock) in guess.items():
            placed[i], clocks[i] = altered(placed[i], R=camera.R, t=camera.t), clock
        adjusted = _skelsplat.calibrate_cameras(
            self.together(everyone),
            placed,
            clocks,
            self.layout,
            self.times(everyone, first),
            focal=self.focal,
            same_focal=self.same_focal,
            clock=self.clock or any(clocks),
            config=self.config,
        )
        self.steps.take(self.steps.pairs)
        return adjusted
