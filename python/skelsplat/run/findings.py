"""What a person should look at before trusting a run, in words."""

from __future__ import annotations

import shlex
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.run.displaced import (
    also_displaced,
    apart_doubts,
    displaced_cameras,
    displaced_doubts,
    to_one_side,
)
from skelsplat.run.people import are_mixed, people_doubts
from skelsplat.run.summary import finite_median

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from collections.abc import Set as AbstractSet

    import numpy.typing as npt

    from skelsplat.run.read import Inputs
    from skelsplat.run.solve import Outcome
    from skelsplat.run.summary import Group, Statistics

# Most: at least this share.
_MOSTLY = 0.5
# Under normal noise hardly a detection is rejected (k < 1/4 at σ = 2 s has probability 4⁻⁸), and a detector's
# outliers are a few per cent. A camera stands out with this share and this multiple of the other cameras'
# median,
_CAMERA_SHARE, _CAMERA_RATIO = 0.1, 3.0
# or with this share and this multiple of the best camera's, as two bad cameras raise the median;
_BAD_SHARE, _BEST_RATIO = 0.2, 2.0
# the whole recording with this, or with the lesser share that also those have who are not named for it.
_WHOLE_SHARE, _REST_SHARE = 1 / 3, 0.2
# A robust fit may leave the median where it was; a tenth more is further away.
_FURTHER, _FURTHER_PX = 1.1, 0.1  # less is the rounding of the detections
# Nobody of those whom a camera detects is the one whom the others see, in this share of the frames at least;
# beside a camera in which that is so in most frames, this share of the frames with somebody is enough.
_SOME, _ALSO_UNFIT = 0.1, 0.25
# About half the arms and legs, which are half of a layout's joints or more.
_MIRRORED_SHARE = 0.25
# Longer side over shorter side that no person's arms or legs have.
_LIMB_RATIO = 1.5
# A joint's error bar over the typical joint's.
_BAR_RATIO = 2.0
_MOST_FRAMES = 6


def find_doubts(
    inputs: Inputs, outcome: Outcome, statistics: Statistics, written: npt.NDArray[np.str_]
) -> list[str]:
    """Return sentences on cameras that disagree and on joints that fit nowhere or are not well known.

    ``written`` (T, N) is the status of the poses written, where joints may be filled over time.
    """
    unfit = _unfit_cameras(inputs)
    return [
        *people_doubts(inputs, outcome),
        *_whole(statistics, mixed=are_mixed(inputs)),
        *_unfit(inputs, unfit),
        *_places_in_images(inputs, statistics, unfit),
        *_mirrored(statistics),
        *_limbs(inputs, outcome),
        *_joints(statistics),
        *_statuses(inputs, outcome, written),
    ]


def _whole(statistics: Statistics, *, mixed: bool = False) -> Iterator[str]:
    total = statistics.total
    if total.used == 0:
        yield "No detection could be used: are they pixels of these cameras' images (not 0 to 1), x before y?"
    elif total.rejected_share >= _WHOLE_SHARE or min(total.rejected_share, _rest(statistics)) >= _REST_SHARE:
        first = "that all views show the same person (--person), then " if mixed else ""
        yield (
            f"{_percent(total.rejected_share)} of all detections are rejected: check {first}"
            "that calibration, cameras and detections belong together, their timing, the unit and the layout."
        )
    elif total.after_px > max(_FURTHER * total.before_px, total.before_px + _FURTHER_PX):
        yield (
            "The refined pose lies further from the detections than its start (median "
            f"{total.before_px:.1f} to {total.after_px:.1f} px): check the layout, the unit and the "
            "calibration."
        )


def _rest(statistics: Statistics) -> float:
    """Return the rejected part of the detections of cameras and joints that are not named for theirs."""
    bad = _bad_cameras(statistics.cameras)
    cameras = [group not in bad for group in statistics.cameras]
    joints = [group.rejected_share < _MOSTLY for group in statistics.joints]
    part = np.s_[:, np.flatnonzero(cameras)[:, None], np.flatnonzero(joints)]
    used = np.isfinite(statistics.error_after[part]).sum()
    return float(statistics.rejected[part].sum() / max(1, used))


