"""``calibrate_cameras``: cameras, clocks and world from the people who are filmed, without a calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import layouts
from skelsplat._arrays import Array, numbers, pixels, positive
from skelsplat._clocks import in_step
from skelsplat._frozen import frozen, without_frozen
from skelsplat._placing import Steps, Task
from skelsplat._refine import Progress, reporter
from skelsplat._skelsplat import Camera, Layout, RefineConfig, triangulate
from skelsplat._words import length, percent, size_text
from skelsplat._world import ADULT, body_size, find_floor, mean_size, moved, movement, upright
from skelsplat.cameras import CameraRig, altered, without_distortion
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, warn

# Largest difference of two clocks, seconds.
_MOST_LAG_S = 10.0
# Focal length over image width of a lens of 65°, about which unknown ones are expected.
_USUAL_FOCAL = 0.8
# Part of the detections that may lie outside of their image.
_OUTSIDE = 0.1
# Least focal length over image width: 157°, a wide lens without a fisheye model. And the middle of detections
# from images smaller than stated is nearer to the corner than this: in real recordings, 0.46 along one axis.
_LEAST_FOCAL = 0.1
_UPPER_LEFT = 0.4
# Principal points may be this part of the image from its middle, in the mean of all cameras: if all are
# off alike, as by a crop, a rig turned by 1° explains as much for each 5 %.
_OFF_MIDDLE = 0.05
# A view is a copy of another if this part of its joints is where the other's are.
_COPIED = 0.5
# Statures, metres.
_SHORTEST, _TALLEST = 0.3, 2.6
# Length of bones as detectors show them, relative to the true ones, and its standard deviation: joints lie
# inside the body. Measured: OpenPose 0.965, hourglass 0.89 to 0.94, on real recordings of known bones.
_SHOWN = (0.95, 0.04)
# Frames from which the floor is found.
_FLOOR_FRAMES = 300
# A rig is sure up to this error bar of a camera's turn, degrees, and of its place, relative to its distance
# from the person: beyond, error bars understate, since another rig may explain as much.
_SURE_DEG = 3.0
_SURE_PLACE = 0.06
# And up to this one of joints, relative to the size of the body (root mean square): without parallax it is
# larger; of 146 real takes, accepted or not, 145 have less than 4 %.
_SURE_JOINTS = 0.07
# Somebody who moves less, relative to the size of the body, shows the same few points in every frame: their
# errors do not average out, and error bars are too small.
_LEAST_MOVED = 0.3
# What the core finds of each camera in one number, by the names of `CalibratedCamera`.
_NUMBERS = {name: name for name in ("clock", "turn_sigma", "clock_sigma", "explained", "zoom")}
_NUMBERS |= {"focal_sigma": "zoom_sigma", "error": "distance"}


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """What is known of a camera whose place is unknown: its image size, and perhaps its lens.

    ``K`` (3, 3) is None where the focal length is unknown; the principal point is then the image's middle.
    ``distortion`` and ``fisheye`` are those of a `Camera`.
    """

    size: tuple[int, int]
    K: ArrayLike | None = None
    distortion: ArrayLike | None = None
    fisheye: bool = False
    name: str | None = None

    def camera(self) -> Camera:
        """Return a camera at the origin, with a usual focal length where it is unknown."""
        K = np.eye(3) if self.K is None else self.K
        camera = Camera(K, np.eye(3), np.zeros(3), size=self.size, name=self.name)
        if self.K is None:
            width, height = camera.size
            focal = _USUAL_FOCAL * max(width, height)
            K = [[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]]
        return altered(camera, K=K, distortion=self.distortion, fisheye=self.fisheye)


@dataclass(frozen=True, slots=True)
class CalibratedCamera:
    """What was found about one camera.

    ``status`` is ``"placed"``, or ``"left_out"`` if it shares too little with the others or contradicts them:
    it looks at something else, or its detections do. Error bars (``…_sigma``) are root-mean-square lengths of
    the error of the rig's shape, with the rig aligned as a whole: degrees, the rig's unit, shares, frames.

    Attributes
    ----------
    clock : float
        Frames by which the camera's count is ahead of that of the first placed camera.
    error : float
        Median distance, px, of the camera's detections from the joints.
    explained : float
        The share of its detections that lie within four times the noise.
    zoom : float
        By which factor its focal length seems to be wrong though it was given, or differs from the others'
        though all are the same; 1 where it may be right.
    place_covariance : (3, 3)
        Of the camera's place along the axes of the world, in the square of the rig's unit.
    span : (int, int), optional
        If it was moved while it recorded, the first frame and the end of the longer part, by which it was
        placed.
    """

    name: str
    status: str
    clock: float
    turn_sigma: float
    focal_sigma: float
    clock_sigma: float
    error: float
    explained: float
    zoom: float
    place_covariance: Array = field(repr=False, compare=False)
    span: tuple[int, int] | None = None

    @property
    def place_sigma(self) -> float:
        """Root-mean-square length of the error of the camera's place."""
        return math.sqrt(np.trace(self.place_covariance))


