"""Doubts about people who were followed over time: whom few views see, who never moves or is a reflection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from skelsplat._arrays import Index
from skelsplat._people import layouts_alike
from skelsplat._words import length, listed, percent
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.layouts import mirror_images

if TYPE_CHECKING:
    from skelsplat.run.read import Inputs

# A third view confirms a person; two agree on whatever lies where their rays meet.
_CONFIRMED = 3
# Nobody stands as still as this for so long, while posters and dummies do, mm and s: detections of good
# detectors scatter by 4 mm once smoothed, and somebody at rest sways by 5 mm and moves a hand or the head.
_STILL_MM, _STILL_S = 7.0, 3.0
# So near is nobody to the reflection of somebody else, at least this far apart, in nine tenths of the joints,
# mm. In 40 simulated scenes of 2 to 5 people with the same body the nearest are 106 mm from it, simulated
# reflections at most 28 mm.
_SAME_MM, _APART_MM = 60.0, 500.0
# Bones that differ by less, in the median, may be of one person.
_SAME_BONES = 0.05
# Part of the people detected who may be left out: those whom one view sees, and false detections.
_LEFT_OUT = 0.25
# Two bodies nearer than 4 σ become one: those of fewer σ need a smaller one, that of people in proportion.
_SMALL, _SIGMA_PER_SIZE = 15.0, 1 / 60
# Fewer are no pattern.
_LEAST_DETECTED = 20


def find_doubts(people: Sequence[Inputs], of: Inputs) -> Iterator[Finding]:
    """Yield doubts about one of the people who were found."""
    seen = np.isfinite(of.detections[..., 0]).any(axis=-1)
    views = seen.sum(axis=1)
    if len(of.rig) >= _CONFIRMED and np.median(views) < _CONFIRMED:
        counts = {
            name: int(count) for name, count in zip(of.rig.names, seen.sum(axis=0), strict=True) if count
        }
        cameras = listed([f"{name} in {count:,}" for name, count in counts.items()])
        yield Finding(
            "person_of_few_views",
            "warning",
            Subject(cameras=tuple(counts)),
            {
                "person": int(of.person),
                "frames_seen": list(counts.values()),
                "frames": len(views),
                "views": float(np.median(views)),
            },
            sentence=f"Mostly two views or fewer see this person ({cameras} of {len(views):,} frames), so no "
            "third view confirms the pose.",
        )
    still = moved_mm(of)
    if still < _STILL_MM and lasts(of) >= _STILL_S and any(moved_mm(one) >= _STILL_MM for one in people):
        yield Finding(
            "person_still",
            "warning",
            numbers={"person": int(of.person), "moved_mm": still, "seconds": lasts(of)},
            sentence=f"This person hardly moves: positions vary by {still:.0f} mm in {lasts(of):.0f} s. A "
            "poster, a dummy, or somebody who keeps still?",
        )
    away = {one.person: reflection_mm(one, of) for one in people if is_nearer(one, of)}
    same = min(away, key=lambda who: away[who], default=None)
    if same is not None and away[same] < _SAME_MM:
        yield Finding(
            "person_mirrored",
            "warning",
            numbers={"person": int(of.person), "of": int(same), "apart_mm": away[same]},
            sentence=f"This person is the mirror image of person {same}, within {away[same]:.0f} mm: a "
            "reflection in a mirror or a window?",
        )
    yield from find_return(people, of)


def find_return(people: Sequence[Inputs], of: Inputs) -> Iterator[Finding]:
    """Yield a note if somebody of the same bones was there before, and gone: perhaps the same person."""
    gone = [one for one in people if one.frames[-1] < of.frames[0] and bones_differ(one, of) < _SAME_BONES]
    if not gone:
        return
    last = min(gone, key=lambda one: bones_differ(one, of))
    before, frame, percents = int(last.person), int(last.frames[-1]), 100.0 * bones_differ(last, of)
    yield Finding(
        "person_back",
        "note",
        numbers={"person": int(of.person), "before": before, "last": frame, "percent": percents},
        sentence=f"This may be person {before} again, who was last seen in frame {frame}: their bones differ "
        f"by {percents:.0f} %. Whoever is away for longer than five seconds, or cannot have got there, gets "
        "a new number.",
    )


def bones_differ(one: Inputs, other: Inputs) -> float:
    """Return the median difference of two people's bones, relative to their length; inf without any."""
    if one.solved is None or other.solved is None:
        return float("inf")
    ratio = np.abs(np.log(np.asarray(one.solved.bone_lengths) / np.asarray(other.solved.bone_lengths)))
    return float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else float("inf")


