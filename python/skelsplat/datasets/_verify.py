"""Does a data set mean what its format says? Units, joint order, sides and cameras, by reprojection.

The truth is projected onto the detections of a few frames of every take. Most wrong results in this field are
a wrong unit or an exchanged joint, and both show there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, median, medians
from skelsplat._skelsplat import Camera, Layout, project
from skelsplat.cameras import MM_PER_UNIT, CameraRig, altered, without_distortion
from skelsplat.datasets._model import Dataset, Take
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Subject

_BODY_MM = (400.0, 3500.0)  # diagonal of the box round a person: a crouching child to a tall one, arms out
_CLEAR_PX = 5.0  # an explanation is better by so much, and halves the error: detectors err by a few pixels
_LARGE_PX = 25.0  # median errors that no detector makes
_FRAMES = 24
_MOST_PAIRS = 3
_LENS_PX = 15.0  # joints farther off have another fault than the lens
_DETECTIONS = ("detections", "truth")


@dataclass(frozen=True)
class Sample:
    """A few frames of a take, evenly spread."""

    take: Take
    truth: Array  # (t, N, 3)
    pixels: Array  # (t, M, N, 2): detections; NaN where missing
    projected: Array  # (t, M, N, 2): the truth in all views

    def error(self) -> float:
        """Median distance of truth and detections, px."""
        return median(_distance(self.projected, self.pixels))

    def sides(self, layout: Layout, view: int | slice = slice(None)) -> tuple[float, float]:
        """Return the median error of paired joints as given, and with left and right exchanged."""
        order = np.arange(layout.n_joints)
        for left, right in layout.left_right:
            order[[left, right]] = right, left
        paired = order != np.arange(len(order))
        projected, pixels = self.projected[:, view], self.pixels[:, view]
        given = median(_distance(projected, pixels)[..., paired])
        return given, median(_distance(projected[..., order, :], pixels)[..., paired])

    def view_distances(self) -> Array:
        """Median distance of each view's detections from the projection into each camera, (M, M)."""
        apart = _distance(self.projected[:, None, :], self.pixels[:, :, None])  # (t, M, M, N)
        return medians(np.moveaxis(apart, 0, -1).reshape(*apart.shape[1:3], -1))


def samples_of(dataset: Dataset) -> list[Sample]:
    """Choose up to 24 frames of every take and project their truth."""
    samples = []
    for take in dataset:
        if len(take):
            chosen = np.unique(np.linspace(0, len(take) - 1, min(_FRAMES, len(take))).astype(np.int64))
            some = take.select(chosen)
            shape = (len(chosen), len(take.rig), take.truth.shape[1], 2)
            pixels = np.full(shape, np.nan) if some.detections is None else some.detections[..., :2]
            samples.append(Sample(take, some.truth, pixels, _seen(some.truth, take.rig)))
    return samples


def _seen(truth: Array, rig: CameraRig) -> Array:
    """Project (t, N, 3) to (t, M, N, 2)."""
    return np.asarray(project(truth, rig), dtype=np.float64).swapaxes(0, 1)


def _distance(a: Array, b: Array) -> Array:
    return np.asarray(np.linalg.norm(a - b, axis=-1))


def view_errors(samples: list[Sample]) -> dict[str, float]:
    """Return the median distance of the truth from the detections of every camera, px; NaN without any."""
    found: dict[str, list[float]] = {}
    for item in samples:
        for name, distance in zip(item.take.rig.names, np.diagonal(item.view_distances()), strict=True):
            found.setdefault(name, []).append(float(distance))
    return {name: median(np.array(values)) for name, values in found.items()}


def verify(dataset: Dataset, samples: list[Sample] | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with a data set; errors, with which it cannot be used, come first."""
    samples = samples_of(dataset) if samples is None else samples
    found = _merged(finding for item in samples for finding in _unit(item, dataset.layout))
    if found:  # a wrong unit makes everything else look wrong as well
        return found
    exchanged = _merged(finding for item in samples for finding in _exchanged(item, dataset.layout))
    wrong = {key for finding in exchanged for key in finding.subject.takes}
    clean = [item for item in samples if item.take.key not in wrong]
    views = _merged(finding for item in clean for finding in _views(item, dataset.layout))
    return (*exchanged, *_merged(_joint_order(clean, dataset.layout)), *views, *_lenses(clean))


def raise_errors(dataset: Dataset) -> None:
    """Raise the first error that `verify` finds."""
    for finding in verify(dataset):
        if finding.severity == "error":
            field, _, rest = finding.sentence.partition(": expected ")
            raise DatasetError(Path(finding.subject.files[0]), field, *rest.split(", got ", 1))


def _merged(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Join findings of one kind and the same cameras: the numbers of the first, the takes of all."""
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.kind, *finding.subject.cameras, *finding.numbers), []).append(finding)
    out = []
    for first, *others in groups.values():
        takes = sum((one.subject.takes for one in others), first.subject.takes)
        sentence = f"{first.sentence} in {takes[0]}{_more(len(takes) - 1)}"
        out.append(replace(first, subject=replace(first.subject, takes=takes), sentence=sentence))
    return tuple(out)