@dataclass(frozen=True, slots=True)
class RigCalibration:
    """What ``calibrate_cameras`` returns.

    ``cameras`` are the placed ones, in mm. The world has z up and its origin on the floor in the middle of
    where people stood, and the first camera looks along y; without ankles and a head or shoulders in the
    layout (``up_sigma`` is NaN), it is that of the first camera.

    ``scale_sigma`` is the relative standard error of all lengths, ``up_sigma`` that of the direction up in
    degrees, and ``cameras.joint_sigma`` how far joints are off besides. ``doubts`` say why the recording does
    not tell the cameras' places: ``"places"`` (an error bar is above 3° or 6 % of the camera's distance),
    ``"movement"`` (the person hardly moves), ``"periodic"`` (other clocks explain as much), ``"clocks"``
    (cameras are out of step), ``"cameras"`` (half of them or more are left out, or two are left to tell focal
    lengths), ``"moved"`` (cameras kept moving), ``"lenses"`` (focal lengths that were given,
    or the same for all, contradict the detections). Without any, the rig is ``sure``.

    ``people`` are the detections by which the cameras were found, (T, M, N, 2|3) of each person, of all M
    cameras: those of the argument, without whoever could not be told apart, and what a camera sees from
    elsewhere.
    """

    cameras: CameraRig
    report: tuple[CalibratedCamera, ...] = field(repr=False)
    scale_sigma: float
    up_sigma: float
    doubts: tuple[str, ...] = ()
    people: tuple[Array, ...] = field(default=(), repr=False, compare=False)
    stature: float = math.nan  # of the person, or the mean of several, m, by the proportions of people

    @property
    def clocks(self) -> dict[str, float]:
        """By placed camera, frames by which its count is ahead."""
        return {name: self.cameras.clocks.get(name, 0.0) for name in self.cameras.names}

    @property
    def sure(self) -> bool:
        """Whether the recording tells the cameras' places."""
        return not self.doubts

    def synchronised(self, detections: ArrayLike) -> Array:
        """Return the placed cameras' detections (T, M', …, N, 2|3) of (T, M, …, N, 2|3) at one time each."""
        seen = numbers(detections, "detections")
        return in_step(seen, {i: one.clock for i, one in enumerate(self.report) if one.status == "placed"})