def _unfit_cameras(inputs: Inputs) -> dict[int, tuple[int, int]]:
    """Return the cameras that see people, but mostly nobody who fits the others, with two numbers of frames.

    Those in which nobody fits, of those in which a camera and another detect somebody. Two cameras that are
    exchanged share the blame unequally, so that beside one others are named sooner.
    """
    somebody = inputs.nobody_fits | np.isfinite(inputs.detections[..., 0]).any(axis=2)
    count, seen = inputs.nobody_fits.sum(axis=0), somebody.sum(axis=0)
    shares = np.where(count >= _SOME * len(somebody), count / np.maximum(seen, 1), 0.0)
    least = _ALSO_UNFIT if (shares >= _MOSTLY).any() else _MOSTLY
    return {int(i): (int(count[i]), int(seen[i])) for i in np.flatnonzero(shares >= least)}


def _unfit(inputs: Inputs, unfit: dict[int, tuple[int, int]]) -> Iterator[str]:
    if not unfit:
        return
    names = [inputs.rig.names[i] for i in unfit]
    without = " ".join(f"--without {shlex.quote(name)}" for name in names)
    leave = f"; {without} leaves {'it' if len(names) == 1 else 'them'} out"
    yield (
        f"In {_and(names)} somebody is detected, but nobody who fits the other cameras, in "
        f"{_and([f'{count:,} of {seen:,}' for count, seen in unfit.values()])} of the frames in which "
        f"{'it' if len(names) == 1 else 'they'} and others detect somebody: exchanged cameras, a wrong "
        "calibration, another clock, or other people? check-cameras looks for the cause"
        f"{leave if len(inputs.rig) - len(names) >= 2 else ''}."
    )


def _places_in_images(inputs: Inputs, statistics: Statistics, unfit: Mapping[int, object]) -> Iterator[str]:
    """Name cameras without a use, that disagree or are displaced, and views that lie apart in some frames."""
    names, shifts = inputs.rig.names, statistics.shifts
    unfit_names = {names[i] for i in unfit}
    if are_mixed(inputs):  # which has been said, and explains what lies elsewhere
        yield from _cameras(statistics, unfit_names)
        return
    displaced = displaced_cameras(inputs.rig, shifts)
    bad = {group.name for group in _bad_cameras(statistics.cameras)}
    worst = [i for i in displaced if names[i] in bad]
    rest = [i for i in displaced if names[i] not in bad]
    sides = {names[i]: to_one_side(shifts, i) for i in worst}
    if worst:
        sides[names[worst[0]]] += also_displaced(names, shifts, rest, worst[0])
    yield from _cameras(statistics, unfit_names, sides)
    yield from displaced_doubts(names, shifts, [] if worst else rest, unfit_names)
    yield from apart_doubts(inputs.rig, statistics, {*displaced, *unfit})


