"""Methods by name: a take in, poses (T, N, 3) in the rig's unit out, and the settings that they depend on.

>>> from skelsplat.evaluation import methods
>>> methods.get("dlt").settings(methods.Options())
{'undistort': True}

Those that need a trained network are not here: their published figures are in
`skelsplat.evaluation.reported`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from skelsplat import temporal
from skelsplat._arrays import Array, Index, positive
from skelsplat._refine import Progress, Refinement, refine
from skelsplat._sequence import refine_sequence
from skelsplat._skelsplat import Layout, RefineConfig, fuse_monocular, triangulate
from skelsplat.cameras import CameraRig, without_distortion
from skelsplat.datasets import Take
from skelsplat.evaluation import baselines
from skelsplat.exceptions import DatasetError, one_of

Settings = Mapping[str, Any]
Run = Callable[[Take, Layout, Settings, Progress | None], Array]

STARTS = ("dlt", "fusion", "none")

DEFAULT_INIT_SIGMA_MM = 25.0
"""Standard deviation per axis of a fused start: 40.2 mm, the mean error that the paper reports of it on
Human3.6M (tab:abl-initial-guess), over 1.596, the mean length of a standard normal vector in space."""

_FIELDS = {
    "detections": "2D detections",
    "monocular": "monocular 3D poses",
    "fps": "the frame rate",
    "frames": "consecutive numbers",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """What applies to all methods of a run."""

    #: Remove lens distortion from the detections; False: detections are used with K alone.
    undistort: bool = True
    #: {"dlt", "fusion", "none"} or None: Where `annealed` (also over time), `paper` and `paper-closed-form`
    #: start; ``"none"``: with the solver's own triangulation. None: ``"none"``, but for the paper's two
    #: `paper_start`.
    start: str | None = None
    paper_start: str = "dlt"  #: {"dlt", "fusion", "none"}: Where the paper starts on this data set
    #: What the paper changes in its settings on this data set: fields of `RefineConfig.paper`.
    paper_fields: Settings = field(default_factory=dict)
    #: Standard deviation per axis of the fused start, for `annealed-prior`.
    init_sigma_mm: float = DEFAULT_INIT_SIGMA_MM
    seed: int = 0  #: of the pairs that RANSAC draws
    n_threads: int | None = None  #: of the compiled solver; None: all cores

    def __post_init__(self) -> None:
        one_of("start", self.start, (None, *STARTS))
        one_of("paper_start", self.paper_start, STARTS)
        positive("init_sigma_mm", self.init_sigma_mm)


@dataclass(frozen=True, slots=True)
class Solution:
    """Poses (T, N, 3) in the rig's unit, and the wall time of the method alone, s."""

    pose: Array
    seconds: float


def _lens(options: Options) -> dict[str, Any]:
    return {"undistort": options.undistort}


@dataclass(frozen=True)
class Method:
    """A method of the registry."""

    name: str
    run: Run  #: take, layout, settings and progress to poses (T, N, 3)
    #: `Options` to everything that the poses depend on, as JSON values; ``"undistort"`` is among them.
    settings: Callable[[Options], dict[str, Any]] = _lens
    #: Fields of `Take`; a start by fusion needs ``"monocular"`` as well.
    needs: tuple[str, ...] = ("detections",)
    by_pixels: bool = False  #: renders pixels and takes far longer than all others
    over_time: bool = False  #: needs the frames around each, so all of a recording, and their rate
    package: str = "numpy"  #: that it imports

    def solve(
        self, take: Take, layout: Layout, settings: Settings, progress: Progress | None = None
    ) -> Solution:
        """Run the method on a take and time it; raises as `check` does."""
        self.check(take, settings)
        seen = take if settings["undistort"] else replace(take, rig=without_lens(take.rig))
        begun = time.perf_counter()
        pose = self.run(seen, layout, settings, progress)
        return Solution(pose, time.perf_counter() - begun)

    def lacks(self, take: Take, settings: Settings) -> str | None:
        """Return the field that the method needs and the take does not have; None if there is none."""
        fused = ("monocular",) if settings.get("start") == "fusion" else ()
        names = (*self.needs, *fused, *(("fps",) if self.over_time else ()))
        missing = next((name for name in names if getattr(take, name) is None), None)
        single = self.over_time and not (np.diff(take.frames) == 1).any()
        return "frames" if missing is None and single else missing

    def check(self, take: Take, settings: Settings) -> None:
        """Raise `DatasetError` if the take lacks what the method needs."""
        missing = self.lacks(take, settings)
        if missing is not None:
            raise DatasetError(take.key, missing, f"{_FIELDS[missing]}, for the method {self.name}", "none")


