"""Calibrations in binary files: OpenCap's pickles and the MAT-files of DANNCE and Label3D."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError, MissingPackageError
from skelsplat.io._fields import Field
from skelsplat.io._files import natural
from skelsplat.io._guarded import load_mat, unpickle
from skelsplat.io.calibration._format import (
    GOOD_FIT_PX,
    CalibrationFormat,
    Parsed,
    RawCamera,
    Source,
    approximated,
    camera_of,
    size_of,
)

_OPENCAP = "cameraIntrinsicsExtrinsics"
_PICKLES = (".pickle", ".pkl")


def _plain(value: Any) -> Any:
    """Return arrays, also those in tables and lists, as lists of numbers."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _opencap_files(source: Source) -> dict[str, Path]:
    """Return the files by camera: of a session, its folder ``Videos``, or a folder with files or folders."""
    if not source.is_folder:
        name = source.path.stem if source.path.stem != _OPENCAP else source.path.absolute().parent.name
        return {name: source.path} if source.suffix in _PICKLES else {}
    for pattern in (f"*/{_OPENCAP}.pickle", f"Videos/*/{_OPENCAP}.pickle"):
        if found := sorted(source.path.glob(pattern), key=lambda path: natural(path.parent.name)):
            return {path.parent.name: path for path in found}
    own = [path for path in source.files if path.suffix.lower() in _PICKLES]
    return {path.stem: path for path in sorted(own, key=lambda path: natural(path.stem))}


def is_opencap(source: Source) -> bool:
    """Whether a pickle, or the first of a folder's, has OpenCap's camera matrix."""
    path = next(iter(_opencap_files(source).values()), None)
    if path is None:
        return False
    try:
        return "intrinsicMat" in _opencap_entry(path)
    except DatasetError:
        if source.is_folder and not path.stem.startswith(_OPENCAP):  # somebody else's
            return False
        raise


def parse_opencap(source: Source) -> Parsed:
    """Return OpenCap's cameras, ``Videos/CAMERA/cameraIntrinsicsExtrinsics.pickle``; millimetres.

    Each pickle is a table of arrays: ``intrinsicMat`` 3×3, ``distortion`` in OpenCV's order, ``imageSize``
    (**height**, width), ``rotation`` 3×3 and ``translation`` 3×1, both world → camera; the world is that of
    the checkerboard. ``rotation_EulerAngles`` is the rotation once more, as a rotation vector. Nothing in a
    pickle is run.
    """
    files = _opencap_files(source)
    if not files:
        raise DatasetError(source.path, "files", f"{_OPENCAP}.pickle in a folder per camera", "none")
    return Parsed([_opencap_camera(name, _opencap_entry(path)) for name, path in files.items()], "mm")


def _opencap_entry(path: Path) -> Field:
    return Field(path, "", _plain(unpickle(path)))


def _opencap_camera(name: str, entry: Field) -> RawCamera:
    if "rotation" not in entry.table() and "intrinsicMat" in entry:
        expected = f"rotation and translation, which OpenCap writes to {_OPENCAP}.pickle"
        raise entry.error(expected, "intrinsics alone")
    height, width = size_of(entry["imageSize"])
    camera = camera_of(entry, name, K="intrinsicMat", R="rotation", t="translation", lens="distortion")
    return replace(camera, size=(width, height))


_PARAMS = re.compile(r"_?params$")


def _mat_files(source: Source) -> list[Path]:
    """Return the file, or the files of single cameras in a folder."""
    if source.is_folder:
        found = [path for path in source.files if path.suffix == ".mat" and _PARAMS.search(path.stem)]
        return sorted(found, key=lambda path: natural(path.stem))
    return [source.path] if source.suffix == ".mat" else []


def is_dannce(source: Source) -> bool:
    """Whether a source is a MAT-file with cameras, or a folder with those of single cameras."""
    return any(_may_have_cameras(path) for path in _mat_files(source)[:1])


def _may_have_cameras(path: Path) -> bool:
    """Whether a MAT-file has the cameras' variables, or cannot be looked into, of which the parser tells."""
    try:
        names = _mat(path).keys()
    except (DatasetError, MissingPackageError):
        return True
    return "params" in names or names >= {"K", "t"}


