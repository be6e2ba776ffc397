"""Calibrations in JSON whose cameras are a table by name: VoxelPose's and 4D association's."""

from __future__ import annotations

import numpy as np

from skelsplat.io._fields import Field
from skelsplat.io.calibration._format import Parsed, RawCamera, Source, lens_of, noted, rotation_of, size_of

_VOXELPOSE = {"R", "T", "fx", "fy", "cx", "cy"}


def _cameras(source: Source, *keys: set[str]) -> list[Field]:
    """Return all entries of a document of which one has the keys of one of these sets; else none."""
    document = source.json
    entries = [document[name] for name in document.value] if isinstance(document.value, dict) else []
    tables = [entry.value for entry in entries if isinstance(entry.value, dict)]
    return entries if any(wanted <= table.keys() for wanted in keys for table in tables) else []


def is_voxelpose(source: Source) -> bool:
    """Whether a document is a table of cameras with a focal length."""
    return bool(_cameras(source, _VOXELPOSE))


def parse_voxelpose(source: Source) -> Parsed:
    """Return the cameras of VoxelPose's calibration of Shelf and Campus, which MMPose reads as well; mm.

    ``{"0": {R, T, fx, fy, cx, cy, k, p}, …}``: ``T`` (3×1) is the centre of the camera, x_c = R (x − T);
    ``k`` has OpenCV's k1, k2, k3 and ``p`` its p1, p2. The image size is not in the file.
    """
    entries = _cameras(source, _VOXELPOSE)
    if not entries:
        raise source.json.error("a table of cameras with R, T, fx, fy, cx, cy, k and p", "none")
    return Parsed([_voxelpose_camera(entry.table()) for entry in entries], "mm")


def _voxelpose_camera(entry: Field) -> RawCamera:
    fx, fy, cx, cy = (entry[name].number() for name in ("fx", "fy", "cx", "cy"))
    rotation = entry["R"].numbers((3, 3))
    (k1, k2, k3), (p1, p2) = entry["k"].numbers((3,)), entry["p"].numbers((2,))
    return RawCamera(
        name=entry.place,
        K=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
        R=rotation,
        t=-rotation @ entry["T"].numbers((3,)),
        distortion=np.array([k1, k2, p1, p2, k3]),
        size=None,
    )


def is_association(source: Source) -> bool:
    """Whether a document is a table of cameras with flat matrices and the size of the image."""
    return bool(_cameras(source, {"K", "imgSize", "RT"}, {"K", "imgSize", "R", "T"}))


def parse_association(source: Source) -> Parsed:
    """Return the cameras of 4D association; the unit is not in the file (its own data are in metres).

    ``{"0": {K, RT, imgSize}, …}``: ``K`` are 9 numbers by rows, ``RT`` 12, world → camera; in its place may
    be ``R`` (9 numbers, or a rotation vector) and ``T``. ``distCoeff`` is in OpenCV's order; without it there
    is no lens. ``rectifyAlpha`` belongs to images that the program undistorts and is passed over.
    """
    entries = _cameras(source, {"K"})
    if not entries:
        raise source.json.error("a table of cameras with K, RT and imgSize", "none")
    bare = [entry.place for entry in entries if "distCoeff" not in entry.table()]
    found = [noted("lens_assumed", source.path, *bare)] if bare else []
    return Parsed([_association_camera(entry) for entry in entries], None, found)


def _association_camera(entry: Field) -> RawCamera:
    if "RT" in entry:
        pose = entry["RT"].numbers((12,)).reshape(3, 4)
        rotation, translation = pose[:, :3], pose[:, 3]
    else:
        flat = entry["R"]
        whole = isinstance(flat.value, list) and len(flat.value) == 9
        rotation = flat.numbers((9,)).reshape(3, 3) if whole else rotation_of(flat)
        translation = entry["T"].numbers((3,))
    return RawCamera(
        name=entry.place,
        K=entry["K"].numbers((9,)).reshape(3, 3),
        R=rotation,
        t=translation,
        distortion=lens_of(entry["distCoeff"]) if "distCoeff" in entry else None,
        size=size_of(entry["imgSize"]),
    )