def without_lens(rig: CameraRig) -> CameraRig:
    """Return the cameras with K alone: what `RefineConfig(undistort=False)` and published code take."""
    return CameraRig([without_distortion(camera) for camera in rig], rig.unit)


# Side of the crops in whose pixels the thresholds of Iskakov et al. are.
_CROP_PX = 384.0


def crop_scale(take: Take) -> Array:
    """Pixels of the image per pixel of a 384 px crop of the person's square box, (T, M); 1 without a box."""
    if take.boxes is None:
        return np.ones((len(take), len(take.rig)))
    sides = (take.boxes[..., 2:] - take.boxes[..., :2]).max(axis=-1)
    known = np.isfinite(sides) & (sides > 0)
    return np.where(known, sides / _CROP_PX, 1.0)


def _by(run: Callable[[Take, Settings], Array]) -> Run:
    """Return `run`, of a take and settings, as a method without layout and progress."""
    return lambda take, _layout, settings, _progress: run(take, settings)


_DLT = _by(lambda take, given: baselines.dlt(_detections(take), take.rig, confidence="confidence" in given))


def _iskakov(take: Take, settings: Settings) -> Array:
    scale = crop_scale(take)
    return baselines.ransac_iskakov(_detections(take), take.rig, crop_scale=scale, seed=settings["seed"])


def _adafuse(take: Take, settings: Settings) -> Array:
    return baselines.ransac_adafuse(_detections(take), take.rig, seed=settings["seed"])


def _fusion(take: Take, *_: object) -> Array:
    assert take.monocular is not None  # Method.check has seen to it
    return fuse_monocular(take.monocular, _detections(take), take.rig)


def _detections(take: Take) -> Array:
    assert take.detections is not None  # likewise
    return take.detections


def _fps(take: Take) -> float:
    assert take.fps is not None  # likewise
    return take.fps


def _refine(take: Take, layout: Layout, settings: Settings, progress: Progress | None) -> Array:
    return _refinement(take, layout, settings, progress).pose


def _refinement(take: Take, layout: Layout, settings: Settings, progress: Progress | None) -> Refinement:
    """Start as the settings say, and refine with their configuration."""
    start, config = _start(take, settings), RefineConfig(**settings["config"])
    return refined(take, layout, start, config, settings.get("init_sigma_mm"), progress)


def _start(take: Take, settings: Settings) -> Array | None:
    return None if settings["start"] == "none" else starting_poses(take, settings["start"])


# Methods over time work at the rate of a recording and never across a gap in its frames.

CUTOFF_HZ = 6.0
"""Of the Butterworth filter, or `_OF_NYQUIST` of half the frame rate if that is less."""

_OF_NYQUIST = 0.8

GAP_S = 0.5
"""Longest gap of a joint that a straight line fills before the Butterworth filter."""

DENSITY_MM2_S3 = 1e6
"""Spectral density of the white acceleration of the Kalman smoother: on simulated recordings at 30 Hz, the
lowest errors of arms and legs of 1e5, 3e5, 1e6, …, 1e8."""


def stretches(frames: Index) -> list[slice]:
    """Cut frames (T,) into runs of consecutive numbers."""
    starts = [0, *(np.flatnonzero(np.diff(frames) != 1) + 1).tolist(), len(frames)]
    return [slice(a, b) for a, b in pairwise(starts) if a < b]


def cutoff(fps: float, wanted: float = CUTOFF_HZ) -> float:
    """Return the cutoff of the Butterworth filter, Hz: as wanted, but below half the frame rate."""
    return min(wanted, _OF_NYQUIST * fps / 2.0)


def butterworth(pose: Array, fps: float, cutoff_hz: float = CUTOFF_HZ, gap_s: float = GAP_S) -> Array:
    """Fill short gaps of joints, then run the zero-lag filter, on poses (T, N, 3) of consecutive frames."""
    filled, _ = temporal.fill_gaps(pose, max(1, round(gap_s * fps)), method="linear")
    return temporal.butterworth(filled, fps, cutoff(fps, cutoff_hz))[0]


def _then(smooth: Callable[[Refinement, Take, Settings, slice], Array]) -> Run:
    """Return `annealed` on single frames, then `smooth` on each stretch of consecutive ones."""

    def run(take: Take, layout: Layout, settings: Settings, progress: Progress | None) -> Array:
        alone = _refinement(take, layout, settings, progress)
        return np.concatenate([smooth(alone, take, settings, part) for part in stretches(take.frames)])

    return run


def _butterworth(alone: Refinement, take: Take, settings: Settings, part: slice) -> Array:
    return butterworth(alone.pose[part], _fps(take), settings["cutoff_hz"], settings["gap_s"])


