"""Findings on limbs: given lengths that a recording contradicts, lengths that change, and what is no bone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, medians
from skelsplat._people import limbs_differ
from skelsplat._words import length, percent
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.run.frames import some
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import finite_median

# A given length contradicts the recording beyond this many of its standard deviations and this share.
_GIVEN_SIGMAS, _GIVEN_SHARE = 3.0, 0.05
_USUAL_SIGMA_MM = 20.0  # of given lengths without standard deviations
# No distribution has more than 1/9 beyond four standard deviations from its median: the median is within one
# of the mean, and Chebyshev's inequality leaves 1/9 beyond three from the mean.
_OFF, _OFF_SHARE = 4.0, 1 / 9
# Standard deviation of a limb's length, as a part of it: detectors place joints differently in every pose.
_DEFINITION = 0.05
_LEAST_FRAMES = 10  # fewer are no distribution of lengths
# Frames that are compared as one, since a detector's errors last.
_PART = 25
# A change is shown beyond so many standard errors, as it may be at any of some dozens of frames, and beyond
# what posture does to the ends of bones: up to 5 % in 19 takes of Human3.6M (S1, S5 to S8).
_SIGMAS, _POSTURE = 5.0, 0.06
# No bone is so many times as long in a tenth of the frames as in another, beyond what noise does to it.
_VARIES, _NOISE = 2.0, 2.56


def find_bones(inputs: Inputs, alone: Outcome) -> Iterator[Finding]:
    """Yield findings on given lengths, on unequal sides, and on lengths that change once or else vary."""
    layout = inputs.layout
    sides = [limb for pair in layout.symmetric_pairs(2) for limb in pair]
    limbs, n = [*sides, *layout.limbs], len(sides)
    lengths, sigmas = lengths_mm(alone.result, limbs, inputs.rig.mm_per_unit)
    usual = medians(lengths)
    yield from _contradicted(layout, alone.config, usual[n:])
    differ = limbs_differ(layout, usual[:n].reshape(-1, 2))
    yield from [differ] if differ else _unlike_people(layout, usual[n:], medians(sigmas)[n:])
    yield from list(_changed(lengths[n:])) or find_lengths(layout, limbs, n, lengths, sigmas)


def lengths_mm(
    result: sk.Refinement, limbs: Sequence[tuple[int, int]], mm: float, pose: Array | None = None
) -> tuple[Array, Array]:
    """Return lengths (B, T) of limbs, mm, and their σ, NaN where an end is unknown; units have ``mm``."""
    a, b = np.array(limbs, dtype=int).reshape(-1, 2).T
    known = (np.asarray(result.joint_status) == "ok")[..., None]
    there = np.where(known, result.pose if pose is None else pose, np.nan)
    limb, spread = there[:, b] - there[:, a], result.uncertainty[:, a] + result.uncertainty[:, b]
    with np.errstate(invalid="ignore"):
        lengths = np.where((limb != 0).any(axis=-1), np.linalg.norm(limb, axis=-1), np.nan)
        sigmas = np.sqrt(np.einsum("tbi,tbij,tbj->tb", limb, spread, limb)) / lengths
    return mm * lengths.T, mm * sigmas.T


def percentiles(lengths: Array, *shares: float) -> tuple[Index, Array]:
    """Return the limbs known in enough frames, and percentiles (…, B) of the lengths of these."""
    kept = np.flatnonzero(np.isfinite(lengths).sum(axis=1) >= _LEAST_FRAMES)
    return kept, np.nanpercentile(lengths[kept], shares, axis=1) if kept.size else np.empty((len(shares), 0))


def find_lengths(
    layout: sk.Layout, limbs: Sequence[tuple[int, int]], sides: int, lengths: Array, sigmas: Array
) -> Iterator[Finding]:
    """Yield a finding on the limb that varies most, if lengths vary by more than scatter explains.

    That is judged from the first limbs, arms and legs, with the variance of both ends along the limb and
    (5 % of the length)²; another limb is no bone.
    """
    kept, (low, least, median, most, high) = percentiles(lengths, 5, 10, 50, 90, 95)
    away = np.abs(lengths[kept] - median[:, None]) / np.hypot(sigmas[kept], _DEFINITION * median[:, None])
    off = away[kept < sides]
    share = float((off > _OFF).sum() / max(1, np.isfinite(off).sum()))
    shown = np.isfinite(away).sum(axis=1) >= 4 * _PART
    if share > _OFF_SHARE or (shown & (most > _VARIES * least + _NOISE * medians(sigmas[kept]))).any():
        worst = int(np.argmax((high - low) / median))
        a, b = (layout.joints[joint] for joint in limbs[kept[worst]])
        ends, relative = [float(low[worst]), float(high[worst])], float((high - low)[worst] / median[worst])
        first, last = (length(end, 0, 10.0) for end in ends)
        words = f"Limb lengths vary by up to {percent(relative)} over the recording, which is impossible for "
        words += f"one body. {a} to {b} is {first} to {last} mm long (5th to 95th percentile), and "
        words += f"{percent(share)} of the lengths of arms and legs deviate by more than scatter explains. "
        words += "Either the views show different people, or most views are wrong about these joints, or "
        words += "they are no bone."
        numbers = {"relative_range": relative, "range_mm": ends, "off_share": share}
        yield Finding("limb_lengths_vary", "warning", Subject(joints=(a, b)), numbers, sentence=words)


def _unlike_people(layout: sk.Layout, lengths: Array, sigmas: Array) -> Iterator[Finding]:
    """Yield a finding on the bone that fits the person's other bones least, if it does not fit them."""
    bones = [layout.limbs.index(ends) for ends, _, _ in layout.proportions]
    ratios, spreads = np.array([row[1:] for row in layout.proportions]).reshape(-1, 2).T
    logs = np.log(lengths[bones] / ratios)
    usual = finite_median(logs)
    off = np.nan_to_num(np.abs(logs - usual) / np.hypot(spreads, sigmas[bones] / lengths[bones]))
    worst = int(off.argmax()) if off.max(initial=0.0) > _SIGMAS else -1
    if worst >= 0:
        a, b = (layout.joints[joint] for joint in layout.proportions[worst][0])
        long, factor = float(lengths[bones[worst]]), float(np.exp(logs[worst] - usual))
        words = f"{a} to {b} is {length(long, 0, 10.0)} mm long, {factor:.1f} times what the person's other "
        words += "bones suggest. Are the detector's joints in the order of the layout?"
        yield Finding(
            "bones_unlike_people",
            subject=Subject(joints=(a, b)),
            numbers={"length_mm": long, "factor": factor},
            remedy=(Remedy("layout", None),),
            sentence=words,
        )