def parse_dannce(source: Source) -> Parsed:
    """Return the cameras of DANNCE and Label3D; millimetres.

    Either one MAT-file with ``params``, a cell of the cameras, and perhaps ``camnames`` (else ``Camera1``,
    …), or a folder of ``NAME_params.mat``, one per camera. A camera has MATLAB's matrices, which multiply
    rows from the right: ``K`` and ``r`` are the transposes of K and R, ``t`` is a row; ``RDistort`` has k1,
    k2 and perhaps k3, ``TDistort`` p1 and p2. In MATLAB the first pixel's centre is (1, 1): the principal
    point is moved by one. Skew, which MATLAB may estimate, is followed by half turning the camera; the
    remaining error is reported. The image size is not in the files.
    """
    files = _mat_files(source)
    if not files:
        raise DatasetError(source.path, "files", "a MAT-file with params, or CAMERA_params.mat", "none")
    entries: list[tuple[str, Field]] = []
    for path in files:
        document = Field(path, "", _mat(path))
        if "params" not in document and "K" in document:
            entries.append((_PARAMS.sub("", path.stem) or path.stem, document))
            continue
        params = document["params"].entries("a cell of cameras with K, r, t, RDistort and TDistort")
        names = document["camnames"].names() if "camnames" in document else []
        if names and len(names) != len(params):
            raise document["camnames"].error(f"{len(params)} names, one per camera", f"{len(names)}")
        entries += zip(names or [f"Camera{i + 1}" for i in range(len(params))], params, strict=True)
    read = [_dannce_camera(name, entry.table()) for name, entry in entries]
    skewed = [camera.name for camera, error in read if error > GOOD_FIT_PX]
    worst = max((error for _, error in read), default=0.0)
    how = "skew is not supported; the cameras turned by half of it agree"
    found = [approximated(source.path, skewed, worst, how)] if skewed else []
    return Parsed([camera for camera, _ in read], "mm", found)


def _mat(path: Path) -> dict[str, Any]:
    """Return the variables of a MAT-file; a cell or a structure of one element is a list, too."""
    names = ["params", "camnames", *"KRrt", "RDistort", "TDistort"]
    table = load_mat(path, "a MAT-file of version 5 to 7 (in MATLAB: save with '-v7')", names)
    return {key: _cells(value) for key, value in table.items()}


def _cells(value: Any) -> Any:
    """Return MATLAB's cells as lists, structures as tables, texts as texts and matrices as nested lists."""
    if isinstance(value, np.void) and value.dtype.names:
        return {name: _cells(value[name]) for name in value.dtype.names}
    if not isinstance(value, np.ndarray):
        return _plain(value)
    if value.dtype.kind == "U":
        return str(value.ravel()[0]) if value.size == 1 else [str(one).strip() for one in value.ravel()]
    if value.dtype.names:
        parts = [_cells(one) for one in value.ravel()]
        return parts[0] if len(parts) == 1 else parts
    return [_cells(one) for one in value.ravel()] if value.dtype == object else value.tolist()


def _dannce_camera(name: str, entry: Field) -> tuple[RawCamera, float]:
    """Return a camera and the largest error of what stands for its skew, px."""
    K = entry["K"].numbers((3, 3)).T.copy()
    K[:2, 2] -= 1.0
    rotation = entry["r" if "r" in entry or "R" not in entry else "R"].numbers((3, 3)).T
    radial, (p1, p2) = entry["RDistort"].numbers(None), entry["TDistort"].numbers((2,))
    if radial.size not in (2, 3):
        raise entry["RDistort"].error("2 or 3 numbers", f"{radial.size} of them")
    lens = np.array([radial[0], radial[1], p1, p2, *radial[2:]])
    K, turn, error = _without_skew(K)
    return RawCamera(name, K, turn @ rotation, turn @ entry["t"].numbers((3,)), lens, None), error


def _without_skew(K: Array) -> tuple[Array, Array, float]:
    """Return a camera matrix without skew, the turn about the optical axis, and the largest error in px.

    The turn takes half of the skew in x and leaves as much in y, the least that is possible at the edge of an
    image that reaches to twice the principal point.
    """
    skew, (fx, fy), (cx, cy) = K[0, 1], K[[0, 1], [0, 1]], np.abs(K[:2, 2])
    sine = -skew / (fx + fy)
    cosine = np.sqrt(1.0 - sine**2)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    plain = np.array([[fx, 0.0, K[0, 2]], [0.0, fy, K[1, 2]], [0.0, 0.0, 1.0]])
    edge = np.array([cx / fx, cy / fy])
    return plain, turn, float(np.abs((K - plain @ turn)[:2, :2] @ edge).max())


FORMATS = (
    CalibrationFormat("opencap", "OpenCap's session or pickles", "mm", is_opencap, parse_opencap),
    CalibrationFormat("dannce", "DANNCE's and Label3D's MAT-files", "mm", is_dannce, parse_dannce, ("size",)),
)
