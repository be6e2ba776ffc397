"""Does a data set mean what its format says? Units, joint order, sides and cameras, by reprojection.

The truth is projected onto the detections of a few frames of every take. Most wrong results in this field are
a wrong unit or an exchanged joint, and both show there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from skelsplat._skelsplat import Camera, Layout
from skelsplat.cameras import CameraRig, without_distortion
from skelsplat.datasets import _reproject as rp
from skelsplat.datasets._finding import Finding, file_of, merged
from skelsplat.datasets._model import Dataset, FloatArray

_BODY_MM = (400.0, 3500.0)
"""Diagonal of the box round a person: from a child that crouches to a tall one with arms spread."""
_NEAR_MM = 200.0
_CLEAR_PX = 5.0
_LARGE_PX = 25.0


def samples_of(dataset: Dataset) -> list[rp.Sample]:
    """Return a few frames of every take."""
    return [rp.sample(take) for take in dataset if len(take)]


def verify(dataset: Dataset, samples: list[rp.Sample] | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with a data set; what makes it useless first."""
    samples = samples_of(dataset) if samples is None else samples
    found = merged(finding for item in samples for finding in _unit(item, dataset.layout))
    if found:  # a wrong unit makes everything else look wrong as well
        return found
    exchanged = merged(finding for item in samples for finding in _sides(item, dataset.layout))
    clean = [item for item in samples if item.take.key not in {key for f in exchanged for key in f.takes}]
    rest = [
        *_joint_order(clean, dataset.layout),
        *merged(finding for item in clean for finding in _views(item, dataset.layout)),
        *_lenses(clean),
    ]
    return (*exchanged, *rest)


def raise_fatal(dataset: Dataset) -> None:
    """Raise the worst finding of `verify` if the data cannot be used.

    Raises
    ------
    DatasetError
    """
    for finding in verify(dataset):
        if finding.fatal:
            raise finding.error()


def body_size(poses: FloatArray) -> float:
    """Return the median diagonal of the boxes round the poses (…, N, 3) that are complete; NaN if none is."""
    flat = poses.reshape(-1, *poses.shape[-2:])
    whole = flat[np.isfinite(flat).all(axis=(1, 2))]
    return rp.median(np.linalg.norm(np.ptp(whole, axis=1), axis=-1)) if len(whole) else float("nan")


def is_human(size_mm: float) -> bool:
    """Whether a person's box can have such a diagonal."""
    return _BODY_MM[0] <= size_mm <= _BODY_MM[1]


def _unit(item: rp.Sample, layout: Layout) -> Iterator[Finding]:
    """Find bodies of no human size, and cameras inside the body or in the wrong scale."""
    take, unit = item.take, item.take.rig.unit
    scale = take.rig.mm_per_unit
    size = scale * body_size(item.truth)
    if layout.n_joints > 10 and not (np.isnan(size) or is_human(size)):
        likely = _likely_unit(size / scale)
        yield Finding(
            "unit",
            file_of(take, "truth"),
            "truth",
            f"joints in {unit}",
            f"a body of {size / scale:.3g} {unit}{likely}",
            fatal=True,
            takes=(take.key,),
        )
        return
    factor = _camera_factor(item)
    if factor is not None:
        yield Finding(
            "unit",
            file_of(take, "cameras"),
            "cameras",
            f"translations in {unit}",
            f"cameras that fit if their translations are multiplied by {factor:g}",
            fatal=True,
            takes=(take.key,),
        )


def _likely_unit(size: float) -> str:
    """Name the unit in which a body of that size would be a person's."""
    for name, factor in (("m", 1000.0), ("cm", 10.0), ("mm", 1.0)):
        if is_human(factor * size):
            return f", which it would be in {name}"
    return ""


def _camera_factor(item: rp.Sample) -> float | None:
    """Return the power of ten that the cameras' translations lack, if one explains the detections."""
    rig = item.take.rig
    body = np.array([rp.median(item.truth[..., axis]) for axis in range(3)])
    nearest = min(float(np.linalg.norm(camera.centre - body)) for camera in rig) * rig.mm_per_unit
    given = item.error()
    if not (nearest < _NEAR_MM or given > _LARGE_PX or np.isnan(given)):
        return None
    errors = {}
    for factor in (1000.0, 100.0, 10.0, 0.1, 0.01, 0.001):
        errors[factor] = item.reprojected(_scaled(rig, factor)).error()
    best = min(errors, key=lambda factor: np.nan_to_num(errors[factor], nan=np.inf))
    if errors[best] < (0.2 * given if np.isfinite(given) else _LARGE_PX):
        return best
    return 1000.0 if nearest < _NEAR_MM and np.isnan(given) else None