def calibrate_cameras(
    detections: ArrayLike,
    intrinsics: Sequence[Intrinsics | Camera],
    *,
    layout: Layout | str,
    fps: float | None = None,
    stature: float | None = None,
    distance: tuple[str | int, str | int, float] | None = None,
    same_focal: bool = False,
    clock: bool = False,
    config: RefineConfig | None = None,
    progress: bool | Progress = False,
) -> RigCalibration:
    """Find where cameras are from the detections of people who move about: no board, no wand.

    A pair of views whose relative pose (OpenCV's MAGSAC) keeps bones steady begins a rig, the joints that it
    places give the other cameras, and bundle adjustment with the robust kernel of ``refine`` sets all cameras
    free. docs/method.md has the mathematics. Somebody should walk two metres, turn around, and raise the
    arms, for ten seconds. Several people are told apart; bystanders, and people who come and go, do no harm.

    Parameters
    ----------
    detections : (T, M, N, 2|3) or (T, M, P, N, 2|3)
        The frames in order, NaN where missing; with up to P people in a view, in any order.
    intrinsics : sequence of Intrinsics or Camera
        One for each view; of a `Camera`, the place is ignored. ``K`` of all, or of none: focal lengths are
        then found as well, which takes three cameras, and so is a radial coefficient of lenses without
        ``distortion``.
    stature : float, optional
        Of the person, or the mean of several, in metres. Without it and ``distance``, that of adults,
        1.70 ± 0.09 m.
    distance : (camera, camera, float), optional
        Of two cameras by name or number, in metres.
    same_focal : bool
        Whether the unknown lenses are of one make, zoom and image size: focal lengths then differ by some
        0.2 %. Without it, this is assumed as far as the detections show it.
    clock : bool
        Look for clocks that differ by up to 10 s, and to parts of a frame; needs ``fps``. Otherwise clocks
        are equal, unless they are clearly not, by half a frame to some frames.
    config, progress
        As in ``refine``. Of the settings, ``min_confidence``, ``undistort`` and ``n_threads`` count. Progress
        is in steps, of which more may turn out to be needed.

    Raises
    ------
    DegenerateGeometryError
        No two views share enough joints to be placed, or people.
    """
    skeleton = layouts.get(layout)
    seen = _recording(detections, len(intrinsics), skeleton)
    blank, focal = _blank(intrinsics)
    if same_focal and not focal:
        raise InvalidInputError("same_focal: expected none with K, which states focal lengths")
    options = config or RefineConfig()
    _check_images(seen, blank)
    size = _Size.given(stature, distance, [str(camera.name) for camera in blank])
    most_lag = min(_most_lag(clock, fps), len(seen))
    known = seen if seen.shape[4] == 2 else np.where(seen[..., 2:] >= options.min_confidence, seen, np.nan)
    lenses = blank if options.undistort else [without_distortion(camera) for camera in blank]
    with reporter(progress) as report:
        steps = Steps(report or (lambda *_: None), math.comb(len(blank), 2))
        task = Task(blank, lenses, skeleton, focal, same_focal, clock, most_lag, fps, options, steps)
        everyone, start, cameras, found = task.solved(known)
    out_of_step = clock or any(found["clock"])
    for name, estimated in (("zoom_sigma", focal), ("clock_sigma", out_of_step)):
        found[name][:] = found[name] if estimated else np.nan
    count = int(sum(found["used"]))
    few = 2 * count <= len(blank) or (focal and count < 3)
    why = {"clocks": start.late, "periodic": start.tied, "cameras": few, "moved": found["moved"]}
    doubts = [name for name, holds in why.items() if holds]
    return _in_world(everyone, cameras, found, skeleton, size, doubts)


def _recording(detections: ArrayLike, views: int, layout: Layout) -> Array:
    """Return detections (T, M, P, N, 2|3) with what repeats an older image missing."""
    given = pixels(detections, "detections")
    if np.isinf(given).any():
        raise InvalidInputError("detections: expected pixels, NaN for missing, got an infinite number")
    seen = given[:, :, None] if given.ndim == 4 else given
    fits = seen.ndim == 5 and (seen.shape[1], seen.shape[3]) == (views, layout.n_joints)
    if not fits or not seen.shape[2] or seen.shape[4] not in (2, 3):
        expected = f"(T, {views}, {layout.n_joints}, 2 or 3), or with people (T, {views}, P, …)"
        raise InvalidInputError(f"detections: expected shape {expected}, got {given.shape}")
    if views < 2:
        raise InvalidInputError(f"intrinsics: expected at least two cameras, got {views}")
    for i, j in combinations(range(views), 2):
        both = np.isfinite(seen[:, [i, j], ..., :2]).all(axis=(1, 4))
        if both.any() and (seen[:, i, ..., :2] == seen[:, j, ..., :2]).all(axis=3)[both].mean() > _COPIED:
            raise InvalidInputError(
                f"detections: expected a different camera in each view, got view {i} twice: {j}"
            )
    return without_frozen(seen, frozen(seen))


