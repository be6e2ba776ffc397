"""What a calibration shows by itself: lenses, places and directions that no recording has."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._words import listed
from skelsplat.findings import Finding, Subject

# degrees: a long telephoto lens and a wide one without a fisheye model
_VIEW_DEG = (3.0, 150.0)
# a narrower view is no fault where others are about as narrow: under a microscope
_LIKE_OTHERS = 3.0
# a crop may put the principal point off the middle, but hardly out of the middle 60 % of the image
_OFF_CENTRE = 0.3
_ASPECT = 1.2
# centres closer than this part of the rig's width are one place
_SAME_PLACE = 1e-3
# axes that differ by less do not meet anywhere in particular
_PARALLEL_DEG = 10.0


def check_geometry(rig: sk.CameraRig) -> list[Finding]:
    """Return findings on lenses, on cameras in one place, and on cameras that look away from the others."""
    narrowest = min(_VIEW_DEG[0], float(np.median([_view(camera) for camera in rig])) / _LIKE_OTHERS)
    findings = [one for i in range(len(rig)) for one in _lens(rig.names[i], rig[i], narrowest)]
    if len(rig) < 2:
        return findings
    centres = np.stack([camera.centre for camera in rig])
    return [*findings, *_same_place(rig.names, centres), *_directions(rig, centres)]


def _view(camera: sk.Camera) -> float:
    """Return the field of view along the longer side, degrees."""
    wide, high = camera.size / np.asarray(camera.K)[[0, 1], [0, 1]]
    return float(np.degrees(2 * np.arctan(max(wide, high) / 2)))


def _lens(name: str, camera: sk.Camera, narrowest: float) -> Iterator[Finding]:
    K, (width, height) = np.asarray(camera.K), camera.size
    (fx, fy), (x, y), view = K[[0, 1], [0, 1]].tolist(), K[:2, 2].tolist(), _view(camera)
    faults = []
    if not camera.fisheye and not narrowest <= view <= _VIEW_DEG[1]:
        faults.append(f"a focal length of {fx:.4g} px is a field of view of {view:.3g}°")
    off = np.abs((K[:2, 2] - [(width - 1) / 2, (height - 1) / 2]) / [width, height])
    if (off > _OFF_CENTRE).any():
        faults.append(f"the principal point ({x:.0f}, {y:.0f}) is far from the middle")
    if not 1 / _ASPECT < fx / fy < _ASPECT:
        faults.append(f"focal lengths of {fx:.4g} and {fy:.4g} px mean pixels that are not square")
    if faults:
        numbers = {"width": width, "height": height, "fx": fx, "fy": fy, "x": x, "y": y, "degrees": view}
        sentence = f"{name}: on images of {width} by {height} px, {', and '.join(faults)}. Is this the image "
        sentence += "size of the calibration, width before height?"
        yield Finding("lens_unusual", subject=Subject((name,)), numbers=numbers, sentence=sentence)


def _same_place(names: tuple[str, ...], centres: Array) -> Iterator[Finding]:
    width = np.linalg.norm(centres[:, None] - centres, axis=-1).max()
    for i, j in combinations(range(len(names)), 2):
        if np.linalg.norm(centres[i] - centres[j]) <= _SAME_PLACE * width:
            sentence = f"{names[i]} and {names[j]} are in the same place; two views from one place give no "
            sentence += "depth. Is one a copy of the other?"
            yield Finding("same_place", subject=Subject((names[i], names[j])), sentence=sentence)


def _directions(rig: sk.CameraRig, centres: Array) -> Iterator[Finding]:
    """Find cameras behind which the point lies that the optical axes come nearest to."""
    axes = np.stack([np.asarray(camera.R)[2] for camera in rig])
    if np.abs(axes @ axes.T).min() > np.cos(np.radians(_PARALLEL_DEG)):
        return
    # the point with the least sum of squared distances from the axes
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.solve(across.sum(axis=0), (across @ centres[:, :, None]).sum(axis=0)[:, 0])
    depths = ((point - centres) * axes).sum(axis=1)
    away = tuple(name for name, depth in zip(rig.names, depths, strict=True) if depth < 0)
    if len(away) == len(rig):
        sentence = "All cameras look away from the point where their axes come closest. Are rotation and "
        sentence += "translation camera → world instead of world → camera, or does z point backwards?"
        yield Finding("looks_away", sentence=sentence)
    elif away and len(away) <= len(rig) // 2:
        sentence = f"{listed(away)} look{'s' * (len(away) == 1)} away from where the other cameras look."
        yield Finding("looks_away", subject=Subject(away), sentence=sentence)
