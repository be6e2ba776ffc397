"""Methods by name: a take in, poses (T, N, 3) in the rig's unit out, and the settings that they depend on.

>>> from skelsplat.evaluation import methods
>>> methods.get("dlt").settings(methods.Options())
{'undistort': True}

Those that need a trained network are not here: their published figures are in
`skelsplat.evaluation.reported`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any, Literal

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
Start = Literal["dlt", "ransac", "fusion", "none"]
"""Initial poses: DLT without confidences, RANSAC, fused monocular poses, or what the solver triangulates."""

DEFAULT_INIT_SIGMA_MM = 25.0
"""Standard deviation per axis of a fused start: 40.2 mm, the mean error that the paper reports of it on
Human3.6M (tab:abl-initial-guess), over 1.596, the mean length of a standard normal vector in space."""

# Of the Butterworth filter, Hz, but at most this share of half the frame rate; and the longest gap of a joint
# that a straight line fills before it, s.
CUTOFF_HZ, _OF_NYQUIST, GAP_S = 6.0, 0.8, 0.5

_CROP_PX = 384.0  # side of the crops in whose pixels the thresholds of Iskakov et al. are

FIELDS = {
    "detections": "2D detections",
    "monocular": "monocular 3D poses",
    "fps": "the frame rate",
    "frames": "consecutive numbers of frames",
}
"""What methods need of a take, in words."""
_GUESSES = ' (monocular="NAME" reads those in initial_guess/NAME)'


@dataclass(frozen=True, kw_only=True)
class Options:
    """What applies to all methods of a run."""

    undistort: bool = True  #: remove lens distortion from the detections; False: use them with K alone
    paper_start: Start = "dlt"  #: where the paper starts on this data set
    #: What the paper changes in its settings on this data set: fields of `RefineConfig.paper`.
    paper_fields: Settings = field(default_factory=dict)
    init_sigma_mm: float = DEFAULT_INIT_SIGMA_MM  #: per axis of the fused start, for `annealed-prior`
    seed: int = 0  #: of the pairs that RANSAC draws
    n_threads: int | None = None  #: of the compiled solver; None: all cores

    def __post_init__(self) -> None:
        positive("init_sigma_mm", self.init_sigma_mm)


@dataclass(frozen=True, slots=True)
class Solution:
    """Poses (T, N, 3) in the rig's unit, and the wall time of the method alone, s."""

    pose: Array
    seconds: float


@dataclass(frozen=True, slots=True)
class Task:
    """What a method gets; the take has all that it needs."""

    take: Take
    layout: Layout
    settings: Settings
    progress: Progress | None = None

    @property
    def seen(self) -> tuple[Array, CameraRig]:
        """Detections and cameras."""
        return _there(self.take.detections), self.take.rig

    def refined(self) -> Array:
        """Start as the settings say, and refine with their configuration."""
        kind, sigma = self.settings["start"], self.settings.get("init_sigma_mm")
        start = None if kind == "none" else starting_poses(self.take, kind)
        config = RefineConfig(**self.settings["config"])
        return refined(self.take, self.layout, start, config, sigma, self.progress).pose


def _there(value: Array | None) -> Array:
    assert value is not None  # Method.check has seen to it
    return value


@dataclass(frozen=True)
class Method:
    """A method of the registry."""

    name: str
    run: Callable[[Task], Array]  #: to poses (T, N, 3)
    #: `Options` to what the poses depend on besides ``"undistort"``, as JSON values.
    own: Callable[[Options], dict[str, Any]] = lambda _: {}
    needs: tuple[str, ...] = ("detections",)  #: fields of `Take`; a start by fusion needs another
    by_pixels: bool = False  #: renders pixels and takes far longer than all others
    over_time: bool = False  #: needs the frames around each, so all of a recording, and their rate
    package: str = "numpy"  #: that it imports

    def settings(self, options: Options) -> dict[str, Any]:
        """Return everything that the poses depend on, as JSON values."""
        return {"undistort": options.undistort, **self.own(options)}

    def solve(
        self, take: Take, layout: Layout, settings: Settings, progress: Progress | None = None
    ) -> Solution:
        """Run the method on a take and time it; raises as `check` does."""
        self.check(take, settings)
        seen = take if settings["undistort"] else replace(take, rig=without_lens(take.rig))
        begun = time.perf_counter()
        pose = self.run(Task(seen, layout, settings, progress))
        return Solution(pose, time.perf_counter() - begun)

    def lacks(self, take: Take, settings: Settings) -> str | None:
        """Return the field that the method needs and the take does not have; None if there is none."""
        fused = settings.get("start") == "fusion"
        names = (*self.needs, *["monocular"] * fused, *["fps"] * self.over_time)
        missing = next((name for name in names if getattr(take, name) is None), None)
        single = self.over_time and not (np.diff(take.frames) == 1).any()
        return "frames" if missing is None and single else missing

    def check(self, take: Take, settings: Settings, options: Sequence[str] = ()) -> None:
        """Raise `DatasetError` if the take lacks what the method needs; its reader has ``options``."""
        missing = self.lacks(take, settings)
        if missing is not None:
            way = _GUESSES if missing == "monocular" and missing in options else ""
            expected = f"{FIELDS[missing]}{way}, for the method {self.name}"
            raise DatasetError(take.key, missing, expected, "none")


def without_lens(rig: CameraRig) -> CameraRig:
    """Return the cameras with K alone: what `RefineConfig(undistort=False)` and published code take."""
    return CameraRig([without_distortion(camera) for camera in rig], rig.unit)