def is_nearer(one: Inputs, other: Inputs) -> bool:
    """Whether a person is nearer to the cameras than another, as people are than their reflections."""
    centre = np.mean([camera.centre for camera in one.rig], axis=0)
    own, theirs = (
        np.linalg.norm(np.nanmedian(who.solved.pose, axis=(0, 1)) - centre) if who.solved else np.nan
        for who in (one, other)
    )
    return bool(own < theirs)


def reflection_mm(one: Inputs, other: Inputs) -> float:
    """Return how far a person is from another's reflection in the plane that fits best; inf if they touch.

    That is the 90th percentile over joints and frames in which both are known.
    """
    if one.solved is None or other.solved is None:
        return float("inf")
    _, here, there = np.intersect1d(one.frames, other.frames, return_indices=True)
    swapped = mirror_images(one.layout.n_joints, one.layout.left_right)
    own, image = np.asarray(one.solved.pose)[here][:, swapped], np.asarray(other.solved.pose)[there]
    known = np.isfinite(own).all(axis=-1) & np.isfinite(image).all(axis=-1)
    own, image = own[known] * one.rig.mm_per_unit, image[known] * one.rig.mm_per_unit
    normal = (image - own).mean(axis=0) if len(own) >= _LEAST_DETECTED else np.zeros(3)
    if np.linalg.norm(normal) < _APART_MM:
        return float("inf")
    normal /= np.linalg.norm(normal)
    depth = np.median((own + image) @ normal) / 2 - own @ normal
    return float(np.quantile(np.linalg.norm(own + 2 * depth[:, None] * normal - image, axis=-1), 0.9))


def moved_mm(of: Inputs) -> float:
    """Return the standard deviation of the position over time, of the joint that moves most but for a tenth.

    NaN where no position is known.
    """
    if of.solved is None:
        return float("nan")
    place = np.asarray(of.solved.pose)
    known = place[:, np.isfinite(place).all(axis=(0, 2))]
    if not known.size:
        return float("nan")
    return float(np.quantile(np.sqrt(known.var(axis=0).sum(axis=-1)), 0.9)) * of.rig.mm_per_unit


def lasts(of: Inputs) -> float:
    """Return the seconds from the first frame to the last."""
    return float(of.frames[-1] - of.frames[0]) / of.fps if of.fps else 0.0


def find_left_out(
    detected: Index, assigned: Index, of: Inputs, size_mm: float, sigma_mm: float
) -> Iterator[Finding]:
    """Yield a finding if many of the people detected in each view (T, M) are none of those who were found.

    Those found, of ``size_mm``, may be several in one if they are small for ``sigma_mm``.
    """
    everybody, left = detected.sum(), (detected - assigned).sum(axis=0)
    if everybody < _LEAST_DETECTED or left.sum() < _LEFT_OUT * everybody:
        return
    shares = left / np.maximum(detected.sum(axis=0), 1)
    named = np.flatnonzero(shares >= _LEFT_OUT)
    alike, share = layouts_alike(of.layout), float(left.sum() / everybody)
    finer = [Remedy("sigma_mm", f"{size_mm * _SIGMA_PER_SIZE:.1g}")] if size_mm < _SMALL * sigma_mm else []
    small = f"small bodies merged into one (those found are {length(size_mm, 0)} mm long), " if finer else ""
    cameras = ", ".join(f"{of.rig.names[i]} {percent(shares[i])}" for i in named)
    layout = (
        f"a wrong layout ({' or '.join(alike)} has the same number of joints)" if alike else "a wrong layout"
    )
    yield Finding(
        "people_left_out",
        "warning",
        Subject(cameras=tuple(of.rig.names[i] for i in named)),
        {
            "size_mm": size_mm,
            "left_out_share": share,
            "shares": shares[named].tolist(),
            "layouts_of_as_many_joints": alike,
        },
        (*finer, Remedy("layout", None)),
        sentence=f"{percent(share)} of the people detected are none of those found ({cameras}): {small}"
        f"people whom one view sees, false detections, {layout}, or cameras that do not fit. Check "
        "the cameras.",
    )