def _contradicted(layout: sk.Layout, config: sk.RefineConfig, measured: Array) -> Iterator[Finding]:
    """Yield a finding on given lengths of bones that the recording contradicts."""
    given, sigmas = np.zeros(len(measured)), np.full(len(measured), _USUAL_SIGMA_MM)
    if config.method == "paper" or config.bones == "free":
        return
    if config.bone_lengths_mm is not None:
        given, sigmas = np.asarray(config.bone_lengths_mm), np.asarray(config.bone_sigmas_mm or sigmas)
    for ends, one, sigma in layout.lengths if config.bone_lengths_mm is None else ():
        given[layout.limbs.index(ends)], sigmas[layout.limbs.index(ends)] = one, sigma
    allowed = np.maximum(_GIVEN_SIGMAS * sigmas, _GIVEN_SHARE * given)
    wrong = np.flatnonzero((np.abs(measured - given) > allowed) & (sigmas < given))
    if wrong.size:
        named = [[layout.joints[j] for j in layout.limbs[b]] for b in wrong]
        sizes = {"given_mm": given[wrong].tolist(), "measured_mm": measured[wrong].tolist()}
        both = zip(named, *([length(size, 0, 10.0) for size in own] for own in sizes.values()), strict=True)
        each = some([f"{a} to {b} {one} mm, measured {other} mm" for (a, b), one, other in both])
        words = f"Given bone lengths contradict the recording, which follows them if it is short: {each}."
        subject = Subject(joints=tuple(dict.fromkeys(joint for limb in named for joint in limb)))
        yield Finding("given_lengths_differ", "warning", subject, {"limbs": named, **sizes}, sentence=words)


def _changed(lengths: Array) -> Iterator[Finding]:
    """Yield a finding if all bones (B, T) are longer after some frame than before it."""
    logs = np.log(lengths / medians(lengths)[:, None])
    parts = [logs[:, k : k + _PART] for k in range(0, logs.shape[1] - _PART + 1, _PART)]
    sizes = np.array([finite_median(part) for part in parts])
    known = np.flatnonzero(np.isfinite(sizes))
    sizes, n = sizes[known], len(known)
    if n < 4:
        return
    k = min(range(2, n - 1), key=lambda k: sum(np.abs(x - np.median(x)).sum() for x in np.split(sizes, [k])))
    change = float(np.median(sizes[k:]) - np.median(sizes[:k]))
    noise = 1.4826 / np.sqrt(2) * np.median(np.abs(np.diff(sizes)))
    error = noise * np.sqrt(np.pi / 2 * (1 / k + 1 / (n - k)))
    if abs(np.expm1(change)) > _POSTURE and abs(change) > _SIGMAS * error:
        numbers = {"change": float(np.expm1(change)), "frame": (frame := int(known[k] * _PART))}
        way = f"{percent(abs(numbers['change']))} {'longer' if change > 0 else 'shorter'}"
        words = f"Bones are {way} from about frame {frame} on: are these two people? Refine the parts apart."
        yield Finding("lengths_change", "warning", Subject(), numbers, sentence=words)