def _cameras(
    statistics: Statistics,
    unfit: AbstractSet[str] = frozenset(),
    sides: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[str]:
    """Name cameras without a use and those that disagree.

    Of those that are ``unfit`` more has been said; ``sides`` says by name where detections lie.
    """
    bad = _bad_cameras(statistics.cameras)
    good = [group for group in statistics.cameras if group.used and group not in bad]
    good_share = sum(group.rejected for group in good) / max(1, sum(group.used for group in good))
    theirs = "theirs" if len(bad) == 1 else f"those of {', '.join(group.name for group in good)}"
    leave = len(statistics.cameras) > 2  # two must remain
    for group in statistics.cameras:
        if statistics.total.used and not group.used and group.name not in unfit:
            yield (
                f"{group.name} has no detection that could be used. Either it does not see the person, or "
                "what it sees does not agree with the other views: --person says who is followed"
                f"{_without(group) if leave else ''}."
            )
        elif group in bad:
            yield (
                f"{group.name} disagrees with the other cameras: {_percent(group.rejected_share)} of its "
                f"detections are rejected, {_percent(good_share)} of {theirs}, and its mean weight is "
                f"{group.mean_weight:.2f}. {_sides(sides.get(group.name))}"
                "The pose follows the others: check this camera's calibration and "
                "timing, and what it can see. check-cameras looks for the cause"
                f"{_without(group) if leave and group.name not in unfit else ''}."
            )


def _sides(where: str | None) -> str:
    return f"Its detections lie {where}. " if where else ""


def _without(group: Group) -> str:
    return f"; --without {shlex.quote(group.name)} leaves it out"


def _bad_cameras(cameras: Sequence[Group]) -> list[Group]:
    """Return the cameras whose share of rejected detections stands out; never all of them."""
    used = [group for group in cameras if group.used]
    bad = []
    for group in used:
        others = [other.rejected_share for other in used if other is not group]
        if not others:
            continue
        share = group.rejected_share
        far = share >= max(_CAMERA_SHARE, _CAMERA_RATIO * finite_median(others))
        if far or share >= max(_BAD_SHARE, _BEST_RATIO * min(others)):
            bad.append(group)
    return bad


def _mirrored(statistics: Statistics) -> Iterator[str]:
    for group in statistics.cameras:
        if group.used and group.swapped >= _MIRRORED_SHARE * group.used:
            share = _percent(group.swapped / group.used)
            yield f"{group.name}: left and right are exchanged in {share} of its detections: is it mirrored?"


def _limbs(inputs: Inputs, outcome: Outcome) -> Iterator[str]:
    """Name the pair of limbs whose lengths differ most between left and right, if no person has that."""
    layout, joints = inputs.layout, inputs.layout.joints
    known = np.asarray(outcome.result.joint_status) == "ok"
    pose = np.where(known[..., None], outcome.result.pose, np.nan) * inputs.rig.mm_per_unit

    def length(limb: tuple[int, int]) -> float:
        return finite_median(np.linalg.norm(pose[:, limb[0]] - pose[:, limb[1]], axis=-1))

    pairs = layout.symmetric_pairs(2)
    lengths = [(length(left), length(right)) for left, right in pairs]
    ratios = [max(pair) / min(pair) if min(pair) > 0 else 0.0 for pair in lengths]
    if ratios and max(ratios) > _LIMB_RATIO:
        worst = int(np.argmax(ratios))
        names = (f"{joints[a]} to {joints[b]}" for a, b in pairs[worst])
        sizes = (f"{name} {size:.0f} mm" for name, size in zip(names, lengths[worst], strict=True))
        alike = [name for name in sk.layouts.names if sk.layouts.get(name).n_joints == layout.n_joints]
        others = " and ".join(name for name in alike if name != layout.name)
        hint = f" ({others} has as many joints)" if others else ""
        yield f"Left and right differ, {' and '.join(sizes)}: is the layout right{hint}?"


def _joints(statistics: Statistics) -> Iterator[str]:
    rejected = [group.name for group in statistics.joints if group.rejected_share >= _MOSTLY]
    if 0 < len(rejected) <= _MOSTLY * len(statistics.joints):  # of more, the whole recording is in doubt
        yield f"Most detections are rejected for {', '.join(rejected)}."
    typical = finite_median(statistics.error_bar_mm)
    bars = [finite_median(bar) for bar in statistics.error_bar_mm.T]
    wide = [
        f"{group.name} ({bar:.0f} mm)"
        for group, bar in zip(statistics.joints, bars, strict=True)
        if bar > _BAR_RATIO * typical
    ]
    if wide:
        yield f"Error bars far above the median of {typical:.0f} mm: {', '.join(wide)}."


def _statuses(inputs: Inputs, outcome: Outcome, written: npt.NDArray[np.str_]) -> Iterator[str]:
    status, filled = np.asarray(outcome.result.joint_status), written == "filled"
    placed = np.isfinite(outcome.result.pose).all(axis=-1)
    asked = np.array([joint not in inputs.lacking for joint in inputs.layout.joints])
    for label, where, meaning, remedy in (
        (
            "weak",
            (status == "weak") & placed,
            " (fewer than two views agree, or as many agree on another place: the position is not "
            "determined)",
            " Files hold it like any other; refine --fill-gaps N --fill-weak interpolates it.",
        ),
        (
            "weak",
            (status == "weak") & ~placed,
            " and without a position, as a single view detects it or views from one place",
            " refine --fill-gaps N interpolates it.",
        ),
        (
            "unobserved",
            status == "unobserved",
            ", that is, has no usable detection and keeps its start, if it has one",
            "",
        ),
    ):
        where = where & asked
        if (where & ~filled).any():
            yield f"{label}{meaning}: {_places(inputs, where & ~filled)}.{remedy}"
        if (where & filled).any():
            yield f"{label}, now filled from the frames around: {_places(inputs, where & filled)}."


def _places(inputs: Inputs, where: npt.NDArray[np.bool_]) -> str:
    """Return joints with the frames where (T, N) holds."""
    return ", ".join(
        f"{name} ({_frames(inputs.frames[where[:, j]])})"
        for j, name in enumerate(inputs.layout.joints)
        if where[:, j].any()
    )


def is_of_size(warning: str) -> bool:
    """Say whether a warning is of the size of the rig or the person, which is that of the unit."""
    return " apart in " in warning or "is the unit really" in warning


def _and(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _percent(share: float) -> str:
    return f"{100 * share:.0f}%"


def _frames(numbers: np.ndarray) -> str:
    if len(numbers) > _MOST_FRAMES:
        return f"{len(numbers)} frames"
    return f"frame{'s' * (len(numbers) > 1)} {', '.join(str(int(n)) for n in numbers)}"
