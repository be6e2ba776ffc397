"""What a method is: from a take and settings to poses, timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._refine import Progress
from skelsplat._skelsplat import Layout
from skelsplat.datasets import Take
from skelsplat.evaluation._views import without_lens
from skelsplat.exceptions import DatasetError, InvalidInputError

FloatArray = NDArray[np.float64]
Settings = Mapping[str, Any]
Run = Callable[[Take, Layout, Settings, Progress | None], FloatArray]

STARTS = ("dlt", "fusion", "none")

DEFAULT_INIT_SIGMA_MM = 25.0
"""Standard deviation per axis of a fused start: 40.2 mm, the mean error that the paper reports of it on
Human3.6M (tab:abl-initial-guess), over 1.596, the mean length of a standard normal vector in space."""

_FIELDS = {"detections": "2D detections", "monocular": "monocular 3D poses"}


@dataclass(frozen=True, kw_only=True)
class Options:
    """What applies to all methods of a run.

    Attributes
    ----------
    undistort : bool
        Remove lens distortion from the detections; False: detections are used with K alone.
    start : {"dlt", "fusion", "none"} or None
        Where `skelsplat`, `skelsplat-paper` and `skelsplat-closed-form` start; ``"none"``: with the solver's
        own triangulation. None: ``"none"`` for `skelsplat`, `paper_start` for the other two.
    paper_start : {"dlt", "fusion", "none"}
        Where the paper starts on this data set.
    paper_fields : mapping
        What the paper changes in its settings on this data set: fields of `RefineConfig.paper`.
    init_sigma_mm : float
        Standard deviation per axis of the fused start, for `skelsplat-prior`.
    seed : int
        Of the pairs that RANSAC draws.
    n_threads : int or None
        Of the compiled solver; None: all cores.
    """

    undistort: bool = True
    start: str | None = None
    paper_start: str = "dlt"
    paper_fields: Settings = field(default_factory=dict)
    init_sigma_mm: float = DEFAULT_INIT_SIGMA_MM
    seed: int = 0
    n_threads: int | None = None

    def __post_init__(self) -> None:
        for name in ("start", "paper_start"):
            value = getattr(self, name)
            if value not in STARTS and not (value is None and name == "start"):
                raise InvalidInputError(f"{name}: expected one of {', '.join(STARTS)}, got {value!r}")
        if not (np.isfinite(self.init_sigma_mm) and self.init_sigma_mm > 0):
            raise InvalidInputError(f"init_sigma_mm: expected a positive number, got {self.init_sigma_mm!r}")


@dataclass(frozen=True, slots=True)
class Solution:
    """Poses (T, N, 3) in the rig's unit, and the wall time of the method alone, s."""

    pose: FloatArray
    seconds: float


@dataclass(frozen=True)
class Method:
    """A method of the registry.

    Attributes
    ----------
    name, about : str
    settings : callable
        `Options` to everything that the poses depend on, as JSON values; ``"undistort"`` is among them.
    run : callable
        Take, layout, settings and progress to poses (T, N, 3).
    needs : tuple of str
        Fields of `Take`; a start by fusion needs ``"monocular"`` as well.
    by_pixels : bool
        Renders pixels and takes far longer than all others.
    """

    name: str
    about: str
    settings: Callable[[Options], dict[str, Any]]
    run: Run
    needs: tuple[str, ...] = ("detections",)
    by_pixels: bool = False

    def solve(
        self, take: Take, layout: Layout, settings: Settings, progress: Progress | None = None
    ) -> Solution:
        """Run the method on a take and time it.

        Raises
        ------
        DatasetError
            If the take lacks what the method needs.
        """
        self.check(take, settings)
        seen = take if settings["undistort"] else replace(take, rig=without_lens(take.rig))
        begun = time.perf_counter()
        pose = self.run(seen, layout, settings, progress)
        return Solution(pose, time.perf_counter() - begun)

    def lacks(self, take: Take, settings: Settings) -> str | None:
        """Return the field that the method needs and the take does not have; None if there is none."""
        fused = ("monocular",) if settings.get("start") == "fusion" else ()
        return next((name for name in (*self.needs, *fused) if getattr(take, name) is None), None)

    def check(self, take: Take, settings: Settings) -> None:
        """Raise `DatasetError` if the take lacks what the method needs."""
        missing = self.lacks(take, settings)
        if missing is not None:
            raise DatasetError(take.key, missing, f"{_FIELDS[missing]}, for the method {self.name}", "none")