def _kalman(alone: Refinement, take: Take, settings: Settings, part: slice) -> Array:
    density = settings["density_mm2_s3"] / take.rig.mm_per_unit**2
    return temporal.kalman(alone.pose[part], _fps(take), alone.uncertainty[part], density)[0]


def _in_time(take: Take, layout: Layout, settings: Settings, progress: Progress | None) -> Array:
    """Solve each stretch of consecutive frames over time, and single ones by themselves."""

    def solved(part: Take) -> Array:
        if len(part) == 1:
            return _refine(part, layout, settings, progress)
        start, config = _start(part, settings), RefineConfig(**settings["config"])
        return refine_sequence(
            _detections(part), part.rig, fps=_fps(part), layout=layout, init_pose=start, config=config
        ).pose

    return np.concatenate([solved(take.select(part)) for part in stretches(take.frames)])


def starting_poses(take: Take, start: str) -> Array:
    """Return initial poses: the paper's triangulation, without confidences, or ``"fusion"``."""
    if start == "dlt":
        return triangulate(_detections(take)[..., :2], take.rig, method="dlt")
    return _fusion(take)


def refined(
    take: Take,
    layout: Layout,
    start: Array | None,
    config: RefineConfig,
    init_sigma_mm: float | None = None,
    progress: Progress | None = None,
) -> Refinement:
    """Refine a take; `init_sigma_mm` makes the start a prior."""
    return refine(
        start,
        _detections(take),
        take.rig,
        layout=layout,
        init_sigma=None if init_sigma_mm is None else init_sigma_mm / take.rig.mm_per_unit,
        config=config,
        progress=progress if progress is not None else False,
    )


def _with(settings: Callable[[Options], dict[str, Any]], **more: Any) -> Callable[[Options], dict[str, Any]]:
    return lambda options: {**settings(options), **more}


def _drawn(options: Options) -> dict[str, Any]:
    return {**_lens(options), "seed": options.seed}


def _solver(options: Options, config: RefineConfig, start: str) -> dict[str, Any]:
    fields = config.replace(n_threads=options.n_threads).to_dict()
    return {**_lens(options), "start": start, "config": fields}


def _annealed(options: Options) -> dict[str, Any]:
    return _solver(options, RefineConfig(), options.start or "none")


def _prior(options: Options) -> dict[str, Any]:
    return {**_solver(options, RefineConfig(), "fusion"), "init_sigma_mm": options.init_sigma_mm}


def _paper(options: Options, **fields: Any) -> dict[str, Any]:
    config = RefineConfig.paper(**{**options.paper_fields, **fields})
    return _solver(options, config, options.start or options.paper_start)


_ALL = (
    Method("dlt", _DLT),  # algebraic triangulation, unweighted
    Method("dlt-confidence", _DLT, _with(_lens, confidence=True)),  # rows weighted by confidence
    Method("ransac-iskakov", _by(_iskakov), _drawn),  # of Iskakov et al., with its Huber refinement
    Method("ransac-adafuse", _by(_adafuse), _drawn),  # that AdaFuse is compared with
    Method("ransac", _by(lambda take, _: triangulate(_detections(take), take.rig, method="ransac"))),
    Method("cauchy", _by(lambda take, _: baselines.cauchy(_detections(take), take.rig))),
    Method("fusion", _fusion, needs=("detections", "monocular")),  # of monocular poses
    Method("annealed", _refine, _annealed),  # the default
    Method(  # then a zero-lag Butterworth filter
        "annealed-butterworth",
        _then(_butterworth),
        _with(_annealed, cutoff_hz=CUTOFF_HZ, gap_s=GAP_S),
        over_time=True,
        package="scipy",
    ),
    Method(  # then a Kalman smoother per joint
        "annealed-kalman",
        _then(_kalman),
        _with(_annealed, density_mm2_s3=DENSITY_MM2_S3),
        over_time=True,
    ),
    Method("over-time", _in_time, _annealed, over_time=True),  # all frames of a recording in one solve
    Method("annealed-prior", _refine, _prior),  # with the fused monocular poses as a Gaussian prior
    Method("paper-closed-form", _refine, partial(_paper, renderer="closed_form")),
    Method("paper", _refine, _paper, by_pixels=True),  # raster, Adam
)
_BY_NAME = {method.name: method for method in _ALL}

names: tuple[str, ...] = tuple(_BY_NAME)


def get(name: str) -> Method:
    """Return a method of the registry; raises `InvalidInputError` if there is none of that name."""
    one_of("methods", name, names)
    return _BY_NAME[name]
