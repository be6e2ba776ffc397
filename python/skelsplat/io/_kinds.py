"""What a file is that is not what was asked for, for the message that refuses it."""

from __future__ import annotations

from pathlib import Path

from skelsplat._budget import MOST_DOCUMENT, damaged_zip, opened
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import HDF5
from skelsplat.io.calibration import find_format
from skelsplat.io.detections._registry import recognised
from skelsplat.io.poses import POSE_FORMATS, READ, is_pose_file

# of MATLAB's own classes, as its calibration apps export them, and of other variables nothing is read
_MAT = "a MAT-file of other variables or objects; in MATLAB, save K, r, t, RDistort, TDistort of each camera"
_SIGNS = {
    ".npy": (b"\x93NUMPY",),
    ".h5": (HDF5,),
    ".hdf5": (HDF5,),
    ".slp": (HDF5,),
    ".nwb": (HDF5,),
    ".nc": (HDF5, b"CDF"),
}


def seems(path: Path) -> str | None:
    """Return what a path seems to be: poses, detections, a calibration, damaged; None if unknown."""
    try:
        if path.is_file() and (wrong := damage(path)) is not None:
            return wrong
        if is_pose_file(path):
            return "poses"
        if found := recognised(path):
            return f"detections ({', '.join(found)})"
        if path.suffix.lower() == ".mat":
            return _MAT if find_format(path) is None else None
        form = None if path.is_file() and path.stat().st_size > MOST_DOCUMENT else find_format(path)
    except DatasetError as error:
        return f"invalid JSON: {error.actual}" if error.field == "JSON" else None
    except OSError:
        return None
    if form is not None:
        return f"a calibration ({form})"
    kinds = [kind for kind in POSE_FORMATS if kind not in READ and path.name.lower().endswith(f".{kind}")]
    return f"a .{kinds[0]} file, which is only written" if kinds and path.is_file() else None


def damage(path: Path) -> str | None:
    """Say that the content of a file is not what its name says; None if it is, or cannot be told."""
    suffix = path.suffix.lower()
    try:
        with opened(path) as stream:
            if suffix == ".npz":
                return damaged_zip(stream)
            begins = stream.read(8)
    except DatasetError:  # it cannot be read
        return None
    if not begins:
        return "an empty file"
    wrong = not begins.startswith(_SIGNS.get(suffix, (b"",)))
    return "another kind of file, or a damaged one" if wrong else None