def _more(count: int) -> str:
    return f" and {count} more" if count > 0 else ""


def _of(take: Take, files: Sequence[str], cameras: Iterable[str] = ()) -> Subject:
    """Return the subject of a finding in a take, in the first of its `files` that is known."""
    file = next((take.files[part] for part in files if part in take.files), take.key)
    return Subject(cameras=tuple(cameras), files=(str(file),), takes=(take.key,))


def _is_human(size_mm: float) -> bool:
    return _BODY_MM[0] <= size_mm <= _BODY_MM[1]


def _unit(item: Sample, layout: Layout) -> Iterator[Finding]:
    """Find bodies of no human size, and cameras in the wrong scale."""
    take, unit = item.take, item.take.rig.unit
    whole = item.truth[np.isfinite(item.truth).all(axis=(1, 2))]
    # the median diagonal of the boxes round poses
    size = median(np.linalg.norm(np.ptp(whole, axis=1), axis=-1)) if len(whole) else float("nan")
    if layout.n_joints > 10 and not (np.isnan(size) or _is_human(take.rig.mm_per_unit * size)):
        likely = [name for name, mm in MM_PER_UNIT.items() if _is_human(mm * size)][-1:]
        numbers = {"size": size, "unit": unit, **({"likely_unit": likely[0]} if likely else {})}
        advice = f" (plausible in {likely[0]})" if likely else ""
        sentence = f"truth: expected joints in {unit}, got a body of {size:.3g} {unit}{advice}"
        yield Finding("unit_wrong", "error", _of(take, ["truth"]), numbers, sentence=sentence)
    elif (factor := _camera_factor(item)) is not None:
        sentence = (
            f"cameras: expected translations in {unit}, got cameras that fit if their translations are "
        )
        yield Finding(
            "unit_wrong",
            "error",
            _of(take, ["cameras"]),
            {"unit": unit, "factor": factor},
            sentence=f"{sentence}multiplied by {factor:g}",
        )


def _camera_factor(item: Sample) -> float | None:
    """Return the power of ten that the cameras' translations lack, if one explains the detections."""
    rig, given = item.take.rig, item.error()
    if given <= _LARGE_PX or not np.isfinite(item.pixels).any():
        return None
    errors = {}
    for factor in (1000.0, 100.0, 10.0, 0.1, 0.01, 0.001):
        scaled = CameraRig([altered(camera, t=factor * camera.t) for camera in rig], rig.unit)
        error = replace(item, projected=_seen(item.truth, scaled)).error()
        errors[factor] = np.nan_to_num(error, nan=np.inf)
    best = min(errors, key=errors.__getitem__)
    return best if errors[best] < (0.2 * given if np.isfinite(given) else _LARGE_PX) else None


def _clearly_less(better: float, given: float) -> bool:
    return better < 0.5 * given and given - better > _CLEAR_PX


def _exchanged(item: Sample, layout: Layout, view: int | None = None) -> Iterator[Finding]:
    """Find detections, of a view or of all, that fit the truth with left and right exchanged."""
    given, exchanged = item.sides(layout, slice(None) if view is None else view)
    if _clearly_less(exchanged, given):
        cameras = [] if view is None else [item.take.rig.names[view]]
        yield Finding(
            "sides_swapped",
            "error" if view is None else "warning",
            _of(item.take, _DETECTIONS, cameras),
            {"given_px": given, "exchanged_px": exchanged},
            sentence=f"{f'camera {cameras[0]}' if cameras else 'left and right'}: expected the same sides in "
            f"the truth and the detections, got {given:.1f} px as given, {exchanged:.1f} px exchanged",
        )


