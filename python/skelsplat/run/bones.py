"""Findings on bones: lengths that change within a recording, and limbs of a layout that are no bones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skelsplat._arrays import Array
from skelsplat._words import length, percent
from skelsplat.findings import Finding, Subject
from skelsplat.run.frames import some
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome

# Frames that are compared as one, since a detector's errors last.
_PART = 25
# A change is shown beyond so many standard errors, as it may be at any of some dozens of frames, and beyond
# what posture does to the ends of bones: up to 5 % in 19 takes of Human3.6M (S1, S5 to S8).
_SIGMAS, _POSTURE = 5.0, 0.06
# No bone is so many times as long in a tenth of the frames as in another, beyond what noise does to it.
_VARIES, _NOISE = 2.0, 2.56


def find_bones(inputs: Inputs, alone: Outcome) -> Iterator[Finding]:
    """Yield a finding on lengths that change once, or else on limbs whose length varies all the time."""
    known = np.asarray(alone.result.joint_status == "ok")[..., None]
    pose = np.where(known, alone.result.pose, np.nan) * inputs.rig.mm_per_unit
    lengths = {}
    for a, b in inputs.layout.limbs:
        seen = np.linalg.norm(pose[:, a] - pose[:, b], axis=-1)
        if np.isfinite(seen).sum() >= 4 * _PART:
            lengths[inputs.layout.joints[a], inputs.layout.joints[b]] = seen
    if not lengths:
        return
    variance = np.nanmedian(np.trace(alone.result.uncertainty, axis1=-2, axis2=-1)) * 2 / 3
    yield from list(_changed(np.array([*lengths.values()]))) or _varying(
        lengths, _NOISE * float(np.sqrt(variance)) * inputs.rig.mm_per_unit
    )


def _changed(lengths: Array) -> Iterator[Finding]:
    """Yield a finding if all bones (B, T) are longer after some frame than before it."""
    logs = np.log(lengths / np.nanmedian(lengths, axis=1, keepdims=True))
    parts = [logs[:, k : k + _PART] for k in range(0, logs.shape[1] - _PART + 1, _PART)]
    sizes = np.array([np.nanmedian(part) if np.isfinite(part).any() else np.nan for part in parts])
    known = np.flatnonzero(np.isfinite(sizes))
    sizes, n = sizes[known], len(known)
    if n < 4:
        return
    changes = np.array([np.median(sizes[k:]) - np.median(sizes[:k]) for k in range(2, n - 1)])
    scatter = 1.4826 / np.sqrt(2) * np.median(np.abs(np.diff(sizes)))
    errors = np.array([scatter * np.sqrt(np.pi / 2 * (1 / k + 1 / (n - k))) for k in range(2, n - 1)])
    best = int(np.argmin([_scatter(sizes[:k]) + _scatter(sizes[k:]) for k in range(2, n - 1)]))
    change, frame = float(np.expm1(changes[best])), int(known[2 + best] * _PART)
    if abs(change) > _POSTURE and abs(changes[best]) > _SIGMAS * errors[best]:
        words = f"Bones are {percent(abs(change))} {'longer' if change > 0 else 'shorter'} from about frame "
        words += f"{frame} on: are these two people? Refine the parts apart."
        numbers = {"change": change, "frame": frame}
        yield Finding("lengths_change", "warning", Subject(), numbers, sentence=words)


def _scatter(sizes: Array) -> float:
    return float(np.abs(sizes - np.median(sizes)).sum())


def _varying(lengths: dict[tuple[str, str], Array], noise: float) -> Iterator[Finding]:
    """Yield a finding on limbs whose length varies."""
    ranges = {limb: np.nanpercentile(seen, [10, 90]).tolist() for limb, seen in lengths.items()}
    varying = {limb: ends for limb, ends in ranges.items() if ends[1] > _VARIES * ends[0] + noise}
    if varying:
        sizes = [f"{a} to {b} {length(s, 0)} to {length(e, 0)} mm" for (a, b), (s, e) in varying.items()]
        words = f"Limbs of the layout are no bones, since their lengths vary: {some(sizes)}."
        subject = Subject(joints=tuple(dict.fromkeys(joint for limb in varying for joint in limb)))
        numbers = {"limbs": [list(limb) for limb in varying], "ranges_mm": list(varying.values())}
        yield Finding("limb_varies", "warning", subject, numbers, sentence=words)
