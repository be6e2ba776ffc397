"""``adjust_cameras``: cameras set right by the detections of a recording, in the compiled core."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat import _skelsplat
from skelsplat._arrays import Array, numbers, pixels, whole_numbers
from skelsplat._clocks import in_step
from skelsplat._frozen import frozen, without_frozen
from skelsplat._refine import Cameras
from skelsplat._skelsplat import RefineConfig
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import InvalidInputError


@dataclass(frozen=True, slots=True)
class CameraAdjustment:
    """What became of one camera.

    Error bars (``…_sigma``) are root-mean-square lengths of the error, from leaving out one joint after the
    other. Those of a camera that stays say how far off it may still be: √(θ² + σ²), if a change θ ± σ fits
    best but cannot be told from chance. NaN for what was not looked at.

    ``status`` is ``"sound"`` (it stays as it is), ``"adjusted"``, ``"late"`` (its clock is off, and it stays;
    if it was turned or moved as well, it is adjusted, and ``clock`` says so), ``"doubtful"`` (it or another
    doubtful camera is wrong, or other clocks explain as much, and all stay) or ``"unseen"`` (it sees too
    little, or is one of two cameras), ``"unsteady"`` (its clock changes by ``clock`` at the time ``since``:
    frames were skipped, or its rate is another; it stays), or ``"knocked"`` (it was moved at the time
    ``since``, and stays; the change is that of the part in which it is not as given).

    Attributes
    ----------
    turn : (3,) float64
        Rotation vector from the given orientation to the new one about the camera's x, y, z axes, degrees.
        Of a doubtful camera, this and the following are what it is suspected of.
    shift : (3,) float64
        Movement of the camera's centre in the world, in the unit of the cameras.
    focal, clock : float
        Factor of the focal lengths; frames by which the camera's count is ahead: its frame t + ``clock``
        shows what the others show in frame t.
    before, after : float
        Median distance, px, of the camera's detections from where the other cameras place the joints, in
        frames on which nothing was adjusted; with all cameras as given, and as returned with clocks as found.
    """

    name: str
    status: str
    turn: NDArray[np.float64]
    shift: NDArray[np.float64]
    focal: float
    clock: float
    turn_sigma: float
    shift_sigma: float
    focal_sigma: float
    clock_sigma: float
    before: float
    after: float
    since: int | None = field(default=None, kw_only=True)

    @property
    def degrees(self) -> float:
        """Angle of the turn."""
        return float(np.linalg.norm(self.turn))

    @property
    def distance(self) -> float:
        """Length of the shift, in the unit of the cameras."""
        return float(np.linalg.norm(self.shift))


@dataclass(frozen=True, slots=True)
class RigAdjustment:
    """What ``adjust_cameras`` returns.

    ``cameras`` are the adjusted ones, with the given ones where not ``"adjusted"``; ``report`` has one entry
    for each. Cameras were adjusted on ``fitted`` frames, ``before`` and ``after`` measured on ``judged``
    others, 0 of a recording of fewer than ten frames.
    """

    cameras: CameraRig
    report: tuple[CameraAdjustment, ...] = field(repr=False)
    fitted: int = field(repr=False)
    judged: int = field(repr=False)

    def of(self, *status: str) -> tuple[CameraAdjustment, ...]:
        """Return the reports of cameras with one of these ``status``."""
        return tuple(one for one in self.report if one.status in status)

    def synchronised(self, detections: ArrayLike) -> Array:
        """Return detections (T, M, N, 2|3) with the clocks of late and adjusted cameras set right.

        For parts of a frame, joints are moved in a straight line towards their place in the next or previous
        frame; those that are missing there, or that jump, stay. NaN where a camera has no such frame.
        """
        seen = numbers(detections, "detections")
        if seen.ndim != 4 or seen.shape[1] != len(self.report) or seen.shape[3] not in (2, 3):
            expected = f"(T, {len(self.report)}, N, 2 or 3)"
            raise InvalidInputError(f"detections: expected shape {expected}, got {seen.shape}")
        right = ("late", "adjusted")
        return in_step(seen, {i: one.clock * (one.status in right) for i, one in enumerate(self.report)})


def adjust_cameras(
    detections: ArrayLike,
    cameras: Cameras,
    *,
    times: ArrayLike | None = None,
    free: Sequence[str | int] | None = None,
    focal: bool = False,
    clock: bool = False,
    confidence: ArrayLike | None = None,
    config: RefineConfig | None = None,
) -> RigAdjustment:
    """Find the cameras that were turned or moved since the calibration, and set them right.

    Bundle adjustment of cameras and joints, with the robust kernel of ``refine``. A camera stays exactly
    where it is unless the detections show that it is elsewhere; the sound ones, more than half, hold the
    world's frame and scale. Clocks are measured first, by motion, up to 30 frames. Exchanged files, other
    images or a wrong unit look like cameras far off: ``skelsplat check-cameras`` names them, and the command
    stops there. docs/method.md has the mathematics.

    Parameters
    ----------
    detections : (T, M, N, 2|3)
        Of one person or animal who moves about: the frames in order, NaN where missing. Of several people,
        one after another, with 31 empty frames between them (`skelsplat.run.cameras` tells them apart).
    times : (T,) int, optional
        Which frame of the recording each one is, for several people; 0, 1, … when left out.
    free : sequence of str or int, optional
        Names or numbers of the cameras that are wrong, in place of finding them; at least one must stay.
    focal : bool
        Also adjust focal lengths. Close to a movement along the optical axis, so only where zoom or focus may
        have changed.
    clock : bool
        Also measure clocks to parts of a frame. Offsets of whole frames are looked for in any case.
    cameras, confidence, config
        As in ``refine``. Of the settings, ``min_confidence``, ``undistort`` and ``n_threads`` count.
    """
    rig = cameras if isinstance(cameras, CameraRig) else CameraRig(cameras)
    named = [free] if isinstance(free, str) else free
    chosen = None if named is None else [_number(rig, one) for one in named]
    seen = pixels(detections, "detections")
    if seen.ndim == 4:
        seen = without_frozen(seen, frozen(seen))
    when = None if times is None else whole_numbers(times, "times")
    adjusted, out = _skelsplat.adjust_cameras(
        seen, rig, times=when, confidence=confidence, free=chosen, focal=focal, clock=clock, config=config
    )
    degrees = 180.0 / math.pi
    sigmas = (out["turn_sigma"] * degrees, out["shift_sigma"], out["zoom_sigma"], out["clock_sigma"])
    numbers_of = zip(out["zoom"], out["clock"], *sigmas, out["before"], out["after"], strict=True)
    places = zip(rig.names, out["status"], out["turn"] * degrees, out["shift"], strict=True)
    report = [
        CameraAdjustment(*place, *map(float, values), since=since)
        for place, values, since in zip(places, numbers_of, out["since"], strict=True)
    ]
    fitted, judged = out["frames"]
    return RigAdjustment(replace(rig, cameras=adjusted, clocks={}), tuple(report), fitted, judged)


def _number(rig: CameraRig, camera: str | int) -> int:
    """Return the place of a camera given by name or number."""
    if isinstance(camera, str):
        if camera not in rig.names:
            raise InvalidInputError(f"free: unknown camera '{camera}'; there are {', '.join(rig.names)}")
        return rig.names.index(camera)
    if not 0 <= camera < len(rig):
        raise InvalidInputError(f"free: expected cameras 0 to {len(rig) - 1}, got {camera}")
    return int(camera)