def _check_images(seen: Array, cameras: Sequence[Camera]) -> None:
    """Refuse lenses that no camera has, and sizes that detections contradict; warn of doubtful ones."""
    middles = []
    for i, camera in enumerate(cameras):
        focal = float(camera.K[0, 0])
        if not camera.fisheye and focal < _LEAST_FOCAL * max(camera.size):
            expected = f"a focal length in pixels of {size_text(camera.size)} images for {camera.name}"
            raise InvalidInputError(f"intrinsics: expected {expected}, got {focal:.3g}")
        pixels = seen[:, i, ..., :2][np.isfinite(seen[:, i, ..., :2]).all(axis=-1)]
        if not len(pixels):
            continue
        outside = ((pixels < 0) | (pixels > camera.size)).any(axis=-1).mean()
        if outside > _OUTSIDE:
            expected = f"pixels within the images of {camera.name}, {size_text(camera.size)}"
            raise InvalidInputError(f"detections: expected {expected}, got {100 * outside:.0f} % outside")
        middles.append(np.percentile(pixels, [1, 99], axis=0).mean(axis=0) / camera.size)
    x, y = np.mean(middles or [[0.5, 0.5]], axis=0).tolist()
    if max(x, y) < _UPPER_LEFT:
        sentence = f"The middle of the detections is at {percent(x)} of the images' width and "
        sentence += f"{percent(y)} of their height. Are they from images of this size?"
        warn(Finding("image_sizes_differ", numbers={"x": x, "y": y}, sentence=sentence))
    points = np.mean([(np.asarray(one.K)[:2, 2] + 0.5) / one.size for one in cameras], axis=0)
    if np.abs(points - 0.5).max() > _OFF_MIDDLE:
        x, y = points.tolist()
        sentence = f"The principal points of all cameras are at {percent(x)} of the images' width and "
        sentence += f"{percent(y)} of their height. If that is wrong, so are places, beyond their error bars."
        warn(Finding("calibration_unusual", numbers={"x": x, "y": y}, sentence=sentence))


def _blank(intrinsics: Sequence[Intrinsics | Camera]) -> tuple[list[Camera], bool]:
    """Return cameras without a place, and whether their focal lengths are unknown."""
    unknown = [isinstance(one, Intrinsics) and one.K is None for one in intrinsics]
    if any(unknown) and not all(unknown):
        i = unknown.index(True)
        raise InvalidInputError(f"intrinsics[{i}]: expected K of all cameras or of none, got none here")
    if any(unknown) and len(unknown) == 2:
        sentence = "intrinsics: expected K of both cameras, got none: two views do not tell focal lengths"
        raise InvalidInputError(sentence)
    blank = [
        one.camera() if isinstance(one, Intrinsics) else altered(one, R=np.eye(3), t=np.zeros(3))
        for one in intrinsics
    ]
    named = [altered(one, name=one.name or str(i)) for i, one in enumerate(blank)]
    return list(CameraRig(named)), all(unknown)


def _most_lag(clock: bool, fps: float | None) -> int:
    """Return how many frames clocks may differ by."""
    if fps is not None:
        positive("fps", fps)
    elif clock:
        raise InvalidInputError("fps: expected the frame rate to find clocks, got none")
    return round(_MOST_LAG_S * fps) if clock and fps is not None else 0


def _in_world(
    everyone: Sequence[Array],
    cameras: list[Camera],
    found: Mapping[str, Any],
    layout: Layout,
    size: _Size,
    doubts: Sequence[str],
) -> RigCalibration:
    """Return the rig with metric scale, up and a floor."""
    used = [int(i) for i in np.flatnonzero(found["used"])]
    names = [str(camera.name) for camera in cameras]
    there = CameraRig([cameras[i] for i in used])
    clocks = {i: float(found["clock"][i]) for i in used}
    frames = sum(map(len, everyone))
    of_each = [_joints(one, there, clocks, _FLOOR_FRAMES / frames) for one in everyone]
    points = np.concatenate(of_each)
    stature, error = map(float, found["stature"])
    stature *= mean_size(points, layout) if len(everyone) > 1 else 1.0
    scale, scale_sigma = size.of(there, stature, error)
    tall = scale * stature / 1000.0
    if size.ends is not None and (tall > 2 * _TALLEST or tall < _SHORTEST / 2):
        people = f"people who are {length(tall)} m tall"
        raise InvalidInputError(f"distance: expected metres, got {size.apart}, which makes {people}")
    floor = find_floor(points, layout, stature) if math.isfinite(stature) else None
    first, centre = there[0], np.asarray(there[0].centre)
    axes, origin = (first.R, centre) if floor is None else (upright(floor, centre), floor.middle)
    named = {names[i]: clock for i, clock in clocks.items()}
    in_world = [moved(camera, axes, origin, scale) for camera in there]
    joint_sigma = scale * float(found["joint_sigma"])
    stated = joint_sigma if math.isfinite(joint_sigma) else 0.0
    placed = CameraRig(in_world, clocks=named, joint_sigma=stated)
    report = tuple(_report(found, names, i, scale * axes) for i in range(len(cameras)))
    up_sigma = math.nan if floor is None else floor.sigma_deg
    still = [] if max(map(movement, of_each)) >= _LEAST_MOVED else ["movement"]
    wrong = ["lenses"] if any(one.zoom != 1.0 for one in report) else []
    wide = [] if wrong or _are_small(there, points, scale, report, joint_sigma) else ["places"]
    every = (*still, *doubts, *wrong, *wide)  # of somebody who stands still, clocks say nothing
    seen = tuple(found["people"])
    return RigCalibration(placed, report, scale_sigma, up_sigma, every, seen, tall / _SHOWN[0])