def _joint_order(samples: list[Sample], layout: Layout) -> Iterator[Finding]:
    """Find joints of the truth that lie on another joint of the detections."""
    if not samples:
        return
    each = [_distance(s.projected[..., :, None, :], s.pixels[..., None, :, :]) for s in samples]
    flat = [np.moveaxis(apart.reshape(-1, *apart.shape[2:]), 0, -1) for apart in each]
    table = medians(np.stack([medians(apart) for apart in flat], axis=-1))  # projected, detected
    names = layout.joints
    pairs = [
        [names[joint], names[int(row.argmin())]]
        for joint, row in enumerate(table)
        if np.isfinite(row).all() and _clearly_less(row.min(), row[joint])
    ]
    if pairs:
        shown = ", ".join(f"{joint} lies on {other}" for joint, other in pairs[:_MOST_PAIRS])
        yield Finding(
            "dataset_joint_order",
            "warning",
            replace(_of(samples[0].take, _DETECTIONS), takes=tuple(item.take.key for item in samples)),
            {"layout": layout.name, "pairs": pairs},
            sentence=f"joints: expected the order of {layout.name} in the truth and the detections, "
            f"got another order: {shown}{_more(len(pairs) - _MOST_PAIRS)}",
        )


def _views(item: Sample, layout: Layout) -> Iterator[Finding]:
    """Find views that fit another camera, or have their sides exchanged."""
    names = item.take.rig.names
    for view, row in enumerate(item.view_distances()):
        if not np.isfinite(row[view]):
            continue
        best = int(np.nanargmin(row))
        if _clearly_less(row[best], row[view]):
            yield Finding(
                "cameras_exchanged",
                "warning",
                _of(item.take, _DETECTIONS, [names[view]]),
                {"given_px": float(row[view]), "other_px": float(row[best]), "other": names[best]},
                sentence=f"camera {names[view]}: expected detections of this camera, got {row[view]:.1f} px "
                f"from the truth, and {row[best]:.1f} px in camera {names[best]}",
            )
        else:
            yield from _exchanged(item, layout, view)


def _exchange_tangential(camera: Camera) -> Camera:
    lens = np.array(camera.distortion)
    lens[[2, 3]] = lens[[3, 2]]
    return altered(camera, distortion=lens)


_LENSES: dict[str, tuple[Callable[[Camera], Camera], str]] = {
    "tangential": (_exchange_tangential, "p1 and p2 exchanged"),
    "none": (without_distortion, "detections without distortion (undistorted, or made with K alone)"),
}


def _lenses(samples: list[Sample]) -> Iterator[Finding]:
    """Find cameras that fit better with p1 and p2 exchanged, or without distortion."""
    fits: dict[str, list[Array]] = {}  # residuals, and the steps from the given lens to each other one
    for item in samples:
        for view, (name, camera) in enumerate(zip(item.take.rig.names, item.take.rig, strict=True)):
            if camera.distortion is not None and not camera.fisheye:
                others = ([other(camera)] for other, _ in _LENSES.values())
                seen = [_seen(item.truth, CameraRig(one, item.take.rig.unit))[:, 0] for one in others]
                moved = np.stack([item.pixels[:, view], *seen]) - item.projected[:, view]
                length = np.linalg.norm(moved[0], axis=-1)
                near = (length <= min(3.0 * median(length), _LENS_PX)) & np.isfinite(moved).all(axis=(0, -1))
                fits.setdefault(name, []).append(moved[:, near])
    wrong: dict[str, list[str]] = {lens: [] for lens in _LENSES}
    for name, parts in fits.items():
        residual, *steps = np.concatenate(parts, axis=1)
        lens, step = min(
            zip(_LENSES, steps, strict=True), key=lambda one: float(((residual - one[1]) ** 2).sum())
        )
        if _is_right(step, residual):
            wrong[lens].append(name)
    for lens, cameras in wrong.items():
        if cameras:
            yield Finding(
                "dataset_lens",
                "warning",
                replace(_of(samples[0].take, ["cameras"], cameras), takes=()),
                {"likely_lens": lens},
                sentence=f"distortion of {', '.join(cameras)}: expected the lens of the detections, "
                f"got {_LENSES[lens][1]}",
            )


def _is_right(step: Array, residual: Array) -> bool:
    """Whether the share s in residual = s · step is nearer to 1 than to 0, by four standard errors of it."""
    own = float((step**2).sum())
    if residual.size < 8 or own <= 1e-12:
        return False
    share = float((step * residual).sum()) / own
    rest = float(((residual - share * step) ** 2).sum())
    return bool(share - 4.0 * np.sqrt(rest / residual.size / own) > 0.5)
