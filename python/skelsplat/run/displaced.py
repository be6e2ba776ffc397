"""Findings on detections that are shifted from the pose, always or in some frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat._arrays import Array, Index, Mask, medians
from skelsplat._words import listed, percent
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.layouts import mirror_images
from skelsplat.run.person import MIXED, gates_px

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from collections.abc import Set as AbstractSet

    import skelsplat as sk
    from skelsplat.run.summary import Statistics


_LEAST_FRAMES = 3  # fewer frames may be chance
_ALSO_APART = 0.5  # of the frames of the camera whose view lies apart in most
_RIVAL = 0.5  # a camera displaced by this part of the largest shift may be the wrong one
# Part of the median error from which on the median shift explains it: 0.06 of pure scatter after 60 frames.
_ONE_SIDED = 0.7
# of the image's diagonal: the noise of one good detection; sound rigs stay below 0.0011 from five frames on
_LEAST_SHIFT = 0.004
# Probability that joints whose offsets point any way would share such a shift. Neighbours (eyes, toes) share
# some of their offsets: if only half of the joints count, 1e-4 still is 1e-2.
_CHANCE = 1e-4
# The same where those of another camera lie to one side, too: a wrong camera pulls the pose to its side.
_UNSURE = 0.05
_LEAST_DETECTIONS = 50  # fewer detections are no pattern: three frames of a body
_DIRECTION = 0.1  # a direction is named from this part of the shift on
_LEAST_JOINTS = 4  # fewer joints of a view are no whole; as many make a person


@dataclass(frozen=True)
class Shifts:
    """How the detections of M cameras lie beside the reprojected pose over all frames."""

    shift: Array  # (M, 2) median of detection − projection [px], x to the right and y down; NaN without
    error: Array  # (M,) median distance [px]
    chance: Array  # (M,) probability of a shift like this if joints' offsets point any way (`same_side`)
    count: Index  # (M,) detections

    @property
    def size(self) -> Array:
        """Length of the shift [px], (M,)."""
        return np.hypot(self.shift[:, 0], self.shift[:, 1])

    def one_sided(self, diagonal: Array, chance: float = _CHANCE) -> Mask:
        """Return the cameras (M,) whose detections lie to one side; ``diagonal`` (M,) of the images [px]."""
        with np.errstate(invalid="ignore"):
            mask: Mask = (
                (self.count >= _LEAST_DETECTIONS)
                & (self.size >= _ONE_SIDED * self.error)
                & (self.size >= _LEAST_SHIFT * diagonal)
                & (self.chance < chance)
            )
        return mask


def camera_shifts(residual: Array) -> Shifts:
    """Measure the shift of every camera from residuals (T, M, N, 2), NaN where there is no detection."""
    views = residual.shape[1]
    shift, error, chance = np.full((views, 2), np.nan), np.full(views, np.nan), np.ones(views)
    known: Mask = np.isfinite(residual[..., 0]) & np.isfinite(residual[..., 1])
    for i in np.flatnonzero(known.any(axis=(0, 2))):
        there, vectors = known[:, i], residual[:, i]
        shift[i] = np.median(vectors[there], axis=0)
        error[i] = np.median(np.hypot(vectors[there][:, 0], vectors[there][:, 1]))
        joints = np.flatnonzero(there.any(axis=0))
        chance[i] = same_side(np.array([np.median(vectors[there[:, j], j], axis=0) for j in joints]))
    return Shifts(shift, error, chance, known.sum(axis=(0, 2)))


def same_side(offsets: Array) -> float:
    """Return the probability that (J, 2) offsets of mean zero have a mean like theirs; 1 for three or fewer.

    Hotelling's test: with A the scatter of the offsets round their mean and B that round zero,
    p = (det A / det B)^((J − 2) / 2). A joint counts once: its offset hardly changes while a person stands.
    """
    whole = float(np.linalg.det(offsets.T @ offsets))
    if len(offsets) <= 3 or whole <= 0:  # all on one line through zero: nothing to compare with
        return 1.0
    centred = offsets - offsets.mean(axis=0)
    scatter = max(0.0, float(np.linalg.det(centred.T @ centred)))
    return math.pow(min(1.0, scatter / whole), (len(offsets) - 2) / 2)


def residuals(detections: Array, projected: Array, swapped: Mask, pairs: Sequence[tuple[int, int]]) -> Array:
    """Return detection − projection [px], (T, M, N, 2), of the joint that each one was used for."""
    mirror = mirror_images(detections.shape[2], pairs)
    found: Array = detections - np.where(swapped[..., None], projected[:, :, mirror], projected)
    return found


def displaced_cameras(rig: sk.CameraRig, shifts: Shifts, noise: Array | None = None) -> list[int]:
    """Return the cameras with detections shifted from the pose, the largest shift first.

    Where frames alone follow them, their ``noise`` over time (M,) counts, and the largest is first.
    """
    diagonal = np.array([np.hypot(*camera.size) for camera in rig])
    found, size = np.flatnonzero(shifts.one_sided(diagonal)), shifts.size / diagonal
    if not found.size and noise is not None and (shifts.chance < _UNSURE).sum() >= 2:
        found, size = np.flatnonzero(shifts.one_sided(diagonal, _UNSURE)), noise
    return sorted(found.tolist(), key=lambda i: -size[i])


def find_displaced(
    names: Sequence[str],
    shifts: Shifts,
    displaced: Sequence[int],
    unfit: AbstractSet[str] = frozenset(),
    *,
    adjusted: bool = False,
) -> Iterator[Finding]:
    """Yield a finding on the first of ``displaced``, with the others; ``unfit`` ones have a remedy.

    They may have been ``adjusted`` before.
    """
    if not displaced:
        return
    name = names[displaced[0]]
    numbers = {"cameras": len(names), **shift_of(names, shifts, displaced[0], displaced[1:])}
    numbers["median_error_px"] = float(shifts.error[displaced[0]])
    wrong = f"{name}'s calibration or timing looks wrong"
    if len(names) == 2:
        wrong = "Calibration or timing of one of the two cameras looks wrong, it is impossible to tell which"
    elif len(names) == 3:
        wrong += ", or that of another of the three"
    sentence = f"{wrong}: {name}'s detections are shifted by {to_one_side(numbers)}. Check the cameras."
    remedy = () if name in unfit else remedies(name, len(names), adjusted=adjusted)
    yield Finding("camera_disagrees", "warning", Subject((name,)), numbers, remedy, sentence=sentence)


def remedies(name: str, cameras: int, *, adjusted: bool) -> tuple[Remedy, ...]:
    """Return what helps against a displaced camera of some: to adjust it, unless it was, or to do without."""
    if cameras < 3:
        return ()
    return (*(() if adjusted else (Remedy("adjust_cameras"),)), Remedy("without", name))


def shift_of(names: Sequence[str], shifts: Shifts, camera: int, others: Sequence[int] = ()) -> dict[str, Any]:
    """Return how far, and to which side, a camera's detections are off the pose, and those of ``others``.

    A wrong camera pulls the pose to its side: one that is displaced half as much may as well be the cause.
    """
    sizes, limit = shifts.size.tolist(), _RIVAL * shifts.size[camera]
    also = [
        {"camera": names[i], "size_px": sizes[i], "may_be_the_cause": bool(sizes[i] >= limit)} for i in others
    ]
    return {"shift_px": shifts.shift[camera].tolist(), "size_px": sizes[camera], "also_displaced": also}


def to_one_side(numbers: Mapping[str, Any]) -> str:
    """Return `shift_of` in words: "18 px from the pose (18 px left); those of cam_01 by 7 px"."""
    size, error, others = numbers["size_px"], numbers.get("median_error_px"), numbers["also_displaced"]
    sides = zip(numbers["shift_px"], (("left", "right"), ("up", "down")), strict=True)
    parts = [
        f"{abs(part):.0f} px {words[part > 0]}" for part, words in sides if abs(part) >= _DIRECTION * size
    ]
    text = f"{size:.0f} px from the pose ({', '.join(parts)})"
    text += "" if error is None else f", with a median error of {error:.1f} px"
    if others:
        text += "; " + listed([f"those of {one['camera']} by {one['size_px']:.0f} px" for one in others])
    rivals = [one["camera"] for one in others if one["may_be_the_cause"]]
    return text + (f", so {listed(rivals, 'or')} may be the cause instead" if rivals else "")


def find_apart(rig: sk.CameraRig, statistics: Statistics, known: AbstractSet[int]) -> Iterator[Finding]:
    """Yield a finding if some views as a whole are far from the pose; cameras ``known`` are left out."""
    residual = statistics.residual
    whole = np.where(np.isfinite(residual).all(axis=-1, keepdims=True), residual, np.nan)
    middle = medians(np.moveaxis(whole, -1, -2), _LEAST_JOINTS)
    apart = np.hypot(middle[..., 0], middle[..., 1]) > gates_px(rig)
    apart[:, list(known)] = False
    frames = apart.any(axis=1)
    if frames.sum() < _LEAST_FRAMES or frames.mean() < MIXED:
        return
    share, most = apart.mean(axis=0), float(frames.mean())
    named = np.flatnonzero((share > 0) & (share >= _ALSO_APART * share.max()))
    cameras = tuple(rig.names[i] for i in named)
    where = ", ".join(f"{name} in {percent(share[i])}" for name, i in zip(cameras, named, strict=True))
    numbers = {"any_share_of_frames": most, "share_of_frames": share[named].tolist()}
    sentence = f"In {percent(most)} of the frames, one camera's detections are far from the whole pose "
    sentence += f"({where}). In these frames the cameras show different people or different moments, or a "
    sentence += "calibration is wrong: inspect them, and check the cameras."
    yield Finding("views_apart", "warning", Subject(cameras), numbers, sentence=sentence)
