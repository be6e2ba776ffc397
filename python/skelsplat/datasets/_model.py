"""What every reader gives: takes of one person each, with cameras, truth and detections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skelsplat._arrays import FARTHEST, Array, Index, Mask, positive
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    from skelsplat.datasets._people import PeopleTake


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """One take of one person, T frames seen by M cameras that do not move.

    Attributes
    ----------
    key : str
        Unique within the data set, as ``"S9/Directions 1"``; names the files of results.
    subject, action : str
        `action` is the column of a table: no number behind it.
    rig : CameraRig
        M cameras; its unit is that of `truth` and `monocular`.
    frames : (T,) int64
        Frame numbers of the source.
    truth : (T, N, 3)
        World joints; NaN where not labelled.
    detections : (T, M, N, 3) or None
        Pixels and confidence; NaN, NaN, 0 where missing.
    monocular : (T, V, N, 3) or None
        World poses of V monocular estimates.
    boxes : (T, M, 4) or None
        Left, top, right, bottom in pixels; NaN where the person is not in the view.
    visible : (T, M, N) bool or None
        Joints that are not occluded, where the source says so.
    fps : float or None
        Frames per second that `frames` count; None if unknown.
    files : mapping of str to Path
        Where ``"truth"``, ``"detections"``, ``"cameras"``, … come from, for messages.
    """

    key: str
    subject: str
    action: str
    rig: CameraRig
    frames: Index
    truth: Array
    detections: Array | None = None
    monocular: Array | None = None
    boxes: Array | None = None
    visible: Mask | None = None
    fps: float | None = None
    files: Mapping[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        t, m, n = len(self.frames), len(self.rig), self.truth.shape[-2] if self.truth.ndim == 3 else -1
        self._expect("truth", self.truth, (t, n, 3))
        for name, shape in (("detections", (t, m, n, 3)), ("boxes", (t, m, 4)), ("visible", (t, m, n))):
            value = getattr(self, name)
            if value is not None:
                self._expect(name, value, shape)
        if self.monocular is not None:
            self._expect("monocular", self.monocular, (t, self.monocular.shape[1], n, 3))

    def _expect(self, name: str, value: NDArray[np.generic], shape: tuple[int, ...]) -> None:
        if value.shape != shape:
            raise DatasetError(self.key, name, f"shape {shape}", value.shape)
        if value.dtype.kind == "f" and (np.abs(value) > FARTHEST).any():
            expected = f"numbers within ±{FARTHEST:g}, NaN where missing"
            far = value[np.abs(value) > FARTHEST][0]
            known = [self.files[one] for one in (name, "truth", "detections") if one in self.files]
            raise DatasetError(known[0] if known else self.key, name, expected, f"{far:g}")

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, keep: Mask | Index | slice) -> Take:
        """Return the take with only the frames `keep`."""
        arrays = ("frames", "truth", "detections", "monocular", "boxes", "visible")
        return replace(self, **self._cut(arrays, keep))

    def _cut(self, names: Sequence[str], *index: Any) -> dict[str, Any]:
        values = {name: getattr(self, name) for name in names}
        return {name: None if value is None else value[index] for name, value in values.items()}

    def with_detections(self, values: Array, path: Path, monocular: Array | None = None) -> Take:
        """Return the take with detections (T, M, N, 3) from a file or folder, maybe with monocular poses."""
        files = {**self.files, "detections": path}
        own = self.monocular if monocular is None else monocular
        return replace(self, detections=values, monocular=own, files=files)

    def with_views(self, places: Sequence[int]) -> Take:
        """Return the take with only the cameras at these places, in this order.

        Monocular poses are cut with the views if there is one per camera.
        """
        chosen = list(places)
        if chosen == list(range(len(self.rig))):
            return self
        per_view = self.monocular is not None and self.monocular.shape[1] == len(self.rig)
        arrays = ("detections", "boxes", "visible", *(["monocular"] if per_view else []))
        rig = CameraRig([self.rig[i] for i in chosen], self.rig.unit)
        return replace(self, rig=rig, **self._cut(arrays, slice(None), chosen))

    @property
    def detected(self) -> float | None:
        """Share of joints in all views and frames that are detected; None without detections."""
        if self.detections is None or not self.detections.size:
            return None
        return float(np.isfinite(self.detections[..., 0]).mean())

    @property
    def labelled(self) -> float | None:
        """Share of joints in all frames that have a truth; None without frames."""
        return float(np.isfinite(self.truth[..., 0]).mean()) if self.truth.size else None


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Takes that share a layout.

    Attributes
    ----------
    name : str
        As in the registry: ``"human36m"``.
    layout : Layout
        N joints.
    takes : tuple of Take
    detector : str or None
        Where the detections come from: ``"metrabs"``, ``"cpn"``, …, ``"simulated"``.
    source : str
        One line that goes under every table: what the data are, simulated or not, oracle or not.
    notes : tuple of str
        What was left out or assumed on reading.
    scenes : tuple of PeopleTake
        Recordings of several people in which nothing says who is who, if the source has them; `takes` then
        has their people one by one, by oracle association.
    """

    name: str
    layout: Layout
    takes: tuple[Take, ...]
    detector: str | None = None
    source: str = ""
    notes: tuple[str, ...] = field(default=())
    scenes: tuple[PeopleTake, ...] = field(default=())

    def __post_init__(self) -> None:
        keys = [take.key for take in self.takes]
        if len(set(keys)) != len(keys):
            raise DatasetError(self.name, "takes", "different keys", sorted(keys))
        for take in self.takes:
            if take.truth.shape[1] != self.layout.n_joints:
                expected = f"{self.layout.n_joints} joints of {self.layout.name}"
                raise DatasetError(take.key, "truth", expected, take.truth.shape[1])

    def with_fps(self, fps: float) -> Dataset:
        """Return the data set with this rate of the frame numbers of all takes."""
        positive("fps", fps)
        takes = tuple(replace(take, fps=fps) for take in self.takes)
        return replace(self, takes=takes, scenes=tuple(replace(scene, fps=fps) for scene in self.scenes))

    def __iter__(self) -> Iterator[Take]:
        return iter(self.takes)

    def __len__(self) -> int:
        return len(self.takes)