def starting_poses(take: Take, start: Literal["dlt", "ransac", "fusion"]) -> Array:
    """Return initial poses."""
    if start == "dlt":
        return triangulate(_there(take.detections)[..., :2], take.rig, method="dlt")
    if start == "ransac":
        return triangulate(_there(take.detections), take.rig, method="ransac")
    return fuse_monocular(_there(take.monocular), _there(take.detections), take.rig)


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
        _there(take.detections),
        take.rig,
        layout=layout,
        init_sigma=None if init_sigma_mm is None else init_sigma_mm / take.rig.mm_per_unit,
        config=config,
        progress=progress or False,
    )


def _iskakov(task: Task) -> Array:
    """Run it with pixels of a 384 px crop of the person's square box, where there is one."""
    scale = np.ones((len(task.take), len(task.take.rig)))
    if task.take.boxes is not None:
        sides = (task.take.boxes[..., 2:] - task.take.boxes[..., :2]).max(axis=-1)
        scale = np.where(np.isfinite(sides) & (sides > 0), sides / _CROP_PX, 1.0)
    return baselines.ransac_iskakov(*task.seen, crop_scale=scale, seed=task.settings["seed"])


def stretches(frames: Index) -> list[slice]:
    """Cut frames (T,) into runs of consecutive numbers: methods over time never go across a gap."""
    starts = [0, *(np.flatnonzero(np.diff(frames) != 1) + 1).tolist(), len(frames)]
    return [slice(a, b) for a, b in pairwise(starts) if a < b]


def butterworth(pose: Array, fps: float) -> Array:
    """Fill short gaps of joints, then run the zero-lag filter, on poses (T, N, 3) of consecutive frames."""
    filled, _ = temporal.fill_gaps(pose, max(1, round(GAP_S * fps)), method="linear")
    return temporal.butterworth(filled, fps, min(CUTOFF_HZ, _OF_NYQUIST * fps / 2.0))[0]


def _smoothed(task: Task) -> Array:
    """Refine single frames, then smooth each stretch of consecutive ones."""
    pose, fps = task.refined(), task.take.fps or 0.0
    return np.concatenate([butterworth(pose[part], fps) for part in stretches(task.take.frames)])


def _in_time(task: Task) -> Array:
    """Solve each stretch of consecutive frames over time, and single ones by themselves."""
    config, fps = RefineConfig(**task.settings["config"]), task.take.fps or 0.0

    def solved(own: Task) -> Array:
        if len(own.take) == 1:
            return own.refined()
        return refine_sequence(*own.seen, fps=fps, layout=task.layout, config=config).pose

    parts = stretches(task.take.frames)
    return np.concatenate([solved(replace(task, take=task.take.select(part))) for part in parts])


def _solver(
    options: Options, config: RefineConfig | None = None, start: Start = "none", **more: Any
) -> dict[str, Any]:
    own = (config or RefineConfig()).replace(n_threads=options.n_threads)
    return {"start": start, "config": own.to_dict(), **more}


def _prior(options: Options) -> dict[str, Any]:
    return _solver(options, start="fusion", init_sigma_mm=options.init_sigma_mm)


def _paper(options: Options, **fields: Any) -> dict[str, Any]:
    return _solver(options, RefineConfig.paper(**{**options.paper_fields, **fields}), options.paper_start)


def _seed(options: Options) -> dict[str, Any]:
    return {"seed": options.seed}


_ALL = (
    Method("dlt", lambda task: baselines.dlt(*task.seen)),  # algebraic triangulation, unweighted
    Method("dlt-confidence", lambda task: baselines.dlt(*task.seen, confidence=True)),
    Method("ransac-iskakov", _iskakov, _seed),  # of Iskakov et al., with its Huber refinement
    Method(  # that AdaFuse is compared with
        "ransac-adafuse", lambda t: baselines.ransac_adafuse(*t.seen, seed=t.settings["seed"]), _seed
    ),
    Method("ransac", lambda task: triangulate(*task.seen, method="ransac")),
    Method("cauchy", lambda task: baselines.cauchy(*task.seen)),
    Method(  # of monocular poses
        "fusion", lambda task: starting_poses(task.take, "fusion"), needs=("detections", "monocular")
    ),
    Method("annealed", Task.refined, _solver),  # the default
    Method(  # then a zero-lag Butterworth filter
        "annealed-butterworth",
        _smoothed,
        partial(_solver, cutoff_hz=CUTOFF_HZ, gap_s=GAP_S),
        over_time=True,
        package="scipy",
    ),
    Method("over-time", _in_time, _solver, over_time=True),  # all frames of a recording in one solve
    Method("annealed-prior", Task.refined, _prior),  # with the fused monocular poses as a Gaussian prior
    Method("paper-closed-form", Task.refined, partial(_paper, renderer="closed_form")),
    Method("paper", Task.refined, _paper, by_pixels=True),  # raster, Adam
    Method(  # from RANSAC, whatever the paper starts from
        "paper-ransac",
        Task.refined,
        lambda options: _paper(replace(options, paper_start="ransac")),
        by_pixels=True,
    ),
)
_BY_NAME = {method.name: method for method in _ALL}

names: tuple[str, ...] = tuple(_BY_NAME)


def get(name: str) -> Method:
    """Return a method of the registry; raises `InvalidInputError` if there is none of that name."""
    one_of("methods", name, names)
    return _BY_NAME[name]