def _scaled(rig: CameraRig, factor: float) -> CameraRig:
    return CameraRig(
        [
            Camera(
                c.K, c.R, factor * c.t, distortion=c.distortion, fisheye=c.fisheye, size=c.size, name=c.name
            )
            for c in rig
        ],
        rig.unit,
    )


def _clearly_less(better: float, given: float) -> bool:
    return better < 0.5 * given and given - better > _CLEAR_PX


def _sides(item: rp.Sample, layout: Layout) -> Iterator[Finding]:
    """Find takes whose detections fit the truth with left and right exchanged."""
    given, exchanged = rp.sides(item, layout)
    if _clearly_less(exchanged, given):
        yield Finding(
            "sides",
            file_of(item.take, "detections", "truth"),
            "left and right",
            "the same sides in the truth and the detections",
            f"sides that are exchanged: {given:.1f} px from the truth as given, {exchanged:.1f} px exchanged",
            fatal=True,
            takes=(item.take.key,),
        )


def _joint_order(samples: list[rp.Sample], layout: Layout) -> Iterator[Finding]:
    """Find joints of the truth that lie on another joint of the detections."""
    if not samples:
        return
    table = rp.mean_over([rp.joint_distances(item) for item in samples])
    names, pairs = layout.joints, []
    for joint, row in enumerate(table):
        if np.isfinite(row).all() and _clearly_less(row.min(), row[joint]):
            pairs.append(f"{names[joint]} lies on {names[int(row.argmin())]}")
    if pairs:
        more = f" and {len(pairs) - 3} more" if len(pairs) > 3 else ""
        yield Finding(
            "joint order",
            file_of(samples[0].take, "detections", "truth"),
            "joints",
            f"the order of {layout.name} in the truth and the detections",
            f"another: {', '.join(pairs[:3])}{more}",
            takes=tuple(item.take.key for item in samples),
        )


def _views(item: rp.Sample, layout: Layout) -> Iterator[Finding]:
    """Find views that fit another camera, have their sides exchanged, or fit much worse than the others."""
    table = rp.view_distances(item)
    names = item.take.rig.names
    quarters = np.array([item.best_quarter(view) for view in range(len(names))])
    for view, row in enumerate(table):
        if not np.isfinite(row[view]):
            continue
        others = rp.median(np.delete(quarters, view))
        given, exchanged = rp.sides(item, layout, view)
        best = int(np.nanargmin(row))
        if _clearly_less(row[best], row[view]):
            what, expected = "cameras", "detections of this camera"
            actual = f"{row[view]:.1f} px from the truth, and {row[best]:.1f} px in camera {names[best]}"
        elif _clearly_less(exchanged, given):
            what, expected = "views", "left and right as in the other views"
            actual = f"{given:.1f} px as given, {exchanged:.1f} px with sides exchanged"
        elif quarters[view] > max(_LARGE_PX, 3.0 * np.nan_to_num(others)):
            what, expected = "views", "detections near the truth"
            actual = f"the best quarter of them up to {quarters[view]:.1f} px off"
        else:
            continue
        yield Finding(
            what,
            file_of(item.take, "detections", "truth"),
            f"camera {names[view]}",
            expected,
            actual,
            takes=(item.take.key,),
        )


_LENSES: dict[str, Callable[[Camera], Camera]] = {
    "p1 and p2 that are exchanged": rp.with_exchanged_tangential,
    "detections without distortion (undistorted, or made with K alone)": without_distortion,
}


def _lenses(samples: list[rp.Sample]) -> Iterator[Finding]:
    """Find cameras that fit better with p1 and p2 exchanged, or without distortion."""
    fits: dict[str, dict[str, rp.LensFit]] = {}
    for item in samples:
        for view, (name, camera) in enumerate(zip(item.take.rig.names, item.take.rig, strict=True)):
            if camera.distortion is not None and not camera.fisheye:
                own = fits.setdefault(name, {actual: rp.LensFit() for actual in _LENSES})
                for actual, other in _LENSES.items():
                    own[actual].add(item, view, other)
    best = {name: min(own, key=lambda actual: own[actual].misfit) for name, own in fits.items()}
    for actual in _LENSES:
        wrong = [name for name, own in fits.items() if best[name] == actual and own[actual].other_is_right()]
        if wrong:
            file = file_of(samples[0].take, "cameras")
            field = f"distortion of {', '.join(wrong)}"
            yield Finding("lens", file, field, "the lens of the detections", actual)
