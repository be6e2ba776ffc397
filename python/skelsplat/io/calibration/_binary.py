"""Calibrations in binary files: OpenCap's pickles and the MAT-files of DANNCE and Label3D."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._fields import Field
from skelsplat.exceptions import DatasetError, MissingPackageError
from skelsplat.io._files import natural
from skelsplat.io._guarded import read_guarded, unpickle
from skelsplat.io.calibration._entries import camera_of, matrix_of, warn_of_fit
from skelsplat.io.calibration._format import CalibrationFormat, Parsed, RawCamera, Source

_OPENCAP = "cameraIntrinsicsExtrinsics"
_PICKLES = (".pickle", ".pkl")


def _opencap_files(source: Source) -> dict[str, Path]:
    """Return the files by camera: of a session, its folder ``Videos``, or a folder with files or folders."""
    if not source.is_folder:
        name = source.path.stem if source.path.stem != _OPENCAP else source.path.absolute().parent.name
        return {name: source.path} if source.suffix in _PICKLES else {}
    for pattern in (f"*/{_OPENCAP}.pickle", f"Videos/*/{_OPENCAP}.pickle"):
        if found := {path.parent.name: path for path in source.path.glob(pattern)}:
            break
    else:
        found = {path.stem: path for path in source.files if path.suffix.lower() in _PICKLES}
    return {name: found[name] for name in sorted(found, key=natural)}


def _is_opencap(source: Source) -> bool:
    path = next(iter(_opencap_files(source).values()), None)
    try:
        return path is not None and "intrinsicMat" in _opencap_entry(path)
    except DatasetError:
        if source.is_folder:  # somebody else's
            return False
        raise


def _parse_opencap(source: Source) -> Parsed:
    """Return OpenCap's cameras, ``Videos/CAMERA/cameraIntrinsicsExtrinsics.pickle``; millimetres.

    Each pickle is a table of arrays: ``intrinsicMat`` 3×3, ``distortion`` in OpenCV's order, ``imageSize``
    (**height**, width), ``rotation`` 3×3 and ``translation`` 3×1, both world → camera; the world is that of
    the checkerboard. ``rotation_EulerAngles`` is the rotation once more, as a rotation vector. Nothing in a
    pickle is run.
    """
    files = _opencap_files(source)
    return [_opencap_camera(name, _opencap_entry(path)) for name, path in files.items()], "mm"


def _opencap_entry(path: Path) -> Field:
    return Field(path, "", _plain(unpickle(path)))


def _opencap_camera(name: str, entry: Field) -> RawCamera:
    K, R, t = "intrinsicMat", "rotation", "translation"
    camera = camera_of(entry.table(), name, K=K, R=R, t=t, lens="distortion", size="imageSize")
    return replace(camera, size=entry["imageSize"].size()[::-1])


_PARAMS = re.compile(r"_?params$")
_VARIABLES = ("params", "camnames", "K", "R", "r", "t", "RDistort", "TDistort")


def _mat_files(source: Source) -> list[Path]:
    """Return the file, or the files of single cameras in a folder."""
    if source.is_folder:
        found = [path for path in source.files if path.suffix == ".mat" and _PARAMS.search(path.stem)]
        return sorted(found, key=lambda path: natural(path.stem))
    return [source.path] if source.suffix == ".mat" else []


def _is_dannce(source: Source) -> bool:
    files = _mat_files(source)
    try:
        return bool(files) and not {"params", "K"}.isdisjoint(_mat(files[0]).value)
    except (DatasetError, MissingPackageError):  # of which parsing tells
        return True


def _parse_dannce(source: Source) -> Parsed:
    """Return the cameras of DANNCE and Label3D; millimetres.

    Either one MAT-file with ``params``, a cell of the cameras, and perhaps ``camnames`` (else ``Camera1``,
    …), or a folder of ``NAME_params.mat``, one per camera. A camera has MATLAB's matrices, which multiply
    rows from the right: ``K`` and ``r`` are the transposes of K and R, ``t`` is a row; ``RDistort`` has k1,
    k2 and perhaps k3, ``TDistort`` p1 and p2. In MATLAB the first pixel's centre is (1, 1): the principal
    point is moved by one. Skew, which MATLAB may estimate, is followed by half turning the camera; the
    remaining error is reported. The image size is not in the files.
    """
    entries: list[tuple[str, Field]] = []
    for path in _mat_files(source):
        document = _mat(path)
        if "params" not in document and "K" in document:
            entries.append((_PARAMS.sub("", path.stem) or path.stem, document))
            continue
        params = document["params"].entries("a cell of cameras with K, r, t, RDistort and TDistort")
        names = [f"Camera{i + 1}" for i in range(len(params))]
        if "camnames" in document:
            names = document["camnames"].names()
        if len(names) != len(params):
            raise document["camnames"].error(f"{len(params)} names, one per camera", f"{len(names)}")
        entries += zip(names, params, strict=True)
    errors: dict[str, float] = {}
    cameras = [_dannce_camera(name, entry, errors) for name, entry in entries]
    warn_of_fit(source.path, errors, "skew is not supported; the cameras turned by half of it agree")
    return cameras, "mm"


def _mat(path: Path) -> Field:
    """Return the variables of a MAT-file as values of JSON; a cell of one element is a list."""
    expected = "a MAT-file of version 5 to 7 (in MATLAB: save with '-v7')"
    return Field(path, "", _plain(read_guarded("mat", path, expected, names=_VARIABLES)))


def _plain(value: Any) -> Any:
    """Return arrays as lists, MATLAB's structures as tables and its texts as texts, wherever they are."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray) and (value.dtype.kind in "OU" or value.dtype.names):
        parts = [one.strip() if isinstance(one, str) else _plain(one) for one in value.ravel()]
        return parts[0] if len(parts) == 1 and value.dtype.kind != "O" else parts
    if isinstance(value, np.void) and value.dtype.names:
        return {name: _plain(value[name]) for name in value.dtype.names}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _dannce_camera(name: str, entry: Field, errors: dict[str, float]) -> RawCamera:
    """Return a camera; the largest error of what stands for its skew, px, is added to `errors`."""
    K = entry.table()["K"].numbers((3, 3)).T.copy()
    K[:2, 2] -= 1.0
    rotation = entry["r" if "r" in entry or "R" not in entry else "R"].numbers((3, 3)).T
    radial, (p1, p2) = entry["RDistort"].numbers(None), entry["TDistort"].numbers((2,))
    if radial.size not in (2, 3):
        raise entry["RDistort"].error("2 or 3 numbers", f"{radial.size} of them")
    lens = np.array([radial[0], radial[1], p1, p2, *radial[2:]])
    K, turn, errors[name] = _without_skew(K)
    return RawCamera(name, K, turn @ rotation, turn @ entry["t"].numbers((3,)), lens)


def _without_skew(K: Array) -> tuple[Array, Array, float]:
    """Return a camera matrix without skew, the turn about the optical axis, and the largest error in px.

    The turn takes half of the skew in x and leaves as much in y, the least that is possible at the edge of an
    image that reaches to twice the principal point.
    """
    skew, (fx, fy), (cx, cy) = K[0, 1], K[[0, 1], [0, 1]], np.abs(K[:2, 2])
    sine = -skew / (fx + fy)
    cosine = np.sqrt(1.0 - sine**2)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    plain = matrix_of(fx, fy, K[0, 2], K[1, 2])
    edge = np.array([cx / fx, cy / fy])
    return plain, turn, float(np.abs((K - plain @ turn)[:2, :2] @ edge).max())


FORMATS = (
    CalibrationFormat("opencap", "OpenCap's session or pickles", _is_opencap, _parse_opencap),
    CalibrationFormat("dannce", "DANNCE's and Label3D's MAT-files", _is_dannce, _parse_dannce, ("size",)),
)