def _joints(one: Array, cameras: CameraRig, clocks: Mapping[int, float], part: float) -> Array:
    """Return a person's joints in part of the frames of detections (T, M, N, D), (T', N, 3)."""
    times = np.linspace(0, len(one) - 1, math.ceil(len(one) * min(1.0, part))).astype(int)
    return triangulate(in_step(one, clocks)[times], cameras)


@dataclass(frozen=True)
class _Size:
    """A length that is known: a person's stature, or the distance of two cameras by name, metres."""

    stature: float | None = None
    ends: tuple[str, str] | None = None
    apart: float = math.nan

    @classmethod
    def given(
        cls, stature: float | None, distance: tuple[str | int, str | int, float] | None, names: Sequence[str]
    ) -> _Size:
        """Return what the user gave, or raise an error that names the argument."""
        if distance is None:
            if stature is not None:
                positive("stature", stature, "length in metres")
                if not _SHORTEST <= stature <= _TALLEST:
                    expected = f"metres, {_SHORTEST} to {_TALLEST}"
                    raise InvalidInputError(f"stature: expected {expected}, got {stature}")
            return cls(stature)
        if stature is not None:
            raise InvalidInputError("stature: expected none with distance=, which gives the scale")
        if len(distance) != 3:
            raise InvalidInputError(f"distance: expected two cameras and metres, got {distance}")
        positive("distance", distance[2], "length in metres")
        ends = [names[i] if isinstance(i, int) and i in range(len(names)) else str(i) for i in distance[:2]]
        for end in ends:
            if end not in names or ends[0] == ends[1]:
                raise InvalidInputError(f"distance: expected two of {', '.join(names)}, got {end}")
        return cls(None, (ends[0], ends[1]), distance[2])

    def of(self, rig: CameraRig, shown: float, error: float) -> tuple[float, float]:
        """Return millimetres per unit of a rig, and its relative standard error.

        A person's stature is ``shown`` ± ``error`` in it, by the population's proportions; NaN if unknown.
        """
        if self.ends is not None:
            missing = [end for end in self.ends if end not in rig.names]
            if missing:
                raise InvalidInputError(f"distance: expected cameras that were placed, got {missing[0]}")
            a, b = (np.asarray(rig[end].centre) for end in self.ends)
            return 1000.0 * self.apart / float(np.linalg.norm(a - b)), 0.0
        if not math.isfinite(shown):
            if self.stature is not None:
                sentence = "stature: expected a layout with the proportions of people, or a distance"
                raise InvalidInputError(f"{sentence} of two cameras, got neither")
            return 1.0, math.inf
        mean, spread = ADULT if self.stature is None else (1000.0 * self.stature, 0.0)
        short, doubt = _SHOWN
        return short * mean / shown, math.hypot(error / shown, spread / mean, doubt)


def _report(found: Mapping[str, Any], names: Sequence[str], i: int, axes: Array) -> CalibratedCamera:
    """Return what was found about camera `i`, in a world of these scaled axes (3, 3), rows."""
    values = {name: float(found[key][i]) for name, key in _NUMBERS.items()}
    return CalibratedCamera(
        names[i],
        "placed" if found["used"][i] else "left_out",
        **values | {"turn_sigma": math.degrees(values["turn_sigma"])},
        place_covariance=axes @ found["shift_covariance"][i] @ axes.T,
        span=found["spans"].get(i),
    )


def _are_small(
    cameras: CameraRig, points: Array, scale: float, report: Sequence[CalibratedCamera], joint_sigma: float
) -> bool:
    """Whether all error bars are small enough to be true, of cameras that see points (T, N, 3)."""
    middle = np.nanmedian(points.reshape(-1, 3), axis=0)
    reach = [scale * float(np.linalg.norm(np.asarray(camera.centre) - middle)) for camera in cameras]
    placed = [one for one in report if one.status == "placed"]
    small = [
        one.turn_sigma <= _SURE_DEG and one.place_sigma <= _SURE_PLACE * distance
        for one, distance in zip(placed, reach, strict=True)
    ]
    return all(small) and joint_sigma <= _SURE_JOINTS * scale * body_size(points)
